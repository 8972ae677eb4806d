"""Motion: a pose as a function of time.

All motions hold their first pose before they start and their last one after they end (an endless orbit runs on).
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError

Matrix = npt.NDArray[np.float64]
Vec3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
_SAME = 1 - 1e-10
"""Cosine above which sin θ of two quaternions vanishes, and with it the difference of an arc to a straight line."""


class Motion(Protocol):
    """A rigid (or similarity) pose over time."""

    @property
    def duration_s(self) -> float:
        """Length of the motion [s]; 0 where nothing moves."""
        ...

    def pose(self, time_s: float) -> Matrix:
        """Return the 4×4 object-to-world matrix (columns are the axes; for a camera, it looks along −z, +y up)."""
        ...


@dataclass(frozen=True)
class Static:
    """A pose that never changes."""

    matrix: Matrix
    duration_s: float = 0.0

    def pose(self, time_s: float) -> Matrix:
        """Return the one pose."""
        return self.matrix


@dataclass(frozen=True)
class Keyframes:
    """Positions interpolated linearly, rotations by slerp.

    Attributes:
        times_s: strictly increasing times [s].
        positions: one per time [m].
        rotations: unit quaternions x, y, z, w (glTF's order), one per time.
    """

    times_s: tuple[float, ...]
    positions: tuple[Vec3, ...]
    rotations: tuple[Quaternion, ...]

    def __post_init__(self) -> None:
        """Refuse keyframes that do not belong together."""
        _check_times(self.times_s, len(self.positions), len(self.rotations))
        if any(math.hypot(*rotation) < 1e-9 for rotation in self.rotations):
            raise InputError("a keyframe's quaternion is 0, expected a rotation")

    @property
    def duration_s(self) -> float:
        """Time of the last keyframe [s]."""
        return self.times_s[-1]

    def pose(self, time_s: float) -> Matrix:
        """Return the pose at that time."""
        i, j, weight = _segment(self.times_s, time_s)
        rotation = rotation_matrix(slerp(self.rotations[i], self.rotations[j], weight))
        return compose(_lerp(self.positions[i], self.positions[j], weight), rotation)


@dataclass(frozen=True)
class LookAtKeyframes:
    """Positions and targets interpolated linearly; −z points to the target and +y up.

    Attributes:
        times_s: strictly increasing times [s].
        positions: one per time [m].
        targets: what is looked at, one per time [m].
        up: the world direction that points up in the image.
    """

    times_s: tuple[float, ...]
    positions: tuple[Vec3, ...]
    targets: tuple[Vec3, ...]
    up: Vec3 = (0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        """Refuse keyframes that do not belong together, or whose position meets its target."""
        _check_times(self.times_s, len(self.positions), len(self.targets))
        for k, time_s in enumerate(self.times_s):
            last = min(k + 1, len(self.times_s) - 1)
            start = np.subtract(self.targets[k], self.positions[k], dtype=np.float64)
            step = np.subtract(self.targets[last], self.positions[last], dtype=np.float64) - start
            nearest = float(np.clip(-start @ step / max(float(step @ step), 1e-30), 0.0, 1.0))
            if np.linalg.norm(start + nearest * step) < 1e-9:
                raise InputError(
                    f"position and look_at meet at or after time_s {time_s:g}, expected two distinct points"
                )

    @property
    def duration_s(self) -> float:
        """Time of the last keyframe [s]."""
        return self.times_s[-1]

    def pose(self, time_s: float) -> Matrix:
        """Return the pose at that time."""
        i, j, weight = _segment(self.times_s, time_s)
        return look_at(
            _lerp(self.positions[i], self.positions[j], weight),
            _lerp(self.targets[i], self.targets[j], weight),
            self.up,
        )


@dataclass(frozen=True)
class Orbit:
    """A circle about the vertical through ``center``, counter-clockwise seen from above, starting on the +z side.

    Attributes:
        center: centre of the circle's base [m].
        radius_m: radius of the circle.
        period_s: time of a full turn.
        height_m: height of the circle over the centre.
        start_deg: angle at time 0, from +z towards +x.
        degrees: how far to go; None turns for ever (then ``duration_s`` is one period).
        clockwise: whether to go the other way round.
        target: what to look at all the way (−z points there); None keeps ``rotation``.
        rotation: orientation x, y, z, w where there is no target.
    """

    center: Vec3
    radius_m: float
    period_s: float
    height_m: float = 0.0
    start_deg: float = 0.0
    degrees: float | None = None
    clockwise: bool = False
    target: Vec3 | None = None
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        """Refuse an orbit that does not turn or runs through what it looks at."""
        if self.radius_m <= 0 or self.period_s <= 0:
            raise InputError(
                f"radius and period of an orbit must be positive, got {self.radius_m:g} m and {self.period_s:g} s"
            )
        if self.target is not None:
            x, y, z = np.subtract(self.target, self.center)
            if abs(math.hypot(x, z) - self.radius_m) < 1e-9 and abs(y - self.height_m) < 1e-9:
                raise InputError("an orbit passes through its look_at, expected a target off the circle")

    @property
    def duration_s(self) -> float:
        """Time until the orbit ends, or of a full turn [s]."""
        return self.period_s if self.degrees is None else self.period_s * self.degrees / 360.0

    def pose(self, time_s: float) -> Matrix:
        """Return the pose at that time."""
        turned = 360.0 * time_s / self.period_s
        if self.degrees is not None:
            turned = min(max(turned, 0.0), self.degrees)
        angle = math.radians(self.start_deg + (-turned if self.clockwise else turned))
        offset = (self.radius_m * math.sin(angle), self.height_m, self.radius_m * math.cos(angle))
        position = np.add(self.center, offset)
        if self.target is None:
            return compose(position, rotation_matrix(np.asarray(self.rotation)))
        return look_at(position, self.target)


@dataclass(frozen=True)
class Attached:
    """A fixed placement inside something that moves, such as a part of a loaded file."""

    parent: Motion
    offset: Matrix

    @property
    def duration_s(self) -> float:
        """Length of the parent's motion [s]."""
        return self.parent.duration_s

    def pose(self, time_s: float) -> Matrix:
        """Return the parent's pose times the offset."""
        return self.parent.pose(time_s) @ self.offset


@dataclass(frozen=True)
class Nested:
    """A motion inside something that moves itself."""

    outer: Motion
    inner: Motion

    @property
    def duration_s(self) -> float:
        """Time until both have ended [s]."""
        return max(self.outer.duration_s, self.inner.duration_s)

    def pose(self, time_s: float) -> Matrix:
        """Return the outer pose times the inner one."""
        return self.outer.pose(time_s) @ self.inner.pose(time_s)


def compose(position: npt.ArrayLike, rotation: Matrix) -> Matrix:
    """Return the 4×4 matrix of a 3×3 rotation followed by a translation."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = position
    return matrix


def look_at(eye: npt.ArrayLike, target: npt.ArrayLike, up: npt.ArrayLike = (0.0, 1.0, 0.0)) -> Matrix:
    """Return the pose at ``eye`` whose −z axis points to ``target``; straight down or up, the image's top is −z or +z.

    Raises:
        ValueError: if eye and target coincide.
    """
    # Plain numbers are ten times as fast as numpy's: poses are asked for thousands of times a second.
    ex, ey, ez = np.asarray(eye, np.float64).tolist()
    tx, ty, tz = np.asarray(target, np.float64).tolist()
    backward = _unit((ex - tx, ey - ty, ez - tz), 1e-12)
    if backward is None:
        raise ValueError("eye and target coincide")
    ux, uy, uz = np.asarray(up, np.float64).tolist()
    right = _unit(_cross((ux, uy, uz), backward), 1e-6 * math.hypot(ux, uy, uz))
    if right is None:
        right = _unit(_cross((0.0, 0.0, -1.0 if backward[1] > 0 else 1.0), backward), 1e-6) or (1.0, 0.0, 0.0)
    (rx, ry, rz), (ux, uy, uz), (bx, by, bz) = right, _cross(backward, right), backward
    return np.array([[rx, ux, bx, ex], [ry, uy, by, ey], [rz, uz, bz, ez], [0.0, 0.0, 0.0, 1.0]])


def _unit(vector: Vec3, least: float) -> Vec3 | None:
    """Return a vector divided by its length; None where that is no more than ``least``, which may be 0."""
    x, y, z = vector
    length = math.sqrt(x * x + y * y + z * z)
    return None if length <= least else (x / length, y / length, z / length)


def _cross(a: Vec3, b: Vec3) -> Vec3:
    (ax, ay, az), (bx, by, bz) = a, b
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


def rotation_matrix(quaternion: npt.ArrayLike) -> Matrix:
    """Return the 3×3 rotation of a quaternion x, y, z, w (normalised here)."""
    q = np.asarray(quaternion, np.float64)
    x, y, z, w = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def euler_quaternion(rotation_deg: Vec3) -> Quaternion:
    """Return the quaternion x, y, z, w of turns about the fixed axes: x first, then y, then z."""
    (sx, cx), (sy, cy), (sz, cz) = (
        (math.sin(math.radians(a) / 2), math.cos(math.radians(a) / 2)) for a in rotation_deg
    )
    return (
        sx * cy * cz - cx * sy * sz,
        cx * sy * cz + sx * cy * sz,
        cx * cy * sz - sx * sy * cz,
        cx * cy * cz + sx * sy * sz,
    )


def slerp(start: npt.ArrayLike, end: npt.ArrayLike, weight: float) -> Matrix:
    """Interpolate unit quaternions along the shorter great circle (Shoemake, SIGGRAPH 1985)."""
    a, b = np.asarray(start, np.float64), np.asarray(end, np.float64)
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    cosine = float(a @ b)
    if cosine < 0:  # q and −q are the same rotation
        b, cosine = -b, -cosine
    if cosine > _SAME:
        mixed: Matrix = (1 - weight) * a + weight * b
    else:
        angle = math.acos(cosine)
        mixed = (math.sin((1 - weight) * angle) * a + math.sin(weight * angle) * b) / math.sin(angle)
    return mixed


def slerp_rows(start: Matrix, end: Matrix, weight: float) -> Matrix:
    """Do as `slerp` with each of many, ``[m, 4]``; of one that takes three times as long."""
    a, b = (q / np.linalg.norm(q, axis=-1, keepdims=True) for q in (start, end))
    cosine = (a * b).sum(axis=-1, keepdims=True)
    b = np.where(cosine < 0, -b, b)
    cosine = np.minimum(np.abs(cosine), 1.0)
    angle = np.arccos(cosine)
    turned = np.sin((1 - weight) * angle) * a + np.sin(weight * angle) * b
    same = cosine > _SAME
    mixed: Matrix = np.where(same, (1 - weight) * a + weight * b, turned / np.where(same, 1.0, np.sin(angle)))
    return mixed


def _check_times(times_s: tuple[float, ...], *lengths: int) -> None:
    if not times_s or any(length != len(times_s) for length in lengths):
        raise InputError("keyframes need one time, position and orientation each, and at least one keyframe")
    if any(b <= a for a, b in pairwise(times_s)) or times_s[0] < 0:
        raise InputError(f"keyframe times must increase from 0 or later, got {', '.join(f'{t:g}' for t in times_s)} s")


def _segment(times_s: tuple[float, ...], time_s: float) -> tuple[int, int, float]:
    """Return the keyframes before and after the time and the weight of the second."""
    j = bisect_right(times_s, time_s)
    if j == 0:
        return 0, 0, 0.0
    if j == len(times_s):
        return j - 1, j - 1, 0.0
    return j - 1, j, (time_s - times_s[j - 1]) / (times_s[j] - times_s[j - 1])


def _lerp(start: Vec3, end: Vec3, weight: float) -> Vec3:
    rest = 1 - weight
    return (
        rest * start[0] + weight * end[0],
        rest * start[1] + weight * end[1],
        rest * start[2] + weight * end[2],
    )
