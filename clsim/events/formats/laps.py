"""Clocks of few bits, which begin anew at their end."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


class Laps:
    """Counts how often a clock began anew: each time that it goes back by half of its span or more."""

    def __init__(self, span: int) -> None:
        """Start before the first lap's end; the clock tells times below ``span``."""
        self._span, self._last, self._laps = span, 0, 0

    def unroll(self, times: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """Return times that follow those before as times since the first lap."""
        if not len(times):
            return times
        drops = np.diff(times, prepend=self._last) <= -(self._span // 2)
        laps = self._laps + np.cumsum(drops)
        self._last, self._laps = int(times[-1]), int(laps[-1])
        unrolled: npt.NDArray[np.int64] = times + laps * self._span
        return unrolled
