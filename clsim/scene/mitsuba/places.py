"""Where Mitsuba's objects stand: ``to_world`` as motions of shapes, and of what looks or shines along +z."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from clsim.errors import InputError
from clsim.scene.meshes.geometry import is_similarity
from clsim.scene.mitsuba.values import shown
from clsim.scene.mitsuba.xml import Animation, Plugin
from clsim.scene.motion import Keyframes, Matrix, Motion, Static, compose
from clsim.scene.rigid import facing, quaternion_of, stretch_of, without_scale
from clsim.scene.world import Vec3

TURN_ROUND = np.diag((-1.0, 1.0, -1.0, 1.0))
"""Half a turn about y: from Mitsuba's +z ahead to clsim's −z."""


def start_of(plugin: Plugin) -> Matrix:
    """Return where an object is at the start, 4×4."""
    return _transforms(plugin).matrices[0]


def placed(plugin: Plugin) -> tuple[Motion, Matrix]:
    """Return how a shape moves, and the 4×4 matrix by which it is stretched or mirrored before, once for all time.

    Keyframes are joined as poses.
    """
    track = _transforms(plugin)
    start = track.matrices[0]
    if len(track.matrices) == 1:
        if is_similarity(start[:3, :3]):
            return Static(start), np.eye(4)
        return Static(compose(start[:3, 3], np.eye(3))), compose((0.0, 0.0, 0.0), start[:3, :3])
    stretch = stretch_of(start)
    if stretch is None:
        raise InputError(f"{plugin.place}: its animation starts from a transform that squeezes flat")
    back = np.linalg.inv(stretch)
    return _joined(track.times_s, [without_scale(matrix @ back) for matrix in track.matrices]), stretch


def ahead(plugin: Plugin) -> Motion:
    """Return how a camera or a lamp moves that looks along Mitsuba's +z, as one that looks along −z."""
    track = _transforms(plugin)
    poses = [facing(matrix @ TURN_ROUND) for matrix in track.matrices]
    return Static(poses[0]) if len(poses) == 1 else _joined(track.times_s, poses)


def _transforms(plugin: Plugin) -> Animation:
    value = plugin.values.get("to_world")
    if value is None:
        return Animation((0.0,), (np.eye(4),))
    if isinstance(value, Animation):
        return value
    if not isinstance(value, np.ndarray) or value.shape != (4, 4):
        raise InputError(f"{plugin.place}: to_world is {shown(value)}, expected a transform")
    return Animation((0.0,), (value,))


def _joined(times_s: Sequence[float], poses: Sequence[Matrix]) -> Motion:
    positions: list[Vec3] = [(float(p[0, 3]), float(p[1, 3]), float(p[2, 3])) for p in poses]
    return Keyframes(tuple(times_s), tuple(positions), tuple(quaternion_of(p[:3, :3]) for p in poses))
