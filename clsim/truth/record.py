"""What a layout is handed: what holds for the whole run, frames, poses and inertial samples.

Conventions, for all that is stored: times are int64 µs of one clock, the events' own. Images have row 0 on top, x goes
right and y down, and the first pixel's centre is at 0.5, 0.5. Lengths are metres. The world is right-handed with +y up.
A camera looks along +z with +x right and +y down (OpenCV's axes).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.events import EventBatch

Times = npt.NDArray[np.int64]
F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ImuNoise:
    """Kalibr's noise model, continuous densities; all 0 is a perfect IMU.

    Attributes:
        accelerometer_noise_density: white noise [m/s²/√Hz].
        accelerometer_random_walk: of the bias [m/s³/√Hz].
        gyroscope_noise_density: white noise [rad/s/√Hz].
        gyroscope_random_walk: of the bias [rad/s²/√Hz].
    """

    accelerometer_noise_density: float = 0.0
    accelerometer_random_walk: float = 0.0
    gyroscope_noise_density: float = 0.0
    gyroscope_random_walk: float = 0.0


@dataclass(frozen=True)
class About:
    """What holds for a whole run.

    Attributes:
        width, height: of the sensor [pixels].
        camera: its lens and intrinsics, as in sidecars.
        names: what was asked for, of `TRUTH_NAMES`.
        frame_rate: frames of truth per second.
        objects: names of the objects; number k of a plane of ids is ``objects[k - 1]``.
        materials: likewise.
        object_poses: where each object is at time 0: x y z qx qy qz qw ``[n, 7]``.
        moving: names of the objects that move.
        imu_rate: samples per second.
        imu_noise: what was added to the samples.
        gravity: acceleration of free fall in the world [m/s²].
        side: which of DSEC's or MVSEC's two sides the recording is.
        camera_name: what the camera is called within a rig.
        extrinsics: from this camera's axes to those of the rig's others, by name ``[4, 4]`` (OpenCV's axes).
        baseline_m: of disparity: how far to the right the second camera stands.
        more: whatever else is known, for sidecars.
    """

    width: int
    height: int
    camera: Mapping[str, Any]
    names: tuple[str, ...]
    frame_rate: float
    objects: tuple[str, ...] = ()
    materials: tuple[str, ...] = ()
    object_poses: F64 = field(default_factory=lambda: np.zeros((0, 7)))
    moving: tuple[str, ...] = ()
    imu_rate: float = 0.0
    imu_noise: ImuNoise = field(default_factory=ImuNoise)
    gravity: tuple[float, float, float] = (0.0, -9.80665, 0.0)
    side: str = "left"
    camera_name: str = "camera"
    extrinsics: Mapping[str, F64] = field(default_factory=dict)
    baseline_m: float = 0.1
    more: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Shot:
    """A frame of truth; its arrays may be reused after the call that hands it over.

    Attributes:
        time_us: its time.
        before_us, after_us: the times that backward and forward flow lead to.
        event_index: number of events before it, which is the index of the first one at or after it.
        planes: by name, float32 but for ``image``, which has 8 bits: ``intensity``, ``image``, ``depth``,
            ``distance``, ``object``, ``material`` ``[H, W]``; ``normal``, ``albedo`` ``[H, W, 3]``; ``flow``,
            ``backward-flow`` ``[H, W, 4]``: x, y, valid, covisible.
    """

    time_us: int
    before_us: int
    after_us: int
    event_index: int
    planes: Mapping[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class TrackChunk:
    """Poses of the camera or of an object, in the order of time, later than those before.

    Attributes:
        name: ``camera``, or the object's.
        times_us: int64 ``[n]``.
        poses: to the world: x y z qx qy qz qw ``[n, 7]``; the camera's axes are OpenCV's.
        velocities: linear in the world [m/s] and angular in its own axes [rad/s] ``[n, 6]``.
    """

    name: str
    times_us: Times
    poses: F64
    velocities: F64


@dataclass(frozen=True)
class ImuChunk:
    """Inertial samples in the camera's own axes (OpenCV's).

    Attributes:
        times_us: int64 ``[n]``.
        acceleration: specific force ``[n, 3]`` [m/s²]: at rest it points up, with 9.81.
        angular_velocity: ``[n, 3]`` [rad/s].
    """

    times_us: Times
    acceleration: F64
    angular_velocity: F64


class Layout:
    """A layout that is being written; it leaves out what it cannot hold."""

    def events(self, batch: EventBatch, end_us: int) -> None:
        """Take events; see Sink.write."""

    def labels(self, labels: npt.NDArray[np.void]) -> None:
        """Take the labels of the events that were handed over last (`clsim.truth.labels`)."""

    def shot(self, shot: Shot) -> None:
        """Take a frame, when all events before it are there."""

    def track(self, chunk: TrackChunk) -> None:
        """Take poses."""

    def imu(self, chunk: ImuChunk) -> None:
        """Take inertial samples."""

    def close(self) -> None:
        """Complete and release; safe to call twice."""
