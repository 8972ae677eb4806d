"""glTF node animation against scipy, and the motion of cameras and lights."""

import math

import numpy as np
import pygltflib
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.gltf.scene import load_gltf, read_gltf
from tests.scene.gltf.gltf_files import (
    ASSETS,
    CORNERS,
    add,
    animate,
    decoded,
    gltf,
    needs_assets,
    with_camera,
    write_gltf,
)

TIMES = [0.5, 1.0, 2.5]
MOMENTS = [0.0, 0.5, 0.7, 1.0, 1.6, 2.4999, 2.5, 9.0]


def position_at(motion, time_s):
    return motion.pose(time_s)[:3, 3]


def test_step_linear_and_cubic_translations(tmp_path):
    rng = np.random.default_rng(1)
    keys, tangents = rng.normal(size=(3, 3)), rng.normal(size=(2, 3, 3))
    spline = np.stack([tangents[0], keys, tangents[1]], axis=1)
    for interpolation, values in (("STEP", keys), ("LINEAR", keys), ("CUBICSPLINE", spline.reshape(9, 3))):
        tree = animate(with_camera(gltf()), (0, "translation", TIMES, values, interpolation))
        world = load_gltf(write_gltf(tmp_path, tree))
        assert world.duration_s == 2.5
        for time_s in MOMENTS:
            clipped = min(max(time_s, 0.5), 2.5)
            if interpolation == "STEP":
                expected = keys[np.searchsorted(TIMES, clipped, side="right") - 1]
            elif interpolation == "LINEAR":
                expected = [np.interp(clipped, TIMES, keys[:, k]) for k in range(3)]
            else:  # each segment has its own tangents at its ends
                i = min(max(int(np.searchsorted(TIMES, clipped, side="right")) - 1, 0), 1)
                segment = CubicHermiteSpline(TIMES[i : i + 2], keys[i : i + 2], [tangents[1, i], tangents[0, i + 1]])
                expected = segment(clipped)
            np.testing.assert_allclose(position_at(world.instances[0].motion, time_s), expected, atol=1e-6)


def test_linear_rotations_take_the_shorter_great_circle(tmp_path):
    keys = Rotation.random(3, random_state=2).as_quat()
    keys[1] *= -1  # the same rotation
    tree = animate(with_camera(gltf()), (0, "rotation", TIMES, keys, "LINEAR"))
    motion = load_gltf(write_gltf(tmp_path, tree)).instances[0].motion
    oracle = Slerp(TIMES, Rotation.from_quat(keys))
    for time_s in MOMENTS:
        expected = oracle(min(max(time_s, 0.5), 2.5)).as_matrix()
        np.testing.assert_allclose(motion.pose(time_s)[:3, :3], expected, atol=1e-6)


def test_children_follow_their_parents(tmp_path):
    turn = Rotation.from_euler("y", [[0], [90]], degrees=True).as_quat()
    tree = with_camera(gltf(nodes=[{"children": [1]}, {"mesh": 0, "translation": [3, 0, 0], "scale": [2, 2, 2]}]))
    animate(tree, (0, "rotation", [0, 1], turn, "LINEAR"), (1, "translation", [0, 1], [(3, 0, 0), (5, 0, 0)], "LINEAR"))
    motion = load_gltf(write_gltf(tmp_path, tree)).instances[0].motion
    expected = np.eye(4)
    expected[:3, :3] = 2 * Rotation.from_euler("y", 45, degrees=True).as_matrix()
    expected[:3, 3] = 4 * np.array([math.cos(math.pi / 4), 0, -math.sin(math.pi / 4)])
    np.testing.assert_allclose(motion.pose(0.5), expected, atol=1e-6)


@pytest.mark.parametrize("scale", [(1, 3, 1), (-1, 1, 1), (2, 2, 2)])
@pytest.mark.parametrize("where", ["leaf", "root", "keyed"])
def test_whatever_stretches_stands_where_its_matrix_puts_it(tmp_path, scale, where):
    """Poses must be rigid up to scale; stretched, mirrored and sheared meshes become copies or deformations."""
    turn = Rotation.from_euler("xyz", [[0, 0, 0], [30, 70, 20]], degrees=True)
    root, leaf = {"children": [1]}, {"mesh": 0}
    tree = with_camera(gltf(nodes=[root, leaf]))
    turned = 0 if where == "leaf" else 1
    animate(tree, (turned, "rotation", [0, 1], turn.as_quat(), "LINEAR"))
    if where == "keyed":
        animate(tree, (0, "scale", [0, 1], [(1, 1, 1), scale], "STEP"))
    else:
        (leaf if where == "leaf" else root)["scale"] = scale
    world = load_world(write_gltf(tmp_path, tree))
    instance = world.instances[0]
    mesh = world.meshes[instance.mesh]
    vertices = mesh.vertices if mesh.deformation is None else mesh.deformation.vertices_at(1.0)[0]
    pose = instance.motion.pose(1.0)
    found = vertices[mesh.triangles[0]] @ pose[:3, :3].T + pose[:3, 3]
    rotation, stretch = turn[1].as_matrix(), np.diag(scale)
    expected = CORNERS @ (rotation @ stretch if where == "leaf" else stretch @ rotation).T
    assert {tuple(row) for row in np.round(found, 5)} == {tuple(row) for row in np.round(expected, 5)}
    if where != "keyed":  # the front stays in front, mirrored or not
        normal = np.cross(found[1] - found[0], found[2] - found[0])
        inverse = np.linalg.inv(rotation @ stretch if where == "leaf" else stretch @ rotation)
        assert normal @ (inverse.T @ (0, 0, 1)) > 0


def test_animations_that_do_not_contradict_play_together_and_others_by_name(tmp_path):
    tree = with_camera(gltf(nodes=[{"mesh": 0}, {"mesh": 0}], scenes=[{"nodes": [0, 1]}]))
    animate(tree, (0, "translation", [0, 1], [(0, 0, 0), (1, 0, 0)], "LINEAR"))
    animate(tree, (1, "translation", [0, 1], [(0, 0, 0), (2, 0, 0)], "LINEAR"))
    animate(tree, (0, "translation", [0, 4], [(0, 0, 0), (0, 3, 0)], "LINEAR"))
    tree["animations"][0]["name"], tree["animations"][2]["name"] = "walk", "jump"
    path = write_gltf(tmp_path, tree)

    def ends(scene):
        world = load_world(scene)
        return [position_at(i.motion, 9.0).tolist() for i in world.instances], world

    places, world = ends(path)
    assert places == [[1, 0, 0], [2, 0, 0]]
    assert any("jump" in note for note in world.notes)
    assert not world.warnings
    for name in ("jump", "2"):
        places, world = ends(f"{path}#{name}")
        assert places == [[0, 3, 0], [0, 0, 0]]
        assert world.duration_s == 4.0
        assert not any("jump" in note for note in world.notes)
    with pytest.raises(InputError, match="no animation 'run', expected one of walk, 1, jump"):
        load_world(f"{path}#run")
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match="only glTF files have animations"):
        load_world(tmp_path / "a.obj#x")


def test_without_a_camera_the_animation_repeats_and_ends_where_it_starts(tmp_path):
    tree = animate(gltf(), (0, "translation", [0, 0.7], [(0, 0, 0), (1, 0, 0)], "LINEAR"))
    world = load_gltf(write_gltf(tmp_path, tree))
    motion = world.instances[0].motion
    assert position_at(motion, 0.35 + 2 * 0.7)[0] == pytest.approx(0.5, abs=1e-5)
    assert world.duration_s / 0.7 == pytest.approx(round(world.duration_s / 0.7), abs=1e-5)
    np.testing.assert_allclose(world.camera.motion.pose(world.duration_s), world.camera.motion.pose(0), atol=1e-9)


@pytest.mark.parametrize(
    ("channel", "part"),
    [
        ((0, "translation", [1, 0], [(0, 0, 0)] * 2, "LINEAR"), "do not increase"),
        ((0, "translation", [-1, 0], [(0, 0, 0)] * 2, "LINEAR"), "do not increase"),
        ((0, "translation", [0, 1], [(0, 0, 0)] * 3, "LINEAR"), "9 numbers, expected 2 keyframes of 1 × 3"),
        ((0, "translation", [0, 1], [(0, 0, 0)] * 2, "CUBICSPLINE"), "expected 2 keyframes of 3 × 3"),
        ((0, "rotation", [0, 1], [(0, 0, 0, 0)] * 2, "LINEAR"), "quaternion of length 0"),
        ((0, "weights", [0, 1], [0, 0], "LINEAR"), "expected 2 keyframes"),
        ((7, "scale", [0, 1], [(1, 1, 1)] * 2, "LINEAR"), "nodes[7], of 1"),
        ((0, "translation", [0, float("nan")], [(0, 0, 0)] * 2, "LINEAR"), "not finite"),
    ],
)
def test_broken_animations(tmp_path, channel, part):
    with pytest.raises(InputError) as caught:
        load_gltf(write_gltf(tmp_path, animate(gltf(), channel)))
    assert part in str(caught.value)


@needs_assets
def test_the_camera_of_a_blender_scene_follows_its_keyframes():
    source = pygltflib.GLTF2().load(str(ASSETS / "anim_camera_lights.glb"))
    world = load_world(ASSETS / "anim_camera_lights.glb")
    (animation,) = (a for a in source.animations if a.name == "camAction")
    for channel in animation.channels:
        sampler = animation.samplers[channel.sampler]
        times, values = decoded(source, sampler.input)[:, 0], decoded(source, sampler.output)
        for time_s, value in zip(times, values, strict=True):
            pose = world.camera.motion.pose(float(time_s))
            expected = Rotation.from_quat(value).as_matrix() if channel.target.path == "rotation" else value
            found = pose[:3, :3] if channel.target.path == "rotation" else pose[:3, 3]
            np.testing.assert_allclose(found, expected, atol=1e-5)
    assert world.camera.width / world.camera.height == pytest.approx(16 / 9, rel=0.01)
    assert world.camera.fov_deg == pytest.approx(50, abs=1e-4)  # as set in Blender
    assert world.duration_s == 2.0
    assert not world.sphere_lights
    point, spot, sun = world.punctual_lights
    assert point.intensity == pytest.approx((300 / (4 * math.pi),) * 3)  # Blender's 300 W
    assert spot.intensity == pytest.approx((500 / (4 * math.pi),) * 3)
    assert (spot.inner_deg, spot.outer_deg) == pytest.approx((19.125, 22.5), abs=1e-3)
    assert sun.intensity == pytest.approx((2, 2, 2))
    assert not world.warnings


def test_files_within_a_toml_keep_their_motion_and_lights(tmp_path):
    tree = animate(gltf(), (0, "translation", [0, 2], [(0, 0, 0), (4, 0, 0)], "LINEAR"))
    tree["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 683.0}]}}
    tree["nodes"].append({"translation": [0, 1, 0], "extensions": {"KHR_lights_punctual": {"light": 0}}})
    tree["scenes"][0]["nodes"].append(1)
    write_gltf(tmp_path, tree)
    assert len(read_gltf(tmp_path / "scene.gltf").lights) == 1
    toml = tmp_path / "scene.toml"
    text = '[camera]\nposition = [0, 0, 9]\n[[objects]]\nfile = "scene.gltf"\nscale = {}\nposition = [0, 5, 0]\n'
    toml.write_text(text.format("2"))
    world = load_world(toml)
    np.testing.assert_allclose(position_at(world.instances[0].motion, 1.0), (4, 5, 0), atol=1e-6)
    np.testing.assert_allclose(position_at(world.punctual_lights[0].motion, 1.0), (0, 7, 0), atol=1e-6)
    assert world.punctual_lights[0].intensity == (1, 1, 1)
    toml.write_text(text.format("[1, 2, 1]"))
    with pytest.raises(InputError, match="one scale for all axes"):
        load_world(toml)


def test_of_keyframes_at_one_time_the_last_is_played(tmp_path):
    """A jump: up to 1 s on the way to 1, from there on from 5; and the keys at 2 s are one."""
    tree = gltf()
    times, places = add(tree, [0, 1, 1, 2, 2]), add(tree, [(x, 0, 0) for x in (0, 1, 5, 6, 7)])
    channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
    tree["animations"] = [{"samplers": [{"input": times, "output": places}], "channels": [channel]}]
    world = load_world(write_gltf(tmp_path, tree))
    assert any("of keyframes at the same time the last is played (first at 1 s)" in text for text in world.warnings)
    motion = world.instances[0].motion
    assert [motion.pose(t)[0, 3] for t in (0.5, 1.0, 1.5)] == [2.5, 5.0, 6.0]
