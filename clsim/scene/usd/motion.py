"""How what a USD file places moves: matrices at time codes, as finely as needed, so that the file may be closed."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import UsdGeom

from clsim.scene.meshes.geometry import is_similarity
from clsim.scene.motion import Matrix, Motion, Static, compose, rotation_matrix, slerp, slerp_rows
from clsim.scene.rigid import quaternions_of
from clsim.scene.usd.stage import Stage
from clsim.scene.world import F32

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
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
    if not codes:
        return Static(matrix_at(stage.start))
    refined, matrices = _refined(matrix_at, codes)
    return PoseTrack(tuple(stage.seconds(code) for code in refined), *_parts(matrices), repeat=repeat)


def are_similar(matrices: Sequence[Matrix]) -> bool:
    """Tell whether all are rotations with one positive scale."""
    return all(is_similarity(matrix[:3, :3]) for matrix in matrices)


def _refined(matrix_at: Callable[[float], Matrix], codes: Sequence[float]) -> tuple[list[float], F64]:
    """Return time codes with as many in between as it takes, and the matrices at all of them.

    All that may have to be halved is looked at at once: one after the other takes several times as long.
    """
    times, matrices = np.array(codes, np.float64), np.array([matrix_at(code) for code in codes])
    firsts = np.arange(len(times) - 1)
    for _ in range(MAX_HALVINGS if len(times) > 1 else 0):
        joined = _parts(matrices)
        looks = [times[firsts] + share * (times[firsts + 1] - times[firsts]) for share in _LOOKED_AT]
        trues = [np.array([matrix_at(float(code)) for code in look]) for look in looks]
        apart = [_differ(_joined(*joined, firsts, share), true) for share, true in zip(_LOOKED_AT, trues, strict=True)]
        halved = np.logical_or(*apart)
        halved &= np.cumsum(halved) <= MAX_POSES - len(times)
        if not halved.any():
            break
        times = np.insert(times, firsts[halved] + 1, looks[0][halved])
        matrices = np.insert(matrices, firsts[halved] + 1, trues[0][halved], axis=0)
        shifted = firsts[halved] + np.arange(halved.sum())
        firsts = np.column_stack([shifted, shifted + 1]).ravel()
    return times.tolist(), matrices


def _joined(positions: F64, rotations: F64, scales: F64, firsts: I64, share: float) -> F64:
    """Return the matrices at a share of the way from some poses to those after them ``[n, 4, 4]``."""
    turns = slerp_rows(rotations[firsts], rotations[firsts + 1], share)
    matrices = np.tile(np.eye(4), (len(firsts), 1, 1))
    x, y, z, w = (turns / np.linalg.norm(turns, axis=1, keepdims=True)).T
    matrices[:, :3, :3] = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]).transpose(2, 0, 1)  # fmt: skip
    matrices[:, :3, :3] *= ((1 - share) * scales[firsts] + share * scales[firsts + 1])[:, None, None]
    matrices[:, :3, 3] = (1 - share) * positions[firsts] + share * positions[firsts + 1]
    return matrices


def _differ(joined: F64, true: F64) -> npt.NDArray[np.bool_]:
    """Tell which of some matrices are too far from the true ones."""
    off, size = np.abs(joined - true), np.abs(true)
    turned = off[:, :3, :3].max(axis=(1, 2)) > TOLERANCE * size[:, :3, :3].max(axis=(1, 2))
    moved = off[:, :3, 3].max(axis=1) > TOLERANCE * np.maximum(size[:, :3, 3].max(axis=1), 1e-3)
    return np.asarray(turned | moved)


def _parts(matrices: F64) -> tuple[F64, F64, F64]:
    """Return positions, quaternions and scales of similarities ``[n, 4, 4]``."""
    scales = np.cbrt(np.linalg.det(matrices[:, :3, :3]))
    return matrices[:, :3, 3], quaternions_of(matrices[:, :3, :3] / scales[:, None, None]), scales


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
