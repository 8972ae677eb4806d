"""From frames and their events to a layout: cuts out what is wanted, and adds poses and inertial samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.events import EventBatch
from clsim.frames import RADIANCE, Frame
from clsim.scene import Motion
from clsim.truth.cut import cut
from clsim.truth.images import Pictures
from clsim.truth.kinematics import Imu, track
from clsim.truth.record import About, Layout, Shot, Times


@dataclass(frozen=True)
class Plan:
    """What is recorded, and when.

    Attributes:
        about: what holds for the whole run.
        every: rendered frames from one frame of truth to the next.
        time_of: the time of a rendered frame [µs].
        camera: how it moves.
        moving: name and motion of each object that moves.
        pose_rate: poses a second.
        seed: of the inertial sensor's noise.
    """

    about: About
    every: int
    time_of: Callable[[int], int]
    camera: Motion
    moving: tuple[tuple[str, Motion], ...]
    pose_rate: float
    seed: int


class TruthRecorder:
    """A sink that hands events to a layout, with all that is wanted beside them."""

    planes = RADIANCE

    def __init__(self, plan: Plan, layout: Layout) -> None:
        """Record into ``layout``, which is closed with the recorder."""
        self.recorded_frames = 0
        self._plan, self._layout = plan, layout
        self._event_count = 0
        self._pictures = Pictures()
        self._pose_count = 0
        about = plan.about
        self._imu = None
        if "imu" in about.names:
            self._imu = Imu(plan.camera, about.imu_rate, about.imu_noise, about.gravity, plan.seed)

    def report(self) -> dict[str, float]:
        """Return the number of frames recorded."""
        return {"recorded_frames": self.recorded_frames}

    def record(self, frame: Frame, events: EventBatch) -> None:
        """Take the events of a step, what moved within it, and the frame that it led to."""
        before = self._event_count + int(np.searchsorted(events["t"], frame.time_us))
        self.write(events, frame.time_us)
        self._record_motions(frame.time_us)
        plan = self._plan
        if frame.index % plan.every == 0:
            last, following = (plan.time_of(frame.index + way * plan.every) for way in (-1, 1))
            self._layout.shot(Shot(frame.time_us, last, following, before, self._planes(frame)))
            self.recorded_frames += 1

    def write(self, events: EventBatch, end_us: int) -> None:
        """Write events alone; see Sink.write."""
        self._layout.events(events, end_us)
        self._event_count += len(events)

    def close(self) -> None:
        """Complete the layout; see Sink.close."""
        self._layout.close()

    def _planes(self, frame: Frame) -> dict[str, npt.NDArray[Any]]:
        names = self._plan.about.names
        found: dict[str, npt.NDArray[Any]] = dict(cut(frame, names))
        picture = self._pictures.of(cut(frame, ("intensity",))) if "image" in names else None
        if picture is not None:
            found["image"] = picture
        return found

    def _record_motions(self, end_us: int) -> None:
        plan = self._plan
        if "poses" in plan.about.names:
            times_us = self._pose_times(end_us)
            if len(times_us):
                self._layout.track(track("camera", plan.camera, times_us, camera=True))
                for name, motion in plan.moving:
                    self._layout.track(track(name, motion, times_us))
        if self._imu is not None:
            self._layout.imu(self._imu.until(end_us))

    def _pose_times(self, end_us: int) -> Times:
        step_us = 1e6 / self._plan.pose_rate
        last = int(end_us / step_us + 1e-6)
        numbers = np.arange(self._pose_count, last + 1)
        self._pose_count = max(self._pose_count, last + 1)
        times_us: Times = np.rint(numbers * step_us).astype(np.int64)
        return times_us
