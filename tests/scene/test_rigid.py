"""Rotations as quaternions and as vectors, against scipy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from clsim.scene.rigid import quaternions_of, rotation_vectors


def turns(kind: str) -> np.ndarray:
    """Axes times angles [rad] ``[n, 3]``."""
    rng = np.random.default_rng(3)
    axes = rng.normal(size=(500, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    tiny = 10.0 ** rng.uniform(-13, -1, 500)
    angles = {"any": rng.uniform(0, np.pi, 500), "tiny": tiny, "nearly half a turn": np.pi - tiny}[kind]
    return axes * angles[:, None]


@pytest.mark.parametrize("kind", ["any", "tiny", "nearly half a turn"])
def test_vectors_are_those_that_rotations_were_made_of(kind: str) -> None:
    expected = turns(kind)
    found = rotation_vectors(Rotation.from_rotvec(expected).as_matrix())
    # At half a turn both ways round are the same.
    off = np.minimum(np.abs(found - expected).max(axis=1), np.abs(found + expected).max(axis=1))
    assert off[np.linalg.norm(expected, axis=1) > np.pi - 1e-6].max(initial=0.0) < 1e-14
    assert np.abs(found - expected)[np.linalg.norm(expected, axis=1) <= np.pi - 1e-6].max(initial=0.0) < 1e-14


@pytest.mark.parametrize("kind", ["any", "tiny", "nearly half a turn"])
def test_quaternions_are_scipys(kind: str) -> None:
    rotations = Rotation.from_rotvec(turns(kind))
    found = quaternions_of(rotations.as_matrix())
    expected = rotations.as_quat(canonical=True)
    assert (found[:, 3] >= 0).all()
    assert np.minimum(np.abs(found - expected).max(axis=1), np.abs(found + expected).max(axis=1)).max() < 1e-14


def test_what_does_not_turn_has_a_vector_of_nothing() -> None:
    assert not rotation_vectors(np.eye(3)[None]).any()
    assert quaternions_of(np.zeros((0, 3, 3))).shape == (0, 4)
