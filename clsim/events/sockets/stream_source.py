"""What sources that read from a socket share.

What arrives is not trusted: sizes are bounded before memory is spent on them, and what cannot be read ends in one
InputError.
"""

from __future__ import annotations

import abc
import contextlib
import socket
from types import TracebackType

from clsim.events.batch import EventBatch, gather


class SocketSource(abc.ABC):
    """Iterates over the batches of a live stream; ends when the sender ends it or ``close`` is called."""

    width: int
    height: int

    def __init__(self, connection: socket.socket) -> None:
        """Take over a socket."""
        self.dropped_events = 0
        """Number of events left out so far because they lie outside the sensor, or come too late (UDP alone)."""
        self._socket = connection
        self._closed = False

    def __iter__(self) -> SocketSource:
        """Return itself: a stream is read once."""
        return self

    @abc.abstractmethod
    def __next__(self) -> EventBatch:
        """Wait for the next batch that has events; raises InputError if what comes cannot be read."""

    def read(self) -> EventBatch:
        """Wait for the end and return all events as one array, empty where there were none."""
        with self:
            return gather(self)

    def close(self) -> None:
        """Hang up; may be called by another thread to end the iteration, and twice."""
        self._closed = True
        with contextlib.suppress(OSError):  # not connected any more, or never (UDP)
            self._socket.shutdown(socket.SHUT_RDWR)  # wakes a thread that waits for it
        self._socket.close()

    def __enter__(self) -> SocketSource:
        """Return itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Hang up."""
        self.close()
