"""From frames and their events to a layout: cuts out what is wanted, and adds poses and inertial samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.events import Causes, EventBatch
from clsim.frames import RADIANCE, Frame
from clsim.truth.cut import channels_of, cut
from clsim.truth.labels import Labeller
from clsim.truth.motions import Motions
from clsim.truth.record import About, Layout, Shot
from clsim.truth.writing.images import Pictures


@dataclass(frozen=True)
class Plan:
    """What is recorded, and when.

    Attributes:
        about: what holds for the whole run.
        every: rendered frames from one frame of truth to the next.
        time_of: the time of a rendered frame [µs].
        motions: what moves; recorders of one plan share what they find of it.
    """

    about: About
    every: int
    time_of: Callable[[int], int]
    motions: Motions


class TruthRecorder:
    """A sink that hands events to a layout, with all that is wanted beside them."""

    def __init__(self, plan: Plan, layout: Layout) -> None:
        """Record into ``layout``, which is closed with the recorder."""
        self.planes = (*RADIANCE, *channels_of(plan.about.names))
        self.recorded_frames = 0
        self._plan, self._layout = plan, layout
        self._event_count = 0
        self._pictures = Pictures()
        self._labeller = Labeller() if "labels" in plan.about.names else None
        self._end_us = 0
        self._motions_us = -1
        self._closed = False

    def report(self) -> dict[str, float]:
        """Return the number of frames recorded."""
        return {"recorded_frames": self.recorded_frames}

    def record(self, frame: Frame, events: EventBatch, causes: Causes | None = None) -> None:
        """Take the events of a step and what caused each, what moved within it, and the frame that it led to."""
        before = self._event_count + int(np.searchsorted(events["t"], frame.time_us))
        self.write(events, frame.time_us)
        if self._labeller is not None:
            self._layout.labels(self._labeller.label(frame, events, causes))
        self._end_us = frame.time_us
        plan = self._plan
        if frame.index % plan.every == 0:
            self._record_motions(frame.time_us)
            last, following = (plan.time_of(frame.index + way * plan.every) for way in (-1, 1))
            self._layout.shot(Shot(frame.time_us, last, following, before, self._planes(frame)))
            self.recorded_frames += 1

    def write(self, events: EventBatch, end_us: int) -> None:
        """Write events alone; see Sink.write."""
        self._layout.events(events, end_us)
        self._event_count += len(events)

    def close(self) -> None:
        """Complete the layout; see Sink.close."""
        try:
            if not self._closed:
                self._closed = True
                self._record_motions(self._end_us)
        finally:
            self._layout.close()

    def _planes(self, frame: Frame) -> dict[str, npt.NDArray[Any]]:
        names = self._plan.about.names
        found: dict[str, npt.NDArray[Any]] = dict(cut(frame, names))
        picture = self._pictures.of(cut(frame, ("intensity",))) if "image" in names else None
        if picture is not None:
            found["image"] = picture
        return found

    def _record_motions(self, end_us: int) -> None:
        if end_us <= self._motions_us:
            return
        self._motions_us = end_us
        tracks, samples = self._plan.motions.until(end_us)
        for chunk in tracks:
            self._layout.track(chunk)
        if samples is not None:
            self._layout.imu(samples)
