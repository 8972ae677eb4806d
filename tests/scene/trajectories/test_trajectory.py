"""Trajectory files and splines through keyframes, against scipy and by hand."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, Slerp

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.trajectories.trajectory import read_tum

TUM = """# time tx ty tz qx qy qz qw
1305031102.5 1 2 3 0 0 0 1

1305031103.0 2 2 3 0 0.7071068 0 0.7071068
1305031104.5 2 4 3 0.5 0.5 0.5 0.5
"""


def write(tmp_path, text):
    path = tmp_path / "poses.txt"
    path.write_text(text)
    return path


@pytest.mark.parametrize("axes", ["opencv", "opengl"])
def test_tum_poses_are_met_and_joined_by_slerp(tmp_path, axes):
    motion = read_tum(write(tmp_path, TUM), axes=axes)
    assert motion.duration_s == pytest.approx(2.0)
    times = [0, 0.5, 2.0]
    turns = Rotation.from_quat([(0, 0, 0, 1), (0, 0.7071068, 0, 0.7071068), (0.5, 0.5, 0.5, 0.5)])
    for time_s in (0, 0.25, 0.5, 1.7, 2.0, 5.0):
        pose, clipped = motion.pose(time_s), min(time_s, 2.0)
        np.testing.assert_allclose(
            pose[:3, 3], [np.interp(clipped, times, row) for row in ((1, 2, 2), (2, 2, 4), (3, 3, 3))]
        )
        theirs = Slerp(times, turns)(clipped).as_matrix()
        # The benchmark's camera looks along its own +z, ours along −z.
        ahead, up = (theirs[:, 2], -theirs[:, 1]) if axes == "opencv" else (-theirs[:, 2], theirs[:, 1])
        np.testing.assert_allclose(-pose[:3, 2], ahead, atol=1e-6)
        np.testing.assert_allclose(pose[:3, 1], up, atol=1e-6)
        assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)


def test_one_pose_stands_still(tmp_path):
    motion = read_tum(write(tmp_path, "7 1 2 3 0 0 0 1\n"))
    assert motion.duration_s == 0
    np.testing.assert_allclose(motion.pose(3.0)[:3, 3], (1, 2, 3))


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "no poses"),
        ("# only a comment\n", "no poses"),
        ("0 1 2 3 0 0 0\n", "poses.txt:1"),
        ("\n0 1 2 3 0 0 0 x\n", "poses.txt:2"),
        ("0 1 2 3 0 0 0 1 9\n", "poses.txt:1"),
        ("0 1 2 nan 0 0 0 1\n", "not finite"),
        ("time x y z qx qy qz qw\n", "tx ty tz qx qy qz qw; begin a header with #"),
        ("nan 1 2 3 0 0 0 1\n", "not finite"),
        ("0 1 2 3 0 0 0 1\ninf 1 2 3 0 0 0 1\n", "poses.txt:2: has a number that is not finite"),
        ("0 1 2 3 0 0 0 0\n", "length 0"),
        ("1 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", "poses.txt:2: time 1"),
    ],
)
def test_broken_trajectories(tmp_path, text, part):
    with pytest.raises(InputError) as caught:
        read_tum(write(tmp_path, text))
    assert part in str(caught.value) and "poses.txt" in str(caught.value)


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(text=st.text(alphabet="0123456789.e-+ \n#naif", max_size=80))
def test_any_text_is_read_or_refused(tmp_path, text):
    try:
        read_tum(write(tmp_path, text))
    except InputError as error:
        assert "poses.txt" in str(error)


def scene(tmp_path, camera):
    path = tmp_path / "scene.toml"
    path.write_text(f'[camera]\n{camera}\n[[objects]]\nshape = "box"\n')
    return path


def test_a_toml_follows_a_trajectory(tmp_path):
    write(tmp_path, TUM)
    world = load_world(scene(tmp_path, 'trajectory = "poses.txt"'))
    assert world.duration_s == pytest.approx(2.0)
    np.testing.assert_allclose(world.camera.motion.pose(0)[:3, 3], (1, 2, 3))
    np.testing.assert_allclose(-world.camera.motion.pose(0)[:3, 2], (0, 0, 1), atol=1e-9)
    for camera, part in (
        ('trajectory = "../poses.txt"', "missing"),
        ('trajectory = "none.txt"', "missing"),
        ('trajectory = "poses.txt"\nposition = [0, 0, 0]', "position and trajectory"),
        ('trajectory = "poses.txt"\nlook_at = [0, 0, 0]', "direction to look in"),
    ):
        with pytest.raises(InputError, match=part):
            load_world(scene(tmp_path, camera))


def test_cubic_keyframes_follow_scipys_spline_and_keep_their_poses(tmp_path):
    keys = [(0.0, (0, 0, 9), 0), (1.0, (4, 0, 9), 40), (1.5, (4, 3, 9), 50), (4.0, (0, 0, 5), 10)]
    lines = ", ".join(f"{{ time_s = {t}, position = {list(p)}, rotation_deg = [0, {a}, 0] }}" for t, p, a in keys)
    times, places = [t for t, _, _ in keys], [p for _, p, _ in keys]
    cubic = load_world(scene(tmp_path, f'interpolation = "cubic"\nkeyframes = [{lines}]')).camera.motion
    oracle = CubicSpline(times, places, bc_type="natural")
    for time_s in (0.0, 0.3, 1.0, 1.2, 3.0, 4.0):
        np.testing.assert_allclose(cubic.pose(time_s)[:3, 3], oracle(time_s), atol=1e-12)
    np.testing.assert_allclose(cubic.pose(9.0), cubic.pose(4.0))
    for time_s, _, degrees in keys:
        np.testing.assert_allclose(
            cubic.pose(time_s)[:3, :3], Rotation.from_euler("y", degrees, degrees=True).as_matrix(), atol=1e-9
        )
    # Neither position nor rotation changes its speed with a jerk at a key, as they do along straight lines.
    linear = load_world(scene(tmp_path, f"keyframes = [{lines}]")).camera.motion
    for motion, smooth in ((cubic, True), (linear, False)):
        before, at, after = (motion.pose(1.0 + dt) for dt in (-1e-4, 0.0, 1e-4))
        jerk = np.abs(((after - at) - (at - before)) / 1e-4).max()
        assert (jerk < 0.05) == smooth


def test_cubic_keyframes_may_look_at_a_target(tmp_path):
    lines = ", ".join(f"{{ time_s = {t}, position = [{x}, 0, 9] }}" for t, x in ((0, 0), (1, 3), (2, 1)))
    motion = load_world(
        scene(tmp_path, f'interpolation = "cubic"\nlook_at = [0, 0, 0]\nkeyframes = [{lines}]')
    ).camera.motion
    for time_s in (0.0, 0.6, 2.0):
        x, y, z, _ = np.linalg.inv(motion.pose(time_s)) @ (0, 0, 0, 1)
        assert (x, y) == pytest.approx((0, 0), abs=1e-9) and z < 0


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
@pytest.mark.parametrize("turn", ["look_at = [0, 0, 0]", "rotation_deg = [0, 20, 0]"])
def test_before_its_first_keyframe_and_after_its_last_a_motion_waits(tmp_path, interpolation, turn):
    lines = ", ".join(f"{{ time_s = {t}, position = [{x}, 0, 9], {turn} }}" for t, x in ((1, 0), (2, 3), (3, 1)))
    camera = f'interpolation = "{interpolation}"\nkeyframes = [{lines}]'
    motion = load_world(scene(tmp_path, camera)).camera.motion
    for time_s, key_s in ((0.0, 1.0), (0.9, 1.0), (3.5, 3.0)):
        np.testing.assert_allclose(motion.pose(time_s), motion.pose(key_s), atol=1e-12)


@pytest.mark.parametrize(
    "comment", ["# timestamp tx ty tz qw qx qy qz", "#time, x, y, z, q_w, q_x, q_y, q_z", "# a\n#qw qx qy qz"]
)
def test_a_comment_may_tell_that_w_comes_first(tmp_path, comment):
    (tmp_path / "a.txt").write_text("# timestamp tx ty tz qx qy qz qw\n0 1 2 3 0.1 0.7 0.1 0.7\n")
    (tmp_path / "b.txt").write_text(comment + "\n0 1 2 3 0.7 0.1 0.7 0.1\n")
    plain, first = (read_tum(tmp_path / name).pose(0.0) for name in ("a.txt", "b.txt"))
    np.testing.assert_allclose(first, plain, atol=1e-12)


def test_commas_may_stand_between_numbers(tmp_path):
    (tmp_path / "a.txt").write_text("0,1,2,3,0,0,0,1\n1.5, 1, 2, 4, 0, 0, 0, 1\n")
    assert read_tum(tmp_path / "a.txt").pose(1.5)[:3, 3].tolist() == [1, 2, 4]


def test_times_in_nanoseconds_are_no_seconds(tmp_path):
    (tmp_path / "a.txt").write_text("1403636579763555584 1 2 3 0 0 0 1\n1403636579863555584 1 2 3 0 0 0 1\n")
    with pytest.raises(InputError, match=r"a.txt:1: time 1.40363658e\+18 is no time in seconds \(nanoseconds\?\)"):
        read_tum(tmp_path / "a.txt")
