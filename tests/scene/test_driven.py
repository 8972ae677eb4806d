"""Poses that are set from outside, against scipy: how they are read, and what lies between them."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from clsim.errors import InputError
from clsim.scene import Camera, Instance, Static, World
from clsim.scene.driven import Driven, matrix_of, placed, read_place, stands_still, with_driven
from clsim.scene.motion import Attached, Nested

TURN = Rotation.from_euler("xyz", (20, -70, 130), degrees=True)


def matrix(position, rotation, scale=1.0):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = scale * rotation.as_matrix(), position
    return pose


@pytest.mark.parametrize("kind", [tuple, list])
def test_a_place_is_a_matrix_or_a_pair(kind):
    pair = read_place("pose", kind([(1.0, 2.0, 3.0), TURN.as_quat()]))
    np.testing.assert_allclose(matrix_of(pair), matrix((1, 2, 3), TURN), atol=1e-12)
    for scale in (1.0, 0.25, 3.0):
        pose = matrix((1, 2, 3), TURN, scale)
        place = read_place("pose", pose.tolist())
        assert place[2] == pytest.approx(scale)
        np.testing.assert_allclose(matrix_of(place), pose, atol=1e-12)


@pytest.mark.parametrize(
    "value",
    [
        ((1, 2), (0, 0, 0, 1)),
        ((1, 2, 3), (0, 0, 1)),
        ((1, 2, 3), (0, 0, 0, 1.02)),
        ((1, 2, 3), (0, 0, 0, 0.98)),
        ((1, 2, np.nan), (0, 0, 0, 1)),
        ((1, 2, 3), (0, 0, 0, 1), 1),
        np.eye(3),
        np.diag((1, 1, -1, 1)),
        np.diag((1, 2, 1, 1)),
        np.diag((1, 1, 1, 2)),
        np.diag((np.inf, np.inf, np.inf, 1)),
        "here",
        None,
    ],
)
def test_what_is_no_place_is_named(value):
    with pytest.raises(InputError, match="`hand` must be a 4×4 matrix of a rotation, at most one positive scale"):
        read_place("hand", value)


def test_a_pose_lies_on_the_line_and_on_the_shortest_turn_between_keys():
    motion = Driven(Static(matrix((7, 8, 9), TURN)))
    assert motion.last_s is None and stands_still(motion) and motion.duration_s > 0
    np.testing.assert_array_equal(motion.pose(5.0), matrix((7, 8, 9), TURN))
    rotations = Rotation.concatenate([Rotation.identity(), TURN, TURN * TURN])
    times, places, scales = (1.0, 2.0, 4.0), np.array([(0, 0, 0), (1, 2, 3), (-1, 0, 5)]), (1.0, 2.0, 0.5)
    motion.set(1.0, read_place("pose", np.eye(4) * (3, 3, 3, 1)))  # replaced by the next one
    for time_s, *place in zip(times, places, rotations, scales, strict=True):
        motion.set(time_s, read_place("pose", matrix(*place)))
    assert (motion.last_s, motion.duration_s, len(motion.keys)) == (4.0, 4.0, 3)
    turns = Slerp(times, rotations)

    def check(some_s):
        for time_s in some_s:
            now = min(max(time_s, 1.0), 4.0)
            place = [np.interp(now, times, column) for column in places.T]
            wanted = matrix(place, turns(now), np.interp(now, times, scales))
            np.testing.assert_allclose(motion.pose(time_s), wanted, atol=1e-9)

    check((0.0, 1.0, 1.25, 2.0, 3.0, 3.9, 4.0, 9.0))
    motion.forget_before(2.5)
    assert [key[0] for key in motion.keys] == [2.0, 4.0]
    check((2.5, 3.0, 4.0, 9.0))
    motion.release()
    np.testing.assert_array_equal(motion.pose(3.0), matrix((7, 8, 9), TURN))


@given(st.floats(1e-3, 1e3), st.integers(0, 2**32 - 1))
@example(1.005, 0)
@example(0.9999, 1)
def test_a_place_keeps_any_scale_however_near_to_1(scale, seed):
    """A thing that grows slowly must not wait until it has grown by a percent."""
    pose = matrix((1, 2, 3), Rotation.random(random_state=seed), scale)
    np.testing.assert_allclose(matrix_of(read_place("pose", pose)), pose, atol=2e-6 * scale)


@pytest.mark.parametrize("depth", [0, 1, 2])
def test_a_part_that_moves_in_itself_goes_with_the_whole_that_is_driven(depth):
    """However many motions are in one another: it keeps its place in the whole, and what it does there."""
    own, offset = matrix((0, 1, 0), TURN), matrix((3, 0, 0), TURN.inv())
    part = Attached(Static(matrix((9, 9, 9), TURN)), offset)
    for _ in range(depth):
        part = Nested(part, Static(own))
    world = World("thing", Camera(4, 3, 50.0, Static(np.eye(4))), (), (Instance(0, part, "arm/hand"),), ())
    driven = {"arm": Driven(placed(world)["arm"])}
    hand = with_driven(world, driven).instances[0].motion
    wanted = offset @ np.linalg.matrix_power(own, depth)
    np.testing.assert_allclose(hand.pose(1.0), matrix((9, 9, 9), TURN) @ wanted, atol=1e-12)
    driven["arm"].set(0.0, read_place("pose", matrix((1, 2, 3), TURN * TURN)))
    np.testing.assert_allclose(hand.pose(1.0), matrix((1, 2, 3), TURN * TURN) @ wanted, atol=1e-9)
