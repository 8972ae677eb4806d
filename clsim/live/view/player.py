"""A recording in the page: each tab plays it for itself, and all see the rate of the whole."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from clsim.errors import InputError
from clsim.events import EventBatch
from clsim.events.formats.filesource import EventSource
from clsim.live.view.hub import Hub
from clsim.live.view.playback import Playback, TimedImages
from clsim.live.view.server import PageServer

OVERVIEW_BINS = 512


class Player:
    """Plays what ``open_source`` opens into a page, to each of its tabs for itself.

    ``wait`` raises what went wrong while reading.
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
        read_frames: Callable[[], TimedImages] | None = None,
        kinds: Mapping[str, Sequence[str]] | None = None,
        colours: str | None = None,
        frames_are: str = "",
    ) -> None:
        """Start the server; ``read_frames`` begins to read the frames that were recorded along, if there are any.

        What these are, the page says below them.
        ``kinds`` are the names of what the field ``cause`` of events tells, "causes" or "filters"; ``colours`` is the
        map with which the page begins, None that of last time.

        Raises:
            InputError: aiohttp is missing, or the port cannot be used.
        """
        self._open, self._read_frames = open_source, read_frames
        self._changed = threading.Condition()
        self._closing = False
        self._error: BaseException | None = None
        self._playbacks: list[Playback] = []
        hello: dict[str, Any] = {"title": title, "width": width, "height": height, "live": False, "frames": frames_are}
        hello |= kinds or {}
        hello |= {} if colours is None else {"colours": colours}
        self._server = PageServer(hello, self._status, host, port, play=self._play)
        self.url, self.warning = self._server.url, self._server.warning
        self._overview = Overview()
        self._surveyor = threading.Thread(target=self._survey, name="clsim-view-overview", daemon=True)
        self._surveyor.start()

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
        self._surveyor.join(1.0)
        for playback in self._playbacks:
            playback.join(1.0)

    def _status(self) -> dict[str, Any]:
        return {"error": None if self._error is None else str(self._error)}

    def _play(self, hub: Hub) -> Playback:
        self._playbacks = [playback for playback in self._playbacks if playback.alive]
        self._playbacks.append(Playback(self._open, hub, self._fail, self._read_frames))
        return self._playbacks[-1]

    def _fail(self, error: BaseException) -> None:
        with self._changed:
            self._error = self._error or error
            self._changed.notify_all()

    def _survey(self) -> None:
        """Read the whole file once, for the plot of its rate."""
        try:
            with self._open() as source:
                told_s = 0.0
                for batch in source:
                    self._overview.add(batch)
                    if self._closing:
                        return
                    if time.monotonic() - told_s > 0.5:
                        told_s = time.monotonic()
                        self._tell_overview()
        except Exception as error:
            self._fail(error)
            return
        if self._overview.begin_us is None:
            self._fail(InputError(f"{source.path}: holds no events; there is nothing to show"))
            return
        self._overview.complete = True
        self._tell_overview()

    def _tell_overview(self) -> None:
        self._server.tell("overview", json.dumps({"type": "overview"} | self._overview.as_dict()))


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
