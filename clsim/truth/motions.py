"""Poses and inertial samples of a run, as time goes on."""

from __future__ import annotations

import numpy as np

from clsim.scene import Motion
from clsim.truth.kinematics import Imu, track
from clsim.truth.record import About, ImuChunk, Times, TrackChunk


class Motions:
    """Tells how the camera and the objects have moved, each at its own rate.

    Several recorders may ask in turn: who asks for the time that was asked for last gets what it got.
    """

    def __init__(
        self, about: About, camera: Motion, moving: tuple[tuple[str, Motion], ...], pose_rate: float, seed: int
    ) -> None:
        """Begin at time 0; ``moving`` holds name and motion of each object that moves."""
        self._camera, self._moving, self._pose_rate = camera, moving, pose_rate
        self._poses = "poses" in about.names
        self._pose_count = 0
        self._imu: Imu | None = None
        if "imu" in about.names:
            self._imu = Imu(camera, about.imu_rate, about.imu_noise, about.gravity, seed)
        self._last: tuple[int, tuple[tuple[TrackChunk, ...], ImuChunk | None]] = (-1, ((), None))

    def until(self, end_us: int) -> tuple[tuple[TrackChunk, ...], ImuChunk | None]:
        """Return poses and inertial samples up to and with ``end_us``, and after the time that was asked for before."""
        if end_us != self._last[0]:
            samples = None if self._imu is None else self._imu.until(end_us)
            self._last = end_us, (self._tracks(end_us), samples)
        return self._last[1]

    def _tracks(self, end_us: int) -> tuple[TrackChunk, ...]:
        times_us = self._pose_times(end_us) if self._poses else np.zeros(0, np.int64)
        if not len(times_us):
            return ()
        objects = (track(name, motion, times_us) for name, motion in self._moving)
        return (track("camera", self._camera, times_us, camera=True), *objects)

    def _pose_times(self, end_us: int) -> Times:
        step_us = 1e6 / self._pose_rate
        last = int(end_us / step_us + 1e-6)
        numbers = np.arange(self._pose_count, last + 1)
        self._pose_count = max(self._pose_count, last + 1)
        times_us: Times = np.rint(numbers * step_us).astype(np.int64)
        return times_us
