"""Rotations as quaternions and as vectors, against scipy."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from clsim.scene.rigid import facing, mirrors, quaternions_of, rotation_vectors, stretch_of


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


FINITE = st.floats(allow_nan=False, allow_infinity=False)
LENGTHS = st.one_of(FINITE, st.floats(-10, 10), st.sampled_from([0.0, 1.0, -1.0]))


@settings(max_examples=300, deadline=None)
@given(arrays(np.float64, (3, 3), elements=LENGTHS))
def test_any_finite_matrix_faces_where_its_axis_leads(linear: np.ndarray) -> None:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, (1, 2, 3)
    with np.errstate(all="raise", under="ignore"):
        pose = facing(matrix)
    turn = pose[:3, :3]
    np.testing.assert_allclose(turn.T @ turn, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) > 0
    np.testing.assert_array_equal(pose[:3, 3], (1, 2, 3))
    back, up = (axis / np.abs(axis).max() if axis.any() else axis for axis in linear.T[[2, 1]])
    if back.any():
        np.testing.assert_allclose(turn[:, 2], back / np.linalg.norm(back), atol=1e-12)
        up = up / max(np.linalg.norm(up), 1e-300)
        if np.linalg.norm(np.cross(up, turn[:, 2])) > 1e-6:
            assert turn[:, 1] @ up > 0 and abs(turn[:, 0] @ up) < 1e-9


def test_rotations_face_as_they_are() -> None:
    for turn in Rotation.random(20, random_state=1).as_matrix():
        matrix = np.eye(4)
        matrix[:3, :3] = 3.5 * turn
        np.testing.assert_allclose(facing(matrix)[:3, :3], turn, atol=1e-14)
        assert not mirrors(matrix) and mirrors(matrix @ np.diag((1, -1, 1, 1)))


@pytest.mark.parametrize("sizes", [(1.0, 2.0, 3.0), (1.0, -2.0, 3.0)], ids=["plain", "mirrored"])
def test_what_is_left_without_its_stretch_only_turns(sizes: tuple[float, ...]) -> None:
    for before, after in zip(*(Rotation.random(10, random_state=k).as_matrix() for k in (1, 2)), strict=True):
        matrix = np.eye(4)
        matrix[:3, :3] = before @ np.diag(sizes) @ after
        stretch = stretch_of(matrix)
        assert stretch is not None
        turn = (matrix @ np.linalg.inv(stretch))[:3, :3]
        np.testing.assert_allclose(turn.T @ turn, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) > 0
    assert stretch_of(np.diag((1.0, 0.0, 1.0, 1.0))) is None


AXES = arrays(np.float64, 3, elements=st.floats(-10, 10)).filter(lambda axis: np.linalg.norm(axis) > 0.1)


@given(AXES, AXES, st.sampled_from([0.0, 1.0, -2.5]))
def test_what_has_no_upright_of_its_own_leans_as_its_right_does(
    back: np.ndarray, right: np.ndarray, along: float
) -> None:
    """Its y axis is nothing, or lies along the axis that it faces along: then x tells which way up it is."""
    assume(np.linalg.norm(np.cross(back, right)) > 0.1)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([right, along * back, back], axis=1)
    turn = facing(matrix)[:3, :3]
    assert turn[:, 2] @ back == pytest.approx(np.linalg.norm(back))
    assert turn[:, 0] @ right > 0 and turn[:, 1] @ right == pytest.approx(0, abs=1e-9)


@given(AXES, AXES)
def test_what_is_squeezed_flat_along_its_axis_faces_across_the_other_two(right: np.ndarray, up: np.ndarray) -> None:
    across = np.cross(right, up)
    assume(np.linalg.norm(across) > 0.1)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([right, up, np.zeros(3)], axis=1)
    turn = facing(matrix)[:3, :3]
    np.testing.assert_allclose(turn[:, 2], across / np.linalg.norm(across), atol=1e-9)
    np.testing.assert_allclose(turn[:, 1], up / np.linalg.norm(up), atol=1e-9)
