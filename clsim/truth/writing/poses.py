"""Poses as rows of numbers and as matrices."""

from __future__ import annotations

import numpy as np

from clsim.scene.rigid import quaternions_of
from clsim.truth.record import F64


def matrices(poses: F64) -> F64:
    """Return ``[n, 4, 4]`` of rows x y z qx qy qz qw ``[n, 7]``."""
    from scipy.spatial.transform import Rotation

    found = np.tile(np.eye(4), (len(poses), 1, 1))
    if len(poses):
        found[:, :3, :3] = Rotation.from_quat(poses[:, 3:]).as_matrix()
        found[:, :3, 3] = poses[:, :3]
    return found


def rows(matrices: F64) -> F64:
    """Return x y z qx qy qz qw ``[n, 7]`` of matrices ``[n, 4, 4]``."""
    return np.concatenate([matrices[:, :3, 3], quaternions_of(matrices[:, :3, :3])], axis=1)
