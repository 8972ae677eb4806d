"""One page's way through a recording: play, pause, seek, slow motion; the file is read forward, in bounded memory."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events import EventBatch, empty_batch
from clsim.events.formats.filesource import EventSource
from clsim.live.view.commands import Control, Seek, Speed, Switch
from clsim.live.view.hub import Hub
from clsim.live.view.packets import NOISY, image_packet

TimedImages = Iterator[tuple[int, npt.NDArray[np.uint8]]]
"""Times [µs] and images ``[H, W, 3]``, red, green and blue."""

PERIOD_S = 1 / 60
PREROLL_US = 1_000_000
PREROLL_EVENTS = 1 << 19
SPEEDS = (0.001, 10.0)


class Playback:
    """Reads a recording for one page, in a thread of its own, and hands it to that page's hub.

    A seek backwards reopens the file and reads up to the place. ``on_error`` hears of a file that is damaged.
    """

    def __init__(
        self,
        open_source: Callable[[], EventSource],
        hub: Hub,
        on_error: Callable[[BaseException], None],
        read_frames: Callable[[], TimedImages] | None = None,
    ) -> None:
        """Start to play; ``read_frames`` begins to read the frames that were recorded along with the events."""
        self._open, self._hub, self._on_error = open_source, hub, on_error
        self._frames = None if read_frames is None else _Frames(read_frames)
        self._changed = threading.Condition()
        self._playing, self._loop = True, True
        self._speed = 1.0
        self._seek_us: int | None = None
        self._position_us = 0
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="clsim-view-playback", daemon=True)
        self._thread.start()

    def control(self, command: Control) -> None:
        """Do what the page asks; from any thread."""
        with self._changed:
            if isinstance(command, Seek):
                self._seek_us = command.time_us
            elif isinstance(command, Speed):
                self._speed = min(max(command.value, SPEEDS[0]), SPEEDS[1])
            elif isinstance(command, Switch) and command.name == "play":
                self._playing = command.on
            else:
                self._loop = command.on
            self._changed.notify_all()

    def status(self) -> dict[str, Any]:
        """Return what the page shows of its playback."""
        return {
            "playing": self._playing,
            "speed": self._speed,
            "loop": self._loop,
            "position_us": self._position_us,
        }

    def close(self) -> None:
        """End after the batch under way, without waiting for it."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()

    @property
    def alive(self) -> bool:
        """Whether the thread still runs."""
        return self._thread.is_alive()

    def join(self, timeout_s: float) -> None:
        """Wait for the end of the thread."""
        self._thread.join(timeout_s)

    def _run(self) -> None:
        try:
            self._play()
        except Exception as error:
            self._on_error(error)

    def _play(self) -> None:
        reader = _Reader(self._open)
        try:
            self._position_us = reader.begin_us
            last_s = time.monotonic()
            while True:
                with self._changed:
                    rested = not self._playing
                    self._changed.wait_for(lambda: self._closing or self._seek_us is not None or self._playing, 1.0)
                    if self._closing:
                        return
                    seek_us, self._seek_us = self._seek_us, None
                now_s = time.monotonic()
                if seek_us is not None:
                    reader = self._jump(reader, seek_us)
                    now_s = time.monotonic()  # what was read on the way was not played
                elif not rested:
                    self._advance(reader, int((now_s - last_s) * 1e6 * self._speed))
                    with self._changed:
                        self._changed.wait_for(lambda: self._closing or self._seek_us is not None, PERIOD_S)
                last_s = now_s
        finally:
            reader.close()

    def _advance(self, reader: _Reader, step_us: int) -> None:
        until_us = self._position_us + max(step_us, 1)
        for batch in reader.until(until_us):
            self._hub.offer(batch, int(batch["t"][-1]))
        if reader.ended:
            self._position_us = min(until_us, reader.last_us)
            with self._changed:
                if not self._loop:
                    self._playing = False
                elif self._seek_us is None:  # the user's own wish counts more
                    self._seek_us = reader.begin_us
        else:
            self._position_us = until_us
        self._hub.offer(empty_batch(0), self._position_us)
        self._show_frame()

    def _show_frame(self) -> None:
        """Show the last frame until now, unless the page has it."""
        frame = None if self._frames is None else self._frames.last_until(self._position_us)
        if frame is not None:
            self._hub.show(NOISY, image_packet(NOISY, np.ascontiguousarray(frame[1]), frame[0]))

    def _jump(self, reader: _Reader, target_us: int) -> _Reader:
        target_us = max(target_us, reader.begin_us)
        if target_us - PREROLL_US < reader.position_us:
            reader.close()
            reader = _Reader(self._open)
        recent: list[EventBatch] = []
        for until_us in (target_us - PREROLL_US, target_us):
            recent.clear()
            for batch in reader.until(until_us):
                recent.append(batch)
                while len(recent) > 1 and sum(map(len, recent[1:])) >= PREROLL_EVENTS:
                    recent.pop(0)
                if self._seek_us is not None or self._closing:  # the user has moved on
                    return reader
        self._position_us = min(target_us, reader.last_us) if reader.ended else target_us
        self._hub.seek(self._position_us)
        for batch in recent:
            self._hub.offer(batch[-PREROLL_EVENTS:], self._position_us)
        self._show_frame()
        return reader


class _Frames:
    """Recorded frames, read forward; to go back reopens them."""

    def __init__(self, read: Callable[[], TimedImages]) -> None:
        self._read = read
        self._begin()

    def _begin(self) -> None:
        self._rest = self._read()
        self._next = next(self._rest, None)
        self._shown_us = -1

    def last_until(self, time_us: int) -> tuple[int, npt.NDArray[np.uint8]] | None:
        """Return the last frame at or before a time, if it is another than was returned before."""
        if time_us < self._shown_us:
            self._begin()
        found = None
        while self._next is not None and self._next[0] <= time_us:
            found, self._next = self._next, next(self._rest, None)
        if found is not None:
            self._shown_us = found[0]
        return found


class _Reader:
    """A source that can be read up to a time."""

    def __init__(self, open_source: Callable[[], EventSource]) -> None:
        self._source = open_source()
        self._rest = next(self._source, None)
        if self._rest is None:
            raise InputError(f"{self._source.path}: holds no events; there is nothing to show")
        self.begin_us = self.position_us = int(self._rest["t"][0])
        self.last_us = self.begin_us
        """The end of what was read."""

    @property
    def ended(self) -> bool:
        return self._rest is None

    def until(self, time_us: int) -> Iterator[EventBatch]:
        """Yield the events before ``time_us``."""
        self.position_us = max(self.position_us, time_us)
        while self._rest is not None:
            cut = int(np.searchsorted(self._rest["t"], time_us))
            if cut:
                self.last_us = int(self._rest["t"][cut - 1])
                yield self._rest[:cut]
            if cut < len(self._rest):
                self._rest = self._rest[cut:]
                return
            self._rest = next(self._source, None)

    def close(self) -> None:
        self._source.close()
