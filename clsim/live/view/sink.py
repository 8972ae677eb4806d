"""The page as a sink of events and a watcher of frames."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from clsim.events import CAUSES, Causes, EventBatch, Labels, Objects, with_causes
from clsim.frames import TRUTH_PLANES, Frame, plane_of
from clsim.frames.frame import FloatArray
from clsim.frames.planes import RADIANCE
from clsim.frames.tonemap import ToneMap, brightness_image
from clsim.live.view import FRAME_PERIOD_S
from clsim.live.view.packets import DENOISED, DEPTH, FLOW, IDS, NOISY, image_packet
from clsim.live.view.server import PageServer
from clsim.live.view.truth_pictures import RGB, DepthPicture, FlowPicture, ids_picture
from clsim.truth.cut import cut

_LARGEST_FRAME_PX = 640
_SHOWN = ("depth", "flow", "ids")
"""What of truth is shown."""


class ViewSink:
    """Shows events, and on demand the newest frame, in every browser that opens ``url``; never waits for one.

    ``status`` may be set to a function whose numbers the page shows beside its own.
    """

    def __init__(
        self,
        title: str,
        width: int,
        height: int,
        *,
        host: str = "127.0.0.1",
        port: int | None = None,
        listener: socket.socket | None = None,
        truth_every: int = 0,
        causes: bool = False,
    ) -> None:
        """Start a PageServer, which takes the same; raises InputError if aiohttp is missing or the port is taken.

        ``truth_every`` tells which frames have truth: those whose number it divides; 0 where none has.
        ``causes`` lets the page colour events by what caused them.
        """
        self.status: Callable[[], dict[str, Any]] = dict
        self.labelled: Labels = ("cause",) if causes else ()
        hello: dict[str, Any] = {"title": title, "width": width, "height": height, "live": True, "frames": "rendered"}
        hello |= {"causes": CAUSES} if causes else {}
        self._server = PageServer(hello, lambda: self.status(), host, port, listener)
        self.url, self.warning = self._server.url, self._server.warning
        self._now_us = 0
        self._next_frame_s = 0.0
        self._truth_every = truth_every
        self._frames = _FrameWorker(self._server)

    @property
    def clients(self) -> int:
        """Number of browsers that watch."""
        return len(self._server.hub.watchers)

    @property
    def dropped_events(self) -> int:
        """Events that browsers were too slow for."""
        return self._server.hub.dropped_events

    def report(self) -> dict[str, float]:
        """Return how many browsers watch, and how many events they were too slow for."""
        return {"clients": self.clients, "dropped_events": self.dropped_events}

    def write(
        self, events: EventBatch, end_us: int, causes: Causes | None = None, objects: Objects | None = None
    ) -> None:
        """Take the events until ``end_us``, the page's clock; see Labelling.write."""
        self._now_us = max(self._now_us, end_us)
        if self.labelled:
            events = with_causes(events, causes)
        self._server.hub.offer(events, self._now_us)

    def wants_frame(self) -> bool:
        """Tell whether somebody watches frames and the last one is long enough ago."""
        return time.monotonic() >= self._next_frame_s and any(
            watcher.wants_frames for watcher in tuple(self._server.hub.watchers)
        )

    def show_frame(self, frame: Frame, level: FloatArray | None) -> None:
        """Take a copy of the frame's radiance and truth, and of the detector's log brightness ``[H, W]``."""
        self._next_frame_s = time.monotonic() + FRAME_PERIOD_S
        self._now_us = max(self._now_us, frame.time_us)
        step = -(-max(frame.width, frame.height) // _LARGEST_FRAME_PX)
        first = frame.names.index(RADIANCE[0])
        radiance = np.moveaxis(frame.planes[first : first + 3, ::step, ::step], 0, 2).copy()
        truth = {}
        if self._truth_every and frame.index % self._truth_every == 0:
            known = cut(frame, [name for name in _SHOWN if plane_of(TRUTH_PLANES[name][0]).channels[0] in frame.names])
            truth = {name: plane[::step, ::step].copy() for name, plane in known.items()}
        self._frames.give(frame.time_us, radiance, None if level is None else level[::step, ::step].copy(), truth)

    def close(self) -> None:
        """Tell the pages that the stream has ended, and stop serving."""
        self._frames.close()
        self._server.close()


class _FrameWorker:
    """Maps the newest frame to 8 bits in a thread of its own, so that the detector need not wait for it."""

    def __init__(self, server: PageServer) -> None:
        self._server = server
        self._maps = {NOISY: ToneMap(), DENOISED: ToneMap()}
        self._depth_picture, self._flow_picture = DepthPicture(), FlowPicture()
        self._given = threading.Condition()
        self._newest: tuple[int, FloatArray, FloatArray | None, Mapping[str, FloatArray]] | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="clsim-view-frames", daemon=True)
        self._thread.start()

    def give(
        self, time_us: int, radiance: FloatArray, level: FloatArray | None, truth: Mapping[str, FloatArray]
    ) -> None:
        with self._given:
            self._newest = (time_us, radiance, level, truth)
            self._given.notify()

    def close(self) -> None:
        with self._given:
            self._closed = True
            self._given.notify()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._given:
                self._given.wait_for(lambda: self._newest is not None or self._closed)
                if self._newest is None:
                    return
                (time_us, radiance, level, truth), self._newest = self._newest, None
            images = {NOISY: radiance}
            if level is not None:
                images[DENOISED] = brightness_image(level)
            pictures = {kind: self._maps[kind](linear) for kind, linear in images.items()}
            for kind, picture in (pictures | self._truth_pictures(truth)).items():
                self._server.hub.show(kind, image_packet(kind, picture, time_us))

    def _truth_pictures(self, truth: Mapping[str, FloatArray]) -> dict[int, RGB]:
        """Return pictures of what there is, by their kinds."""
        found = {}
        if "depth" in truth:
            found[DEPTH] = self._depth_picture(truth["depth"])
        if "flow" in truth:
            flow = truth["flow"]
            found[FLOW] = self._flow_picture(flow[..., :2], flow[..., 2], flow[..., 3])
        if "object" in truth:
            found[IDS] = ids_picture(truth["object"])
        return found
