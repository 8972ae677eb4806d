"""Rotations within matrices."""

from __future__ import annotations

import numpy as np

from clsim.scene.motion import Matrix, Quaternion


def without_scale(matrix: Matrix) -> Matrix:
    """Return the nearest pose without scale, shear or mirror (polar decomposition of the 3×3 part)."""
    u, _, vt = np.linalg.svd(matrix[:3, :3])
    pose: Matrix = matrix.copy()
    pose[:3, :3] = u @ np.diag((1.0, 1.0, float(np.sign(np.linalg.det(u @ vt))))) @ vt
    return pose


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
