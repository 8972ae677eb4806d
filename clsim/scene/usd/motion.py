"""How what a USD file places moves: matrices at time codes, as finely as needed, so that the file may be closed."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import UsdGeom

from clsim.scene.meshes.geometry import is_similarity
from clsim.scene.motion import Matrix, Motion, Static, compose, rotation_matrix, slerp
from clsim.scene.rigid import quaternion_of
from clsim.scene.usd.stage import Stage
from clsim.scene.world import F32

F64 = npt.NDArray[np.float64]
TOLERANCE = 1e-5
"""By how much a joined pose may differ from that of USD: of its rotation, and of its distance from the origin."""
MAX_HALVINGS = 8
_LOOKED_AT = (0.5, 0.3)
"""Where between two poses: two places, for after half of several turns all is as it was."""
MAX_POSES = 20_000


@dataclass(frozen=True)
class PoseTrack:
    """Poses at times: places and scales joined by lines, rotations by slerp.

    Attributes:
        times_s: increasing [s].
        positions: float64 ``[n, 3]`` [m].
        rotations: quaternions x, y, z, w ``[n, 4]``.
        scales: ``[n]``, of all axes.
        repeat: whether all starts anew at the end.
    """

    times_s: tuple[float, ...]
    positions: F64
    rotations: F64
    scales: F64
    repeat: bool = False

    @property
    def duration_s(self) -> float:
        """Time of the last pose [s]."""
        return self.times_s[-1]

    def pose(self, time_s: float) -> Matrix:
        """Return the pose at that time."""
        i, j, share = _between(self.times_s, time_s, self.repeat)
        turn = rotation_matrix(slerp(self.rotations[i], self.rotations[j], share))
        scale = (1 - share) * self.scales[i] + share * self.scales[j]
        return compose((1 - share) * self.positions[i] + share * self.positions[j], turn * scale)


@dataclass(frozen=True)
class Shapes:
    """A deformation: vertices at times, joined by lines.

    Attributes:
        times_s: increasing [s].
        vertices: float32 ``[times, n, 3]``.
        normals: likewise, of any length, or None.
        repeat: whether all starts anew at the end.
    """

    times_s: tuple[float, ...]
    vertices: F32
    normals: F32 | None
    repeat: bool = False

    @property
    def duration_s(self) -> float:
        """Time of the last shape [s]."""
        return self.times_s[-1]

    def vertices_at(self, time_s: float) -> tuple[F32, F32 | None]:
        """Return vertices and unit normals at a time."""
        i, j, share = _between(self.times_s, time_s, self.repeat)
        vertices = _mixed(self.vertices, i, j, share)
        if self.normals is None:
            return vertices, None
        normals = _mixed(self.normals, i, j, share)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        upright = np.where(lengths > 1e-12, normals / np.maximum(lengths, 1e-12), (0.0, 1.0, 0.0))
        return vertices, np.ascontiguousarray(upright, np.float32)


def moving_codes(stage: Stage, prim: Any, within: Any = None) -> list[float]:
    """Return the time codes, with both ends, at which something places a prim anew; [] where it stands still.

    What moves ``within`` as a whole, one of the prims that it is in, does not count.
    """
    found: set[float] = set()
    while prim and not prim.IsPseudoRoot() and prim != within:
        shape = UsdGeom.Xformable(prim)
        if shape:
            for operation in shape.GetOrderedXformOps():
                found.update(stage.times(operation.GetAttr()))
            if shape.GetResetXformStack():
                break
        prim = prim.GetParent()
    return sorted(found)


def motion_of(stage: Stage, codes: Sequence[float], matrix_at: Callable[[float], Matrix], *, repeat: bool) -> Motion:
    """Return the motion of what is at a matrix that is a similarity at all of those time codes (none: it is still).

    Between two of them USD may turn by angles, about several axes: poses are added until lines and slerp do as well.
    """
    start = matrix_at(codes[0] if codes else stage.start)
    if not codes:
        return Static(start)
    poses: list[tuple[float, Matrix]] = [(codes[0], start)]
    for before, after in pairwise(codes):
        _refine(matrix_at, (before, poses[-1][1]), (after, matrix_at(after)), MAX_HALVINGS, poses)
    times_s = tuple(stage.seconds(code) for code, _ in poses)
    matrices = np.array([matrix for _, matrix in poses])
    return PoseTrack(times_s, *_parts(matrices), repeat=repeat)


def are_similar(matrices: Sequence[Matrix]) -> bool:
    """Tell whether all are rotations with one positive scale."""
    return all(is_similarity(matrix[:3, :3]) for matrix in matrices)


def _refine(
    matrix_at: Callable[[float], Matrix],
    before: tuple[float, Matrix],
    after: tuple[float, Matrix],
    halvings: int,
    out_poses: list[tuple[float, Matrix]],
) -> None:
    """Add the poses after the first to a list, with as many in between as it takes."""
    joined = PoseTrack((0.0, 1.0), *_parts(np.array([before[1], after[1]])))
    trues = [matrix_at(before[0] + share * (after[0] - before[0])) for share in _LOOKED_AT]
    apart = any(_differ(joined.pose(share), true) for share, true in zip(_LOOKED_AT, trues, strict=True))
    if apart and halvings and len(out_poses) < MAX_POSES:
        middle = (0.5 * (before[0] + after[0]), trues[0])
        _refine(matrix_at, before, middle, halvings - 1, out_poses)
        _refine(matrix_at, middle, after, halvings - 1, out_poses)
    else:
        out_poses.append(after)


def _differ(joined: Matrix, true: Matrix) -> bool:
    turned = np.abs(joined[:3, :3] - true[:3, :3]).max() > TOLERANCE * np.abs(true[:3, :3]).max()
    moved = np.abs(joined[:3, 3] - true[:3, 3]).max() > TOLERANCE * max(float(np.abs(true[:3, 3]).max()), 1e-3)
    return bool(turned or moved)


def _parts(matrices: F64) -> tuple[F64, F64, F64]:
    """Return positions, quaternions and scales of similarities ``[n, 4, 4]``."""
    scales = np.cbrt(np.linalg.det(matrices[:, :3, :3]))
    turns = [quaternion_of(matrix[:3, :3] / scale) for matrix, scale in zip(matrices, scales, strict=True)]
    return matrices[:, :3, 3], np.array(turns), scales


def _between(times_s: tuple[float, ...], time_s: float, repeat: bool) -> tuple[int, int, float]:
    """Return what is before a time and what after it, and the share of the second."""
    if repeat and times_s[-1] > 0:
        time_s %= times_s[-1]
    j = bisect_right(times_s, time_s)
    if j in (0, len(times_s)):
        return (0, 0, 0.0) if j == 0 else (j - 1, j - 1, 0.0)
    return j - 1, j, (time_s - times_s[j - 1]) / (times_s[j] - times_s[j - 1])


def _mixed(values: F32, i: int, j: int, share: float) -> F32:
    mixed: F32 = values[i] * np.float32(1 - share) + values[j] * np.float32(share)
    return mixed
