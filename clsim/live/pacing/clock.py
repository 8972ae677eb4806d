"""The frame clock: when the frames of a run are due, and how late they are."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from clsim.live.pacing.schedule import Schedule


class FrameClock:
    """Makes a producer of frames keep to the wall clock.

    Attributes:
        lag_s: how late the latest frame was begun [s].
        late_frames: frames begun more than a frame's time after they were due; a sensor that never waits loses them.
        skipped: frames left out because others were due.
    """

    def __init__(self, schedule: Schedule, *, may_skip: bool, clock: Callable[[], float] = time.perf_counter) -> None:
        """Prepare; the clock stands still until `start`. ``clock`` returns seconds."""
        self._now_s = clock
        self.lag_s = 0.0
        self.late_frames = self.skipped = 0
        self._schedule, self._may_skip = schedule, may_skip
        self._started_s: float | None = None

    def start(self, index: int) -> None:
        """Let the clock run from now, when frame ``index`` is due."""
        self._started_s = self._now_s() - self._schedule.time_us(index) * 1e-6

    def wait_for(self, index: int, stopping: threading.Event) -> int:
        """Wait until frame ``index`` is due; if it is long past and frames may be lost, return the one due now."""
        if self._started_s is None:
            self.start(index)
        assert self._started_s is not None, "the clock runs"
        elapsed_s = self._now_s() - self._started_s
        due_now = int(elapsed_s * self._schedule.fps)
        if due_now > index and self._may_skip:
            if self._schedule.total is not None:
                due_now = min(due_now, self._schedule.total - 1)
            self.skipped += due_now - index
            index = due_now
        elif due_now > index:
            self.late_frames += 1
        early_s = self._schedule.time_us(index) * 1e-6 - elapsed_s
        self.lag_s = max(0.0, -early_s)
        stopping.wait(max(0.0, early_s))
        return index
