"""The shutter interval that a scene's data covers: what moves has poses at equal steps through it, the keys.

Between two keys, positions go along the cubic with the speeds that motions have there (Hermite's), rotations by slerp,
and the scale of a pose changes linearly: at ``SHUTTER_KEYS`` = 9, one turn within the interval keeps its radius to
.1 %, even about a far pivot. Beyond four turns rotations alias. What deforms has a shape at each key instead, and a
path sees the nearest one: an eighth of the way that a vertex goes within the interval should be less than a pixel, or
edges show in steps.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.scene import Motion

F64 = npt.NDArray[np.float64]

SHUTTER_KEYS = 9
"""Poses through the interval, both ends included."""
_SEGMENTS = wp.constant(SHUTTER_KEYS - 1)
_NEARBY = 1e-3
"""Share of a step from key to key over which speeds are taken."""


@wp.func
def shutter_key(time: float) -> int:
    """Return the key before a time, which goes from 0 to 1 through the interval."""
    return wp.min(int(time * float(_SEGMENTS)), _SEGMENTS - 1)


@wp.func
def nearest_key(time: float) -> int:
    """Return the key nearest to a time."""
    return wp.clamp(int(time * float(_SEGMENTS) + 0.5), 0, _SEGMENTS)


@wp.func
def shutter_weight(time: float) -> float:
    """Return the weight of the key after a time."""
    return time * float(_SEGMENTS) - float(shutter_key(time))


@wp.func
def position_between(a: wp.vec3, b: wp.vec3, step_a: wp.vec3, step_b: wp.vec3, weight: float) -> wp.vec3:
    """Return the point of Hermite's cubic; steps are the ways of one key to the next at the speeds at both ends."""
    chord = b - a
    bend = (step_a - chord) * (1.0 - weight) + (chord - step_b) * weight
    return a + chord * weight + bend * (weight * (1.0 - weight))


@wp.func
def rotation_between(a: wp.quat, b: wp.quat, weight: float) -> wp.quat:
    """Return the slerp of two unit quaternions on the same side."""
    # The angle by its chord, which is exact for small angles too.
    angle = 2.0 * wp.asin(wp.min(0.5 * wp.length(b - a), 1.0))
    before = 1.0 - weight
    after = float(weight)
    if angle > 1.0e-3:
        before = wp.sin(before * angle) / wp.sin(angle)
        after = wp.sin(weight * angle) / wp.sin(angle)
    return wp.normalize(a * before + b * after)


def key_times(time_s: float, interval_s: float) -> F64:
    """Return the times of the keys of an interval about ``time_s`` [s]; that time alone without one."""
    if interval_s == 0:
        return np.array([time_s])
    return time_s + interval_s * np.linspace(-0.5, 0.5, SHUTTER_KEYS)


def key_steps(motions: list[Motion], times_s: F64, positions: F64) -> F64:
    """Return the ways ``[keys, n, 3]`` from key to key at the speeds that motions have at the keys [m].

    None is more than twice the way that is gone to either neighbour, so that a jump bends nothing before or after it.

    Args:
        motions: what moves.
        times_s: times of the keys.
        positions: where they are then, ``[keys, n, 3]``.
    """
    if len(times_s) == 1:
        return np.zeros_like(positions)
    step_s = float(times_s[1] - times_s[0])
    near_s = _NEARBY * step_s
    ends = [[[m.pose(float(t) + way)[:3, 3] for m in motions] for t in times_s] for way in (-near_s, near_s)]
    steps = np.asarray(np.subtract(ends[1], ends[0]).reshape(positions.shape) / (2 * _NEARBY), np.float64)
    chords = np.linalg.norm(np.diff(positions, axis=0), axis=2)
    limit = np.full(steps.shape[:2], np.inf)
    limit[1:], limit[:-1] = np.minimum(limit[1:], 2 * chords), np.minimum(limit[:-1], 2 * chords)
    lengths = np.linalg.norm(steps, axis=2)
    return steps * np.minimum(1.0, limit / np.maximum(lengths, 1e-300))[..., None]


def chord_error(positions: F64, steps: F64) -> F64:
    """Return by how much each path ``[n, 3]`` may leave the boxes of its keys [m]: a bound."""
    chords = np.diff(positions, axis=0)
    return np.asarray(0.25 * np.maximum(np.abs(steps[:-1] - chords), np.abs(chords - steps[1:])).max(axis=0))


def quaternions(rotations: F64) -> F64:
    """Return the unit quaternions x, y, z, w of rotations ``[keys, …, 3, 3]``, each on the side of the key before."""
    m = rotations
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    # 4·q·qᵀ, of which every row is a multiple of q: the longest is the most exact (Shepperd, JGC 1(3), 1978).
    products = np.empty((*m.shape[:-2], 4, 4))
    for i, diagonal in enumerate((1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz, 1 + xx + yy + zz)):
        products[..., i, i] = diagonal
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        products[..., i, j] = products[..., j, i] = m[..., i, j] + m[..., j, i]
        products[..., k, 3] = products[..., 3, k] = m[..., j, i] - m[..., i, j]
    best = np.argmax(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(products, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    for n in range(1, len(q)):
        q[n] = np.where((q[n] * q[n - 1]).sum(axis=-1, keepdims=True) < 0, -q[n], q[n])
    return np.asarray(q, np.float64)
