"""Plays a recording to the page: play, pause, seek, slow motion; the file is read forward, in bounded memory."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from clsim.errors import InputError
from clsim.events import EventBatch, empty_batch
from clsim.events.filesource import EventSource
from clsim.live.view.server import PageServer

PERIOD_S = 1 / 60
PREROLL_US = 1_000_000
PREROLL_EVENTS = 1 << 19
SPEEDS = (0.001, 10.0)
OVERVIEW_BINS = 512


class Player:
    """Plays what ``open_source`` opens into a page; a seek backwards opens it anew and reads up to the place.

    Starts when the first browser joins. ``wait`` raises what went wrong while reading.
    """

    def __init__(
        self,
        open_source: Callable[[], EventSource],
        title: str,
        width: int,
        height: int,
        *,
        host: str = "127.0.0.1",
        port: int | None = None,
    ) -> None:
        """Start the server; raises InputError if aiohttp is missing or the port cannot be used."""
        self._open = open_source
        self._changed = threading.Condition()
        self._playing, self._joined, self._loop = True, False, True
        self._speed = 1.0
        self._seek_us: int | None = None
        self._position_us = 0
        self._closing = False
        self._error: BaseException | None = None
        hello = {"title": title, "width": width, "height": height, "live": False}
        self._server = PageServer(hello, self._status, self._command, host, port)
        self.url, self.warning = self._server.url, self._server.warning
        self._overview = Overview()
        self._threads = [
            threading.Thread(target=self._guard, args=(run,), name=f"clsim-view-{name}", daemon=True)
            for name, run in (("player", self._play), ("overview", self._survey))
        ]
        for thread in self._threads:
            thread.start()

    def wait(self, timeout_s: float) -> None:
        """Wait a while; raises the InputError of a damaged file."""
        with self._changed:
            self._changed.wait_for(lambda: self._error is not None or self._closing, timeout_s)
        if self._error is not None:
            raise self._error

    def close(self) -> None:
        """Stop serving."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._server.close()
        for thread in self._threads:
            thread.join(1.0)

    def _status(self) -> dict[str, Any]:
        return {
            "playing": self._playing,
            "speed": self._speed,
            "loop": self._loop,
            "position_us": self._position_us,
            "dropped_events": self._server.hub.dropped_events,
            "error": None if self._error is None else str(self._error),
        }

    def _command(self, command: dict[str, Any]) -> None:
        name = command["command"]
        with self._changed:
            if name == "joined":
                if self._joined:
                    self._seek_us = self._position_us  # so that the newcomer sees what the others see
                self._joined = True
                self._tell_overview()
            elif name == "play":
                self._playing = bool(command["value"])
            elif name == "loop":
                self._loop = bool(command["value"])
            elif name == "speed":
                self._speed = min(max(float(command["value"]), SPEEDS[0]), SPEEDS[1])
            elif name == "seek":
                self._seek_us = int(command["value"])
            self._changed.notify_all()

    def _guard(self, run: Callable[[], None]) -> None:
        try:
            run()
        except Exception as error:
            with self._changed:
                self._error = self._error or error
                self._changed.notify_all()

    def _play(self) -> None:
        reader = _Reader(self._open)
        try:
            self._position_us = reader.begin_us
            last_s = time.monotonic()
            while True:
                with self._changed:
                    idle = self._changed.wait_for(
                        lambda: self._closing or self._seek_us is not None or (self._joined and self._playing), 1.0
                    )
                    if self._closing:
                        return
                    seek_us, self._seek_us = self._seek_us, None
                if not idle or seek_us is not None:
                    last_s = time.monotonic()
                if seek_us is not None:
                    reader = self._jump(reader, seek_us)
                elif idle:
                    now_s = time.monotonic()
                    self._advance(reader, int((now_s - last_s) * 1e6 * self._speed))
                    last_s = now_s
                    with self._changed:
                        self._changed.wait_for(lambda: self._closing or self._seek_us is not None, PERIOD_S)
        finally:
            reader.close()

    def _advance(self, reader: _Reader, step_us: int) -> None:
        until_us = self._position_us + max(step_us, 1)
        for batch in reader.until(until_us):
            self._server.hub.offer(batch, int(batch["t"][-1]))
        if reader.ended:
            self._position_us = min(until_us, reader.last_us)
            if self._loop:
                self._seek_us = reader.begin_us
            else:
                self._playing = False
        else:
            self._position_us = until_us
        self._server.hub.offer(empty_batch(0), self._position_us)

    def _jump(self, reader: _Reader, target_us: int) -> _Reader:
        target_us = max(target_us, reader.begin_us)
        if target_us - PREROLL_US < reader.position_us:
            reader.close()
            reader = _Reader(self._open)
        recent: list[EventBatch] = []
        reader.skip(target_us - PREROLL_US)
        for batch in reader.until(target_us):
            recent.append(batch)
            while len(recent) > 1 and sum(map(len, recent[1:])) >= PREROLL_EVENTS:
                recent.pop(0)
            if self._seek_us is not None or self._closing:  # the user has moved on
                return reader
        self._position_us = min(target_us, reader.last_us) if reader.ended else target_us
        self._server.hub.seek(self._position_us)
        for batch in recent:
            self._server.hub.offer(batch[-PREROLL_EVENTS:], self._position_us)
        return reader

    def _survey(self) -> None:
        """Read the whole file once, for the plot of its rate."""
        with self._open() as source:
            told_s = 0.0
            for batch in source:
                self._overview.add(batch)
                if self._closing:
                    return
                if time.monotonic() - told_s > 0.5:
                    told_s = time.monotonic()
                    self._tell_overview()
        self._overview.complete = True
        self._tell_overview()

    def _tell_overview(self) -> None:
        self._server.hub.tell("overview", json.dumps({"type": "overview"} | self._overview.as_dict()))


class Overview:
    """Counts of ON and OFF events over a whole recording, in at most 512 bins that widen as it goes on."""

    def __init__(self) -> None:
        """Count nothing yet."""
        self.complete = False
        self.begin_us: int | None = None
        self.end_us = 0
        self.bin_us = 1000
        self._lock = threading.Lock()
        self._counts = np.zeros((2, OVERVIEW_BINS), dtype=np.int64)

    def add(self, batch: EventBatch) -> None:
        """Count a batch that lies after all before."""
        with self._lock:
            if self.begin_us is None:
                self.begin_us = int(batch["t"][0])
            self.end_us = int(batch["t"][-1])
            while self.end_us - self.begin_us >= self.bin_us * OVERVIEW_BINS:
                self._counts[:, : OVERVIEW_BINS // 2] = self._counts.reshape(2, -1, 2).sum(axis=2)
                self._counts[:, OVERVIEW_BINS // 2 :] = 0
                self.bin_us *= 2
            bins = (batch["t"] - self.begin_us) // self.bin_us
            for row, chosen in enumerate((bins[batch["on"]], bins[~batch["on"]])):
                self._counts[row] += np.bincount(chosen, minlength=OVERVIEW_BINS)

    def as_dict(self) -> dict[str, Any]:
        """Return begin, end, width of a bin and the counts of the bins in use."""
        with self._lock:
            begin_us = self.begin_us or 0
            used = (self.end_us - begin_us) // self.bin_us + 1 if self.begin_us is not None else 0
            return {
                "complete": self.complete,
                "begin_us": begin_us,
                "end_us": self.end_us,
                "bin_us": self.bin_us,
                "on": self._counts[0, :used].tolist(),
                "off": self._counts[1, :used].tolist(),
            }


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

    def until(self, time_us: int) -> Any:
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

    def skip(self, time_us: int) -> None:
        """Read over the events before ``time_us``."""
        for _ in self.until(time_us):
            pass

    def close(self) -> None:
        self._source.close()
