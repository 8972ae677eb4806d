"""A meter of how busy two threads keep the machine."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class BusyMeter:
    """Measures how long a frame keeps the machine busy, where one thread renders and another detects.

    Both use all cores. So where they share them, and each is the slower for the other, what a frame takes is the time
    in which at least one is at work: the sum of both walls where they take turns, the longer one where they overlap,
    and never the waiting of one for the other. With cores of their own, on a GPU say, it is the longer wall.
    """

    def __init__(self, *, share_cores: bool = True, clock: Callable[[], float] = time.perf_counter) -> None:
        """Prepare; ``clock`` returns seconds."""
        self._share_cores, self._clock = share_cores, clock
        self._lock = threading.Lock()
        self._since: dict[str, float] = {}
        self._any_since = 0.0
        self._any_s = 0.0
        self._side_s: dict[str, float] = {}

    @contextmanager
    def busy(self, side: str) -> Iterator[None]:
        """Count the time within as time in which ``side`` is at work; each side is one thread."""
        with self._lock:
            now = self._clock()
            if not self._since:
                self._any_since = now
            self._since[side] = now
        try:
            yield
        finally:
            with self._lock:
                now = self._clock()
                self._side_s[side] = self._side_s.get(side, 0.0) + now - self._since.pop(side)
                if not self._since:
                    self._any_s += now - self._any_since

    def lap(self) -> float:
        """Return the busy time [s] since the last lap, work that still goes on included."""
        with self._lock:
            now = self._clock()
            for side, since in self._since.items():
                self._side_s[side] = self._side_s.get(side, 0.0) + now - since
                self._since[side] = now
            if self._since:
                self._any_s += now - self._any_since
                self._any_since = now
            busy_s = self._any_s if self._share_cores else max(self._side_s.values(), default=0.0)
            self._any_s = 0.0
            self._side_s.clear()
            return busy_s
