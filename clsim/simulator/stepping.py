"""The step clock: when the frames of a driven simulator are, and when a step may return."""

from __future__ import annotations

import math
import time
from typing import Literal

from clsim.frames import frame_time_us

Clock = Literal["frames", "wall", "caller"]


class StepClock:
    """Tells the times of a step's frames, and waits for the wall clock where a step shall.

    Attributes:
        kind: who says when frames are.
        lag_s: by how much the last step ended late [s].
    """

    def __init__(self, kind: Clock, fps: float) -> None:
        """Prepare; see `clsim.Simulator` for the kinds."""
        self.kind, self._fps = kind, fps
        self.restart()

    def restart(self) -> None:
        """Let the wall clock start with the next step."""
        self.lag_s = 0.0
        self._started_s: float | None = None

    def frame_times(self, following: int, passed_us: int, until_us: int) -> list[int]:
        """Return the times of the frames of a step [µs].

        Args:
            following: number of the next frame.
            passed_us: time of the frame before, or 0.
            until_us: when the step ends.
        """
        if self.kind != "caller":
            last = following
            while frame_time_us(last, self._fps) <= until_us:
                last += 1
            return [frame_time_us(index, self._fps) for index in range(following, last)]
        first = [0] if following == 0 else []
        length_us = until_us - passed_us
        # A step of a millionth of a frame ends with one, too.
        parts = max(math.ceil(length_us * self._fps / 1e6 - 1e-6), min(length_us, 1))
        return first + [passed_us + round(length_us * (k + 1) / parts) for k in range(parts)]

    def wait_for(self, until_us: int) -> None:
        """Wait until the end of a step has come, where the wall clock counts; the first step's is now."""
        if self.kind != "wall":
            return
        now_s = time.perf_counter()
        if self._started_s is None:
            self._started_s = now_s - until_us * 1e-6
        early_s = self._started_s + until_us * 1e-6 - now_s
        self.lag_s = max(0.0, -early_s)
        time.sleep(max(0.0, early_s))
