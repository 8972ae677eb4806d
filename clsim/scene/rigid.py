"""Rotations within matrices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from clsim.scene.motion import Matrix, Motion, Quaternion

_TINY = 1e-12
"""Sine of the angle below which two axes are taken for parallel."""


def without_scale(matrix: Matrix) -> Matrix:
    """Return the nearest pose without scale or shear (polar decomposition of the 3×3 part).

    It is of no use where the matrix mirrors: then several rotations are as near. For what looks or shines along an axis
    there is `facing`, for skies `without_stretch`.
    """
    u, _, vt = np.linalg.svd(matrix[:3, :3])
    pose: Matrix = matrix.copy()
    pose[:3, :3] = u @ np.diag((1.0, 1.0, float(np.sign(np.linalg.det(u @ vt))))) @ vt
    return pose


def facing(matrix: Matrix) -> Matrix:
    """Return the pose of a camera or a lamp that a matrix places: its −z axis leads where the matrix's does.

    Its y axis leans as the matrix's does, and x is what makes it a rotation, also where the matrix mirrors (as glTF,
    three.js and USD's frustums have it). Axes without a direction of their own are chosen: any finite matrix has one.
    """
    linear = np.asarray(matrix[:3, :3], np.float64)
    _, up, back = (_unit(axis) for axis in linear.T)
    right = _unit(linear[:, 0])
    if back is None:  # squeezed flat: what is across the other two
        back = None if right is None or up is None else _unit(np.cross(right, up), _TINY)
    if back is None:
        back = np.array((0.0, 0.0, 1.0))
    side = None if up is None else _unit(np.cross(up, back), _TINY)
    if side is None and right is not None:
        upwards = _unit(np.cross(back, right), _TINY)
        side = None if upwards is None else np.cross(upwards, back)
    if side is None:
        other = np.eye(3)[int(np.argmin(np.abs(back)))]
        side = np.cross(other, back)
        side /= np.linalg.norm(side)
    # What is across two axes that are nearly one is not quite across either.
    side = side - (side @ back) * back
    side /= np.linalg.norm(side)
    pose: Matrix = np.array(matrix, np.float64)
    pose[:3, :3] = np.stack([side, np.cross(back, side), back], axis=1)
    return pose


def mirrors(matrix: Matrix) -> bool:
    """Tell whether a matrix turns left into right."""
    axes = [_unit(axis) for axis in np.asarray(matrix[:3, :3], np.float64).T]
    return not any(axis is None for axis in axes) and float(np.linalg.det(np.array(axes))) < 0


def without_stretch(matrix: Matrix) -> Matrix:
    """Return the nearest 3×3 rotation or reflection (polar decomposition): a mirrored sky stays mirrored."""
    u, _, vt = np.linalg.svd(matrix[:3, :3])
    return np.asarray(u @ vt)


def stretch_of(matrix: Matrix) -> Matrix | None:
    """Return what a matrix does besides turning and moving, 4×4, a mirror included; None where it squeezes flat."""
    u, sizes, vt = np.linalg.svd(matrix[:3, :3])
    if sizes.min() <= 1e-9 * sizes.max():
        return None
    stretch = np.eye(4)
    stretch[:3, :3] = vt.T @ np.diag(sizes) @ vt * np.sign(np.linalg.det(u @ vt))
    return stretch


@dataclass(frozen=True)
class Facing:
    """How a camera or a lamp moves that sits on something: `facing` at any time."""

    motion: Motion

    @property
    def duration_s(self) -> float:
        """Length of the motion [s]."""
        return self.motion.duration_s

    def pose(self, time_s: float) -> Matrix:
        """Return the pose at that time."""
        return facing(self.motion.pose(time_s))


def _unit(axis: Matrix, least: float = 0.0) -> Matrix | None:
    """Return an axis of length 1, however long it is; None where it is no longer than that."""
    largest = float(np.abs(axis).max())
    if not largest > least:
        return None
    scaled = axis / largest
    return np.asarray(scaled / np.linalg.norm(scaled))


def across(axis: Matrix) -> Matrix:
    """Return a unit vector at right angles to an axis, the one that Mitsuba takes (Duff et al., JCGT 2017)."""
    x, y, z = axis / np.linalg.norm(axis)
    sign = np.copysign(1.0, z)
    share = -x / (sign + z)
    return np.array((1.0 + sign * x * share, sign * y * share, -sign * x))


def quaternion_of(rotation: Matrix) -> Quaternion:
    """Return the quaternion x, y, z, w of a 3×3 rotation, by its largest component (Shepperd, JGC 1978)."""
    m, trace = rotation, float(np.trace(rotation))
    diagonal = np.array([m[0, 0], m[1, 1], m[2, 2], trace])
    k = int(np.argmax(diagonal))
    if k == 3:
        q = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], 1 + trace])
    else:
        i, j = (k + 1) % 3, (k + 2) % 3
        q = np.zeros(4)
        q[k] = 1 - trace + 2 * m[k, k]
        q[i], q[j] = m[i, k] + m[k, i], m[j, k] + m[k, j]
        q[3] = m[j, i] - m[i, j]
    x, y, z, w = (q / np.linalg.norm(q)).tolist()
    return x, y, z, w


def quaternions_of(rotations: Matrix) -> Matrix:
    """Return the quaternions x, y, z, w ``[n, 4]`` of rotations ``[n, 3, 3]``, with w ≥ 0.

    Each is a row of 4·q·qᵀ, whose entries are sums of the rotation's: the row with the largest number on the diagonal.
    """
    m = np.moveaxis(rotations, 0, -1)
    xx, yy, zz = m[0, 0], m[1, 1], m[2, 2]
    xy, xz, yz = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
    xw, yw, zw = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    products = np.array([
        [1 + xx - yy - zz, xy, xz, xw],
        [xy, 1 - xx + yy - zz, yz, yw],
        [xz, yz, 1 - xx - yy + zz, zw],
        [xw, yw, zw, 1 + xx + yy + zz],
    ])  # fmt: skip
    largest = np.argmax(np.einsum("iin->in", products), axis=0)
    found: Matrix = products[largest, :, np.arange(len(largest))]
    found *= np.where(found[:, 3:] < 0, -1.0, 1.0) / np.linalg.norm(found, axis=1, keepdims=True)
    return found


def rotation_vectors(rotations: Matrix) -> Matrix:
    """Return the axes of rotations ``[n, 3, 3]``, each as long as its angle, up to π [rad]: ``[n, 3]``."""
    quaternions = quaternions_of(rotations)
    sine = np.linalg.norm(quaternions[:, :3], axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, quaternions[:, 3:])
    found: Matrix = quaternions[:, :3] * np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0)
    return found


def rotation_about(axis: Matrix, angle: float) -> Matrix:
    """Return the 3×3 rotation about an axis by Rodrigues' formula [rad]."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: Matrix = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return rotation
