"""A ring of frame slots between one producer and one consumer."""

from __future__ import annotations

import threading
from collections import deque
from typing import Literal

from clsim.errors import Error
from clsim.frames.frame import Frame, page_aligned

Policy = Literal["block", "drop-oldest"]
_PAGE_FLOATS = 1024


class RingClosed(Error):  # noqa: N818 - a normal end, not an error
    """The other side has ended; no more frames pass."""


class FrameRing:
    """Fixed slots in one page-aligned allocation; one producer thread, one consumer thread.

    The producer calls ``acquire`` → (fill) → ``publish``; the consumer ``take`` → (read) → ``release``. A slot belongs
    to exactly one side at a time, so frames are never copied. Policy ``block`` makes the producer wait for a free slot
    (nothing is lost); ``drop-oldest`` recycles the oldest frame nobody has taken yet, and counts it.

    Ending: ``close`` lets the consumer drain and then raises RingClosed there; ``abandon`` (consumer gone) raises
    RingClosed in the producer at once; ``fail`` hands an exception to the other side, whichever that is.
    """

    def __init__(self, slots: int, names: tuple[str, ...], height: int, width: int, policy: Policy = "block") -> None:
        """Allocate ``slots`` frames of ``len(names)`` planes ``[C, height, width]`` (at least 2; 3 to drop)."""
        minimum = 3 if policy == "drop-oldest" else 2
        if slots < minimum:
            raise ValueError(f"a {policy} ring needs at least {minimum} slots, got {slots}")
        floats = len(names) * height * width
        stride = -(-floats // _PAGE_FLOATS) * _PAGE_FLOATS
        memory = page_aligned((slots, stride))
        self._frames = [Frame(memory[i, :floats].reshape(len(names), height, width), names) for i in range(slots)]
        self.policy: Policy = policy
        self.dropped = 0
        self._free: deque[int] = deque(range(slots))
        self._ready: deque[int] = deque()
        self._writing: int | None = None
        self._reading: int | None = None
        self._closed = False
        self._abandoned = False
        self._error: BaseException | None = None
        self._changed = threading.Condition()

    @property
    def slots(self) -> int:
        """Number of slots."""
        return len(self._frames)

    @property
    def fill(self) -> int:
        """Number of frames that wait for the consumer."""
        return len(self._ready)

    @property
    def frames(self) -> list[Frame]:
        """All slots, for a device that wants to register their memory once."""
        return list(self._frames)

    def acquire(self) -> Frame:
        """Return a slot to fill (producer). Waits under ``block``; raises RingClosed once the consumer is gone."""
        with self._changed:
            if self._writing is not None:
                raise RuntimeError("the producer must publish its slot before it acquires another")
            while True:
                self._raise_if_over(self._abandoned or self._closed)
                if self._free:
                    self._writing = self._free.popleft()
                    break
                if self.policy == "drop-oldest" and self._ready:
                    self._writing = self._ready.popleft()
                    self.dropped += 1
                    break
                self._changed.wait()
            return self._frames[self._writing]

    def publish(self) -> None:
        """Hand the acquired slot to the consumer (producer)."""
        with self._changed:
            if self._writing is None:
                raise RuntimeError("nothing was acquired")
            self._ready.append(self._writing)
            self._writing = None
            self._changed.notify_all()

    def take(self, timeout_s: float | None = None) -> Frame | None:
        """Return the oldest frame (consumer); None after ``timeout_s``; raises RingClosed when drained and closed."""
        with self._changed:
            if self._reading is not None:
                raise RuntimeError("the consumer must release its frame before it takes another")
            while not self._ready:
                self._raise_if_over(self._closed or self._abandoned)
                if not self._changed.wait(timeout_s):
                    return None
            self._raise_if_over(self._abandoned)
            self._reading = self._ready.popleft()
            return self._frames[self._reading]

    def release(self) -> None:
        """Give the taken frame's slot back (consumer)."""
        with self._changed:
            if self._reading is None:
                raise RuntimeError("nothing was taken")
            self._free.append(self._reading)
            self._reading = None
            self._changed.notify_all()

    def close(self) -> None:
        """End the sequence (producer): the consumer still gets every published frame."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def abandon(self) -> None:
        """Stop at once (either side, or an interrupt): both sides get RingClosed, waiting frames are discarded."""
        with self._changed:
            self._abandoned = True
            self._changed.notify_all()

    def fail(self, error: BaseException) -> None:
        """Raise ``error`` on the other side at its next call."""
        with self._changed:
            self._error = self._error or error
            self._abandoned = True
            self._changed.notify_all()

    def _raise_if_over(self, over: bool) -> None:
        if self._error is not None:
            raise self._error
        if over:
            raise RingClosed
