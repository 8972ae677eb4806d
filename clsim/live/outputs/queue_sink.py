"""A sink that hands batches to another thread."""

from __future__ import annotations

import queue
import threading

from clsim.events import EventBatch


class QueueSink:
    """Keeps up to ``capacity`` batches for ``get``; the writer waits while it is full, until ``close``."""

    def __init__(self, capacity: int) -> None:
        """Make an empty queue."""
        self._batches: queue.Queue[tuple[EventBatch, int]] = queue.Queue(capacity)
        self._closed = threading.Event()

    def write(self, events: EventBatch, end_us: int) -> None:
        """Append a copy of the events, waiting for room."""
        taken = events.copy(), end_us
        while not self._closed.is_set():
            try:
                self._batches.put(taken, timeout=0.05)
                return
            except queue.Full:
                continue

    def get(self, timeout_s: float) -> tuple[EventBatch, int] | None:
        """Return the oldest events and until when they are all [µs], or None after ``timeout_s``."""
        try:
            return self._batches.get(timeout=timeout_s) if timeout_s > 0 else self._batches.get_nowait()
        except queue.Empty:
            return None

    def close(self) -> None:
        """Stop taking batches; those that wait can still be read."""
        self._closed.set()
