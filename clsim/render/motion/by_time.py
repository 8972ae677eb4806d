"""A cache of rows of numbers by instant, such as poses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]


class ByTime:
    """Remembers a row of numbers for each instant: to find where a camera stands takes as long as many rays."""

    def __init__(self, find: Callable[[F64], F32]) -> None:
        """Know none; ``find`` returns the rows ``[K, N]`` of K instants [s]."""
        self._find = find
        self._times_s, self._rows = np.zeros(0), np.zeros((0, 0), np.float32)

    def rows(self, times_s: F64) -> F32:
        """Return the rows of instants; each is found once."""
        at = np.searchsorted(self._times_s, times_s)
        known = at < len(self._times_s)
        known[known] = self._times_s[at[known]] == times_s[known]
        if not known.all():
            self._add(np.unique(times_s[~known]))
            at = np.searchsorted(self._times_s, times_s)
        return self._rows[at]

    def forget(self) -> None:
        """Know nothing any more: time has gone on."""
        self._times_s, self._rows = np.zeros(0), np.zeros((0, 0), np.float32)

    def _add(self, times_s: F64) -> None:
        found = self._find(times_s)
        at = np.searchsorted(self._times_s, times_s)
        self._rows = np.insert(self._rows, at, found, axis=0) if len(self._times_s) else found
        self._times_s = np.insert(self._times_s, at, times_s)
