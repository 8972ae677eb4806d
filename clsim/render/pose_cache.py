"""What was found already about instants that are asked for again and again."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.scene import Motion

_MOST = 1 << 15


class PoseCache:
    """Remembers poses, and what was made of them: to find a pose takes as long as to trace many rays."""

    def __init__(self) -> None:
        """Know none."""
        self._known: dict[tuple[int, float], Any] = {}
        self._kept: dict[int, object] = {}

    def pose(self, motion: Motion, time_s: float) -> npt.NDArray[np.float64]:
        """Return the pose of a motion at a time."""
        found: npt.NDArray[np.float64] = self.recall(motion, time_s, motion.pose)
        return found

    def recall(self, whose: object, time_s: float, find: Callable[[float], Any]) -> Any:
        """Return what ``find`` tells of somebody at a time; it is asked once."""
        key = id(whose), time_s
        found = self._known.get(key)
        if found is None:
            if len(self._known) >= _MOST:
                self._known.clear()
            # While it is kept, nobody else has its number.
            self._kept[id(whose)] = whose
            found = self._known[key] = find(time_s)
        return found

    def forget(self) -> None:
        """Know nothing any more: time has gone on."""
        self._known.clear()
