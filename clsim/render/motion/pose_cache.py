"""Poses at instants that are asked for again and again."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from clsim.scene import Motion

_MOST = 1 << 15


class PoseCache:
    """Remembers poses: to find one takes as long as to trace many rays."""

    def __init__(self) -> None:
        """Know none."""
        self._known: dict[tuple[int, float], npt.NDArray[np.float64]] = {}
        self._held: dict[int, Motion] = {}

    def pose(self, motion: Motion, time_s: float) -> npt.NDArray[np.float64]:
        """Return the pose of a motion at a time; it is asked once."""
        key = id(motion), time_s
        found = self._known.get(key)
        if found is None:
            if len(self._known) >= _MOST:
                self._known.clear()
            # While it is held, nobody else has its number.
            self._held[id(motion)] = motion
            found = self._known[key] = motion.pose(time_s)
        return found

    def forget(self) -> None:
        """Know nothing any more: time has gone on."""
        self._known.clear()
