"""From a source to a sink, in a thread: as fast as it comes, or by the clock."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Iterator

import numpy as np

from clsim.events import EventBatch, Sink

_PERIOD_S = 1 / 60


class Pump:
    """Writes all batches of a source to a sink, then closes the sink; ``wait`` raises what went wrong."""

    def __init__(self, batches: Iterable[tuple[EventBatch, int]], sink: Sink) -> None:
        """Start at once; each batch comes with the time [µs] until which it is complete."""
        self.now_us = 0
        self.events = 0
        self._stopping = threading.Event()
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, args=(batches, sink), name="clsim-pump", daemon=True)
        self._thread.start()

    def wait(self, timeout_s: float) -> bool:
        """Wait for the end; True when the source has ended."""
        self._thread.join(timeout_s)
        if self._thread.is_alive():
            return False
        if self._error is not None:
            raise self._error
        return True

    def stop(self, timeout_s: float = 0.5) -> None:
        """End after the batch under way; a source that waits for events is left to itself."""
        self._stopping.set()
        self._thread.join(timeout_s)

    def _run(self, batches: Iterable[tuple[EventBatch, int]], sink: Sink) -> None:
        try:
            for events, end_us in batches:
                if self._stopping.is_set():
                    return
                sink.write(events, end_us)
                self.now_us = end_us
                self.events += len(events)
        except BaseException as error:
            self._error = error
        finally:
            sink.close()


def as_they_come(batches: Iterable[EventBatch]) -> Iterator[tuple[EventBatch, int]]:
    """Yield batches, none of them empty, with the times [µs] of their last events."""
    for batch in batches:
        yield batch, int(batch["t"][-1])


def paced(batches: Iterable[EventBatch], speed: float = 1.0) -> Iterator[tuple[EventBatch, int]]:
    """Yield the same events in small batches, each when its time has come; ``speed`` 0.1 is ten times slower."""
    start_s, begin_us = time.monotonic(), None
    for batch in batches:
        rest = batch
        if begin_us is None and len(batch):
            begin_us = int(batch["t"][0])
        while len(rest):
            due_us = (begin_us or 0) + (time.monotonic() - start_s) * 1e6 * speed
            cut = int(np.searchsorted(rest["t"], due_us, side="right"))
            yield rest[:cut], int(due_us if cut < len(rest) else rest["t"][-1])
            rest = rest[cut:]
            if len(rest):
                time.sleep(_PERIOD_S)
