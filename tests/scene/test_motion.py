"""Motion: scipy is the oracle for rotations; the rest are laws."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from clsim.errors import InputError
from clsim.scene.motion import (
    Attached,
    Keyframes,
    LookAtKeyframes,
    Orbit,
    Static,
    compose,
    euler_quaternion,
    look_at,
    rotation_matrix,
    slerp,
    slerp_rows,
)

coordinate = st.floats(-10, 10)
point = st.tuples(coordinate, coordinate, coordinate)
angles = st.tuples(*[st.floats(-360, 360)] * 3)
share = st.floats(0, 1)


def assert_rigid(matrix):
    np.testing.assert_allclose(matrix[:3, :3].T @ matrix[:3, :3], np.eye(3), atol=1e-9)
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1)
    np.testing.assert_array_equal(matrix[3], (0, 0, 0, 1))


@given(angles)
def test_euler_angles_turn_about_the_fixed_axes_in_the_order_x_y_z(rotation_deg):
    expected = Rotation.from_euler("xyz", rotation_deg, degrees=True).as_matrix()
    np.testing.assert_allclose(rotation_matrix(euler_quaternion(rotation_deg)), expected, atol=1e-9)


@given(angles, angles, share)
def test_slerp_agrees_with_scipy(start_deg, end_deg, weight):
    start, end = (Rotation.from_euler("xyz", a, degrees=True) for a in (start_deg, end_deg))
    if abs(abs(start.as_quat() @ end.as_quat())) < 1e-3:
        return  # half a turn apart, either way round is right
    expected = Slerp([0, 1], Rotation.concatenate([start, end]))(weight).as_matrix()
    np.testing.assert_allclose(rotation_matrix(slerp(start.as_quat(), end.as_quat(), weight)), expected, atol=1e-6)


@given(st.lists(st.tuples(angles, angles), min_size=1, max_size=5), share)
def test_many_turn_as_each_of_them_does(pairs, weight):
    ends = [[Rotation.from_euler("xyz", a, degrees=True).as_quat() for a in pair] for pair in zip(*pairs, strict=True)]
    start, end = (np.array(each) for each in ends)
    # Half a turn apart, either way round is right.
    clear = np.abs((start * end).sum(axis=1)) > 1e-3
    start, end = start[clear], end[clear]
    expected = np.reshape([slerp(a, b, weight) for a, b in zip(start, end, strict=True)], (-1, 4))
    np.testing.assert_allclose(slerp_rows(start, end, weight), expected, atol=1e-9)


@given(st.lists(st.tuples(point, angles), min_size=1, max_size=5), st.floats(-1, 6))
def test_keyframes_are_rigid_everywhere_and_hit_exactly(keys, time_s):
    times = tuple(float(i) for i in range(len(keys)))
    motion = Keyframes(times, tuple(p for p, _ in keys), tuple(euler_quaternion(a) for _, a in keys))
    assert_rigid(motion.pose(time_s))
    for key_time_s, (position, rotation_deg) in zip(times, keys, strict=True):
        pose = motion.pose(key_time_s)
        assert tuple(pose[:3, 3]) == position
        expected = Rotation.from_euler("xyz", rotation_deg, degrees=True).as_matrix()
        np.testing.assert_allclose(pose[:3, :3], expected, atol=1e-12)


def test_positions_between_keyframes_are_linear_and_are_held_outside():
    motion = Keyframes((1.0, 3.0), ((0, 0, 0), (4, 8, -2)), ((0, 0, 0, 1),) * 2)
    np.testing.assert_allclose(motion.pose(1.5)[:3, 3], (1, 2, -0.5))
    np.testing.assert_array_equal(motion.pose(0.0)[:3, 3], (0, 0, 0))
    np.testing.assert_array_equal(motion.pose(9.0)[:3, 3], (4, 8, -2))
    assert motion.duration_s == 3.0


@given(point, point)
def test_look_at_points_minus_z_at_the_target_and_keeps_the_horizon_level(eye, target):
    if math.dist(eye, target) < 1e-3:
        return
    pose = look_at(eye, target)
    assert_rigid(pose)
    np.testing.assert_allclose(-pose[:3, 2] * math.dist(eye, target), np.subtract(target, eye), atol=1e-9)
    if math.hypot(target[0] - eye[0], target[2] - eye[2]) > 1e-3:
        assert pose[1, 0] == pytest.approx(0, abs=1e-9)
        assert pose[1, 1] >= 0


@pytest.mark.parametrize("length", [1e-9, 0.1, 1e9])
def test_how_long_the_way_up_is_matters_not(length):
    eye, target, up = (1, 2, 3), (0, 1, -4), np.array((0.6, 0.0, 0.8))
    np.testing.assert_allclose(look_at(eye, target, length * up), look_at(eye, target, up), atol=1e-12)
    assert look_at(eye, target, up)[:3, 0] @ up == pytest.approx(0, abs=1e-12), "right is across up"


@pytest.mark.parametrize("target", [(0, 1, 0), (0, -1, 0)])
def test_look_straight_up_or_down_is_rigid(target):
    pose = look_at((0, 0, 0), target)
    assert_rigid(pose)
    np.testing.assert_allclose(-pose[:3, 2], target)
    # As on the way there from −z ahead: what is ahead is at the top below, and what is behind above.
    np.testing.assert_allclose(pose[:3, 1], (0, 0, target[1]))


def test_look_at_without_a_way_up_still_is_a_rotation():
    turn = look_at((0, 0, 0), (1.0, 2.0, -3.0), (0.0, 0.0, 0.0))[:3, :3]
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)


def test_look_at_keyframes_move_position_and_target():
    motion = LookAtKeyframes((0.0, 2.0), ((0, 0, 4), (2, 0, 4)), ((0, 0, 0), (2, 0, 0)))
    np.testing.assert_allclose(motion.pose(1.0), compose((1, 0, 4), np.eye(3)), atol=1e-12)


@given(point, st.floats(0.1, 10), st.floats(0.1, 10), coordinate, st.floats(-360, 360), st.booleans(), st.floats(0, 20))
def test_an_orbit_keeps_radius_and_height_and_closes(center, radius, period_s, height, start_deg, clockwise, time_s):
    motion = Orbit(center, radius, period_s, height, start_deg, clockwise=clockwise, target=(0, 99, 0))
    pose = motion.pose(time_s)
    assert_rigid(pose)
    x, y, z = pose[:3, 3] - center
    assert math.hypot(x, z) == pytest.approx(radius)
    assert y == pytest.approx(height)
    np.testing.assert_allclose(motion.pose(time_s + period_s), pose, atol=1e-6)
    assert motion.duration_s == period_s


def test_an_orbit_runs_counter_clockwise_from_plus_z_and_stops_where_told():
    motion = Orbit((1, 0, 0), 2.0, 4.0, degrees=180.0)
    np.testing.assert_allclose(motion.pose(0.0)[:3, 3], (1, 0, 2), atol=1e-12)
    np.testing.assert_allclose(motion.pose(1.0)[:3, 3], (3, 0, 0), atol=1e-12)
    np.testing.assert_allclose(motion.pose(2.0)[:3, 3], (1, 0, -2), atol=1e-12)
    np.testing.assert_allclose(motion.pose(3.0)[:3, 3], (1, 0, -2), atol=1e-12)
    assert motion.duration_s == 2.0
    np.testing.assert_array_equal(motion.pose(1.0)[:3, :3], np.eye(3))
    clockwise = Orbit((1, 0, 0), 2.0, 4.0, clockwise=True)
    np.testing.assert_allclose(clockwise.pose(1.0)[:3, 3], (-1, 0, 0), atol=1e-12)


def test_attached_moves_with_its_parent():
    parent = Keyframes((0.0, 1.0), ((0, 0, 0), (2, 0, 0)), (euler_quaternion((0, 0, 0)), euler_quaternion((0, 90, 0))))
    offset = compose((0, 0, 1), np.eye(3))
    np.testing.assert_allclose(Attached(parent, offset).pose(1.0)[:3, 3], (3, 0, 0), atol=1e-12)
    assert Attached(parent, offset).duration_s == 1.0
    assert Static(offset).duration_s == 0.0


@pytest.mark.parametrize(
    "make",
    [
        lambda: Keyframes((), (), ()),
        lambda: Keyframes((0.0, 0.0), ((0, 0, 0),) * 2, ((0, 0, 0, 1),) * 2),
        lambda: Keyframes((0.0, 1.0), ((0, 0, 0),), ((0, 0, 0, 1),)),
        lambda: Keyframes((0.0,), ((0, 0, 0),), ((0, 0, 0, 0),)),
        lambda: LookAtKeyframes((0.0,), ((1, 2, 3),), ((1, 2, 3),)),
        lambda: LookAtKeyframes((0.0, 1.0), ((-1, 0, 0), (1, 0, 0)), ((0, 0, 0),) * 2),  # meets between the keys
        lambda: Orbit((0, 0, 0), 0.0, 1.0),
        lambda: Orbit((0, 0, 0), 1.0, 1.0, target=(1, 0, 0)),
    ],
)
def test_impossible_motions_are_refused(make):
    with pytest.raises(InputError):
        make()


@given(st.floats(-360, 360), st.floats(1, 1000), st.booleans(), st.floats(0, 30))
def test_an_orbit_of_so_many_degrees_holds_its_ends(start_deg, degrees, clockwise, beyond_s):
    motion = Orbit((1, 0, 0), 2.0, 4.0, 0.5, start_deg, degrees, clockwise, target=(0, 9, 0))
    np.testing.assert_array_equal(motion.pose(-beyond_s), motion.pose(0.0))
    np.testing.assert_allclose(motion.pose(motion.duration_s + beyond_s), motion.pose(motion.duration_s), atol=1e-9)
    turned = math.radians(start_deg - degrees if clockwise else start_deg + degrees)
    expected = (1 + 2 * math.sin(turned), 0.5, 2 * math.cos(turned))
    np.testing.assert_allclose(motion.pose(motion.duration_s)[:3, 3], expected, atol=1e-9)
