"""Motion from trajectory files, and through keyframes along splines."""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import Any, Literal

import numpy as np

from clsim.errors import InputError
from clsim.scene.motion import Keyframes, Matrix, Motion, Quaternion, Static, Vec3, compose, look_at, rotation_matrix
from clsim.values import read_text

MAX_BYTES = 256 << 20
_LATEST_S = 1e11
"""In the year 5138: what is later counts in another unit."""
_W_FIRST = re.compile(r"\bq_?w\b[\s,]+q_?x\b[\s,]+q_?y\b[\s,]+q_?z\b")
Interpolation = Literal["linear", "cubic"]
Axes = Literal["opencv", "opengl"]
Timed = tuple[str, Decimal, list[float]]
"""Where a file tells a pose, its time [s], and position and quaternion x, y, z, w.

Float64 has a quarter of a microsecond since 1970: a camera that goes evenly would tremble.
"""


@dataclass(frozen=True)
class CubicKeyframes:
    """Positions along a natural cubic spline, rotations along one of continuous angular acceleration.

    Attributes:
        times_s: strictly increasing times [s], two at least.
        positions: one per time [m].
        rotations: unit quaternions x, y, z, w, one per time; None where there are targets.
        targets: what is looked at, one per time, along a spline as well; None where there are rotations.
    """

    times_s: tuple[float, ...]
    positions: tuple[Vec3, ...]
    rotations: tuple[Quaternion, ...] | None = None
    targets: tuple[Vec3, ...] | None = None
    _splines: tuple[Any, Any] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Fit the splines."""
        from scipy.interpolate import CubicSpline
        from scipy.spatial.transform import Rotation

        place = CubicSpline(self.times_s, self.positions, bc_type="natural")
        if self.targets is not None:
            turn = CubicSpline(self.times_s, self.targets, bc_type="natural")
        elif self.rotations is not None:
            turn = _spline_of_turns(self.times_s, Rotation.from_quat(self.rotations))
        else:
            raise ValueError("cubic keyframes need rotations or targets")
        object.__setattr__(self, "_splines", (place, turn))

    @property
    def duration_s(self) -> float:
        """Time of the last keyframe [s]."""
        return self.times_s[-1]

    def pose(self, time_s: float) -> Matrix:
        """Return the pose at that time."""
        place, turn = self._splines
        clipped = min(max(time_s, self.times_s[0]), self.times_s[-1])
        position = place(clipped)
        if self.targets is None:
            return compose(position, turn(clipped).as_matrix())
        target = turn(clipped)
        if np.linalg.norm(position - target) < 1e-9:
            raise InputError(f"the spline meets its look_at at {clipped:g} s, expected a path that keeps away from it")
        return look_at(position, target)


def _spline_of_turns(times_s: tuple[float, ...], rotations: Any) -> Any:
    """Return SciPy's spline; raises InputError where it has none: it is found step by step, and may run away."""
    from scipy.spatial.transform import RotationSpline

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # of numbers that overflow on the way
            spline = RotationSpline(times_s, rotations)
        if all(np.isfinite(part).all() for part in spline.interpolator.c):
            return spline
    except ValueError:  # of a step that was not finite any more
        pass
    largest = float(np.degrees((rotations[:-1].inv() * rotations[1:]).magnitude().max()))
    raise InputError(
        f"keyframes turn by up to {largest:.0f}° from one to the next, through which there is no spline; expected them "
        "closer together, or linear interpolation"
    )


def through(
    times_s: tuple[float, ...],
    positions: tuple[Vec3, ...],
    rotations: tuple[Quaternion, ...],
    interpolation: Interpolation,
) -> Motion:
    """Return the motion through keyframes.

    Raises:
        InputError: if they do not belong together.
    """
    straight = Keyframes(times_s, positions, rotations)  # checks them
    if interpolation == "linear" or len(times_s) < 2:
        return straight
    return CubicKeyframes(times_s, positions, rotations)


def read_tum(path: Path, *, axes: Axes = "opencv", interpolation: Interpolation = "linear") -> Motion:
    """Read a camera's trajectory in the format of the TUM RGB-D benchmark: ``t tx ty tz qx qy qz qw`` a line.

    Time starts at the first line. Source: Sturm et al., IROS 2012.

    Args:
        path: the file; empty lines and those that start with # are skipped, but for one that names the columns with
            qw before qx. Commas may stand between the numbers.
        axes: the camera's: ``opencv`` looks along +z with y down, as in the benchmark; ``opengl`` along −z with y up.
        interpolation: how to join the poses.

    Raises:
        InputError: naming file and line.
    """
    poses: list[Timed] = []
    w_first = False
    for number, line in enumerate(read_text(path, MAX_BYTES, "a trajectory").splitlines(), start=1):
        words = line.replace(",", " ").split()
        if words and words[0].startswith("#"):
            w_first = w_first or _W_FIRST.search(line.lower()) is not None
        elif words:
            place, time_s, (x, y, z, *turn) = _line(f"{path}:{number}", words)
            poses.append((place, time_s, [x, y, z, *turn[1:], turn[0]] if w_first else [x, y, z, *turn]))
    return joined(path, poses, axes, interpolation)


def joined(path: Path, poses: list[Timed], axes: Axes, interpolation: Interpolation) -> Motion:
    """Return the motion through the poses of a file, which begins with the first of them.

    Raises:
        InputError: naming the place of what is wrong.
    """
    times: list[float] = []
    positions: list[Vec3] = []
    rotations: list[Quaternion] = []
    for place, time_s, (x, y, z, *quaternion) in poses:
        if time_s > _LATEST_S:
            raise InputError(f"{place}: time {float(time_s):.9g} is no time in seconds (nanoseconds?)")
        since_s = float(time_s - poses[0][1])
        if times and not since_s > times[-1]:
            raise InputError(f"{place}: time {float(time_s):.9g} s does not come after the one before")
        length = math.hypot(*quaternion)
        if abs(length - 1) > 0.01:
            raise InputError(f"{place}: its quaternion has length {length:g}, expected 1")
        qx, qy, qz, qw = (part / length for part in quaternion)
        times.append(since_s)
        positions.append((x, y, z))
        rotations.append(turned((qx, qy, qz, qw)) if axes == "opencv" else (qx, qy, qz, qw))
    if not times:
        raise InputError(f"{path}: has no poses, expected times, positions and quaternions x, y, z, w")
    if len(times) == 1:
        return Static(compose(positions[0], rotation_matrix(rotations[0])))
    return through(tuple(times), tuple(positions), tuple(rotations), interpolation)


def _line(place: str, words: list[str]) -> Timed:
    try:
        time_s, *pose = (float(word) for word in words)
    except ValueError:
        pose = []
    if len(pose) != 7:
        hint = "; begin a header with #" if words[0][0].isalpha() else ""
        raise InputError(f"{place}: got {' '.join(words)[:60]!r}, expected 8 numbers t tx ty tz qx qy qz qw{hint}")
    if not all(map(math.isfinite, (time_s, *pose))):
        raise InputError(f"{place}: has a number that is not finite")
    return place, Decimal(words[0]), pose


def turned(rotation: Quaternion) -> Quaternion:
    """Return the rotation after half a turn about its own x: from z ahead and y down to −z ahead and y up, or back."""
    x, y, z, w = rotation
    return w, z, -y, -x
