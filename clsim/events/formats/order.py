"""One rule for events out of order, whatever the format: what is a little late is put in its place, the rest left out.

Cameras and their drivers send packets that overlap, repeat and slip, and now and then a time that is wrong altogether.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events.batch import EventBatch

WINDOW_US = 100_000
"""An event that comes up to so long after a later one is put in its place."""
_MOST_HELD = 1 << 19
"""Events that wait for earlier ones, at most: of fast cameras the window is shorter."""
_BLOCK = 1 << 13
"""Small batches are looked at together, so that one wrong time is told from many right ones."""


class Order:
    """Passes batches on in the order of time.

    Where a time contradicts others by more than the window, the fewer are left out: a single time far ahead goes, and
    not all that follows it.

    Attributes:
        moved_events: those that came after a later one and were put in their place.
        late_events: those that were left out.
    """

    def __init__(self, path: Path, *, strict: bool = False) -> None:
        """Prepare for the batches of a file; ``strict`` refuses the first event that is out of order."""
        self.moved_events = self.late_events = 0
        self._path, self._strict = path, strict
        self._held: deque[EventBatch] = deque()
        self._count = self._held_count = 0
        self._out_us: int | None = None

    def of(self, batches: Iterable[EventBatch]) -> Iterator[EventBatch]:
        """Yield the events of batches, in other batches, sorted by time; equal times stay as they came.

        What the batches raise comes after the events that came before it.
        """
        failure: BaseException | None = None
        blocks = _blocks(batches)
        while True:
            try:
                block = next(blocks, None)
            except (KeyboardInterrupt, SystemExit, MemoryError):
                raise
            except BaseException as error:  # libraries made with pyo3 raise such
                failure, block = error, None
            if block is None:
                break
            self._take(block)
            last_us = self._last_us or 0
            while self._held and (
                int(self._held[0]["t"][-1]) <= last_us - WINDOW_US or self._held_count - len(self._held[0]) > _MOST_HELD
            ):
                yield self._release()
        while self._held:
            yield self._release()
        if failure is not None:
            raise failure

    @property
    def _last_us(self) -> int | None:
        return int(self._held[-1]["t"][-1]) if self._held else self._out_us

    def _release(self) -> EventBatch:
        batch = self._held.popleft()
        self._held_count -= len(batch)
        self._out_us = int(batch["t"][-1])
        return batch

    def _hold(self, batch: EventBatch) -> None:
        self._held.append(batch)
        self._held_count += len(batch)

    def _take(self, batch: EventBatch) -> None:
        t, last_us = batch["t"], self._last_us
        falls = t[1:] < t[:-1]
        if (last_us is None or int(t[0]) >= last_us) and not falls.any():
            self._hold(batch)
        elif self._strict:
            at = 0 if last_us is not None and int(t[0]) < last_us else int(np.argmax(falls)) + 1
            raise InputError(
                f"{self._path}: event {self._count + at} has time {t[at]} µs, before "
                f"{last_us if at == 0 else t[at - 1]} µs; expected rising times"
            )
        else:
            self._merge(batch)
        self._count += len(batch)

    def _merge(self, batch: EventBatch) -> None:
        parts = [batch]
        earliest_us = int(batch["t"].min())
        while self._held and int(self._held[-1]["t"][-1]) > earliest_us:
            parts.insert(0, self._held.pop())
            self._held_count -= len(parts[0])
        events = np.concatenate(parts)
        gone = self._contradicting(events["t"])
        self.late_events += int(np.count_nonzero(gone))
        events = events[~gone] if gone.any() else events
        t = events["t"]
        self.moved_events += int(np.count_nonzero(t < np.maximum.accumulate(t))) if len(t) else 0
        events = events[np.argsort(t, kind="stable")]
        for start in range(0, len(events), _BLOCK):  # short ones, so that the next merge is about few
            self._hold(events[start : start + _BLOCK])

    def _contradicting(self, t: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
        """Tell which events go: those far behind others, or those far ahead, whichever are fewer."""
        passed = t < (t.min() if self._out_us is None else self._out_us)
        behind = passed | (t < np.maximum.accumulate(t) - WINDOW_US)
        ahead = passed | (t > np.minimum.accumulate(t[::-1])[::-1] + WINDOW_US)
        return behind if np.count_nonzero(behind) <= np.count_nonzero(ahead) else ahead


def _blocks(batches: Iterable[EventBatch]) -> Iterator[EventBatch]:
    """Yield batches that have events, small ones joined."""
    small: list[EventBatch] = []
    count = 0
    try:
        for batch in batches:
            if not len(batch):
                continue
            small.append(batch)
            count += len(batch)
            if count >= _BLOCK:
                yield small[0] if len(small) == 1 else np.concatenate(small)
                small, count = [], 0
    except (KeyboardInterrupt, SystemExit, GeneratorExit, MemoryError):
        raise
    except BaseException:
        if small:
            yield np.concatenate(small)
        raise
    if small:
        yield np.concatenate(small)
