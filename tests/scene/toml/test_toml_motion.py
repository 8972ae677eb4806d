"""How things of a TOML file move: what its keys mean, by closed forms."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from clsim.scene import World, load_world

ROOM = """
[environment]
radiance = [0.2, 0.2, 0.2]
[materials.grey]
[[objects]]
name = "box"
shape = "box"
size = [1.0, 2.0, 4.0]
material = "grey"
BOX
"""


def world(folder: Path, camera: str, box: str = "") -> World:
    path = folder / "scene.toml"
    path.write_text(f"[camera]\nresolution = [8, 6]\n{camera}\n{ROOM.replace('BOX', box)}")
    return load_world(path)


number = st.integers(-50, 50).map(lambda n: n / 10)


@settings(max_examples=20)
@given(st.tuples(number, number, number), st.tuples(number, number, number), st.booleans())
def test_an_orbit_looks_at_its_own_point_else_at_the_cameras_else_at_its_centre(tmp_path_factory, own, other, told):
    """Ten times around, whichever of both points is told."""
    center, radius_m, height_m = np.array((0.5, 0.1, -0.25)), 7.77, 1.23
    orbit = (
        f"center = {center.tolist()}, radius_m = {radius_m}, height_m = {height_m}, period_s = 2.0, start_deg = 30.0"
    )
    folder = tmp_path_factory.mktemp("orbit")
    cases = (
        (f"orbit = {{ {orbit}, look_at = {list(own)} }}\n" + (f"look_at = {list(other)}" if told else ""), own),
        (f"orbit = {{ {orbit} }}\nlook_at = {list(other)}", other),
        (f"orbit = {{ {orbit} }}", center),
    )
    for camera, target in cases:
        motion = world(folder, camera).camera.motion
        for time_s in np.linspace(0.0, 2.0, 10):
            pose, angle = motion.pose(time_s), math.radians(30 + 180 * time_s)
            place = np.add(center, (radius_m * math.sin(angle), height_m, radius_m * math.cos(angle)))
            np.testing.assert_allclose(pose[:3, 3], place, atol=1e-9)
            way = np.asarray(target) - place
            np.testing.assert_allclose(-pose[:3, 2], way / np.linalg.norm(way), atol=1e-9)


def test_keyframes_look_at_their_own_points_and_where_they_have_none_at_the_cameras(tmp_path):
    keys = (
        "keyframes = [{ time_s = 0, position = [0, 0, 4], look_at = [1, 0, 0] }, { time_s = 1, position = [0, 0, 6] }]"
    )
    motion = world(tmp_path, f"{keys}\nlook_at = [0, 2, 0]").camera.motion
    for time_s, position, target in (
        (0.0, (0, 0, 4), (1, 0, 0)),
        (0.5, (0, 0, 5), (0.5, 1, 0)),
        (1, (0, 0, 6), (0, 2, 0)),
    ):
        way = np.subtract(target, position)
        np.testing.assert_allclose(-motion.pose(time_s)[:3, 2], way / np.linalg.norm(way), atol=1e-12)


@settings(max_examples=30)
@given(st.tuples(*[st.integers(-180, 180)] * 3), st.tuples(number, number, number))
def test_angles_turn_about_x_then_y_then_z_whoever_they_are_of(tmp_path_factory, angles, place):
    turn = f"rotation_deg = {list(angles)}"
    still = f"position = {list(place)}\n{turn}"
    key = f"keyframes = [{{ time_s = 0, position = {list(place)}, {turn} }}]"
    expected = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    for words in (still, key):
        found = world(tmp_path_factory.mktemp("turn"), words, words)
        for motion in (found.camera.motion, found.instances[0].motion):
            np.testing.assert_allclose(motion.pose(0.0)[:3, :3], expected, atol=1e-9)
            np.testing.assert_allclose(motion.pose(0.0)[:3, 3], place, atol=1e-12)


@pytest.mark.parametrize(("scale", "factors"), [("2.5", (2.5, 2.5, 2.5)), ("[0.5, 3.0, 2.0]", (0.5, 3.0, 2.0))])
def test_boxes_have_their_size_times_their_scale_about_their_middle(tmp_path, scale, factors):
    vertices = world(tmp_path, "position = [0, 0, 9]", f"position = [1, 2, 3]\nscale = {scale}").meshes[0].vertices
    half = np.multiply(factors, (0.5, 1.0, 2.0))
    np.testing.assert_allclose([vertices.min(axis=0), vertices.max(axis=0)], [-half, half], rtol=1e-6)


def test_a_lens_of_so_many_millimetres_sees_what_its_sensor_covers(tmp_path):
    """A 50 mm lens before a sensor 36 mm wide sees 36/50 of the distance."""
    camera = world(tmp_path, "position = [0, 0, 9]\nfocal_length_mm = 50.0\nsensor_width_mm = 36.0").camera
    assert 2 * math.tan(math.radians(camera.fov_deg) / 2) == pytest.approx(36 / 50)


def test_what_a_camera_of_a_rig_does_not_say_is_the_rigs(tmp_path):
    more = "resolution = [4, 2]\nfov_deg = 33.0\nshutter_s = 0.02"
    cameras = f'[[cameras]]\nname = "a"\n[[cameras]]\nname = "b"\nposition = [0.5, 0.0, 0.0]\n{more}\n'
    found = world(tmp_path, f"position = [1, 2, 3]\nfov_deg = 70.0\nshutter_s = 0.01\n{cameras}")
    own, other = (mount.camera(found.camera) for mount in found.rig)
    assert (own.width, own.height, own.fov_deg, own.shutter_s) == (8, 6, 70.0, 0.01)
    assert (other.width, other.height, other.fov_deg, other.shutter_s) == (4, 2, 33.0, 0.02)
    assert other.motion.pose(0.0)[:3, 3] == pytest.approx((1.5, 2, 3))


@pytest.mark.parametrize("looking", [True, False])
def test_cubic_keyframes_are_joined_by_natural_splines_and_others_by_lines(tmp_path, looking):
    times, places = (0.0, 1.0, 3.0), ((0.0, 0.0, 5.0), (2.0, 1.0, 5.0), (0.0, 4.0, 6.0))
    keys = ", ".join(f"{{ time_s = {at}, position = {list(place)} }}" for at, place in zip(times, places, strict=True))
    more = "look_at = [0.0, 0.0, 0.0]\n" if looking else ""
    curves = {
        "cubic": CubicSpline(times, places, bc_type="natural"),
        "linear": lambda time_s: [np.interp(time_s, times, along) for along in zip(*places, strict=True)],
    }
    for interpolation, curve in curves.items():
        words = f'keyframes = [{keys}]\ninterpolation = "{interpolation}"\n{more}'
        found = world(tmp_path, words, words.removesuffix(more))
        for motion in (found.camera.motion, found.instances[0].motion):
            for time_s in np.linspace(0.0, 3.0, 7):
                np.testing.assert_allclose(motion.pose(time_s)[:3, 3], curve(time_s), atol=1e-9)
