"""glTF value by value: where points are and what materials say, against the specification's own formulas."""

import math
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from clsim.scene.gltf.scene import load_gltf
from tests.scene.gltf.gltf_files import CORNERS, add, animate, gltf, with_camera, write_gltf

seeds = st.integers(0, 2**32 - 1)


def points_at(world, time_s):
    """Return where the first mesh's vertices are in the world."""
    (instance,) = world.instances
    mesh, pose = world.meshes[instance.mesh], instance.motion.pose(time_s)
    vertices = mesh.vertices if mesh.deformation is None else mesh.deformation.vertices_at(time_s)[0]
    return vertices @ pose[:3, :3].T + pose[:3, 3]


def trs(translation, rotation, scale):
    """Return T · R · S (glTF 2.0, section 3.5.3)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_quat(rotation).as_matrix() * np.asarray(scale), translation
    return matrix


@settings(max_examples=25)
@given(seeds, st.sampled_from(["still", "translation", "rotation", "scale"]), st.integers(0, 2))
def test_points_are_where_each_nodes_translation_turn_and_scale_put_them(tmp_path_factory, seed, path, which):
    """Three nodes, one within the other, stretched unevenly and mirrored; one of them moves."""
    rng = np.random.default_rng(seed)
    values = [
        {
            "translation": rng.normal(size=3),
            "rotation": Rotation.random(random_state=int(rng.integers(1 << 31))).as_quat(),
            "scale": rng.uniform(0.3, 2.0, 3) * rng.choice([-1, 1], 3),
        }
        for _ in range(3)
    ]
    nodes = [{name: each.tolist() for name, each in node.items()} for node in values]
    nodes[0]["children"], nodes[1]["children"], nodes[2]["mesh"] = [1], [2], 0
    tree = with_camera(gltf(nodes=nodes))
    keys = [values[which].get(path)] * 2
    if path == "rotation":
        keys[1] = (Rotation.from_quat(keys[0]) * Rotation.from_rotvec(rng.normal(size=3))).as_quat()
    elif path != "still":
        keys[1] = keys[0] + rng.uniform(0.1, 0.3, 3)
    if path != "still":
        animate(tree, (which, path, [0.0, 2.0], keys, "LINEAR"))
    world = load_gltf(write_gltf(tmp_path_factory.mktemp("nodes"), tree))
    for time_s in (0.0, 0.7, 2.0):
        if path == "rotation":
            values[which][path] = Slerp([0, 2], Rotation.from_quat(keys))(time_s).as_quat()
        elif path != "still":
            values[which][path] = keys[0] + time_s / 2 * (keys[1] - keys[0])
        matrix = np.linalg.multi_dot([trs(**node) for node in values])
        expected = np.asarray(CORNERS) @ matrix[:3, :3].T + matrix[:3, 3]
        np.testing.assert_allclose(points_at(world, time_s), expected, atol=1e-4)


def test_normals_of_morph_targets_are_added_by_their_weights(tmp_path):
    """glTF 2.0, section 3.7.2.2: normals are renormalised after they are blended."""
    tree = with_camera(gltf())
    up, tilt = np.array([(0, 0, 1.0)] * 3), np.array([(1.0, 0, 0), (0, 2.0, 0), (0, 0, 0.5)])
    attributes = {"POSITION": 0, "NORMAL": add(tree, up)}
    targets = [{"POSITION": add(tree, np.zeros((3, 3))), "NORMAL": add(tree, tilt)}]
    tree["meshes"] = [{"primitives": [{"attributes": attributes, "targets": targets}], "weights": [0.25]}]
    still = load_gltf(write_gltf(tmp_path, tree)).meshes[0]
    animate(tree, (0, "weights", [0.0, 1.0], [0.0, 1.0], "LINEAR"))
    moving = load_gltf(write_gltf(tmp_path, tree)).meshes[0].deformation
    for weight, found in ((0.25, still.normals), (0.0, moving.vertices_at(0.0)[1]), (0.6, moving.vertices_at(0.6)[1])):
        blended = up + weight * tilt
        np.testing.assert_allclose(found, blended / np.linalg.norm(blended, axis=1, keepdims=True), atol=1e-6)


def one_material(tmp_path, **source):
    tree = gltf(materials=[source])
    tree["meshes"][0]["primitives"][0]["material"] = 0
    return load_gltf(write_gltf(tmp_path, tree)).materials[0]


@pytest.mark.parametrize("told", [0.0, 0.2, 0.7, 1.0, None])
def test_glossiness_is_one_less_roughness_and_full_where_nothing_is_told(tmp_path, told):
    """KHR_materials_pbrSpecularGlossiness; both are the root of α."""
    glossy = {"diffuseFactor": [0.1, 0.2, 0.3, 1.0]} | ({} if told is None else {"glossinessFactor": told})
    ours = one_material(tmp_path, extensions={"KHR_materials_pbrSpecularGlossiness": glossy})
    roughness = 0.0 if told is None else 1 - told
    rough = {"roughnessFactor": roughness, "metallicFactor": 0.0, "baseColorFactor": [0.1, 0.2, 0.3, 1.0]}
    theirs = one_material(tmp_path, pbrMetallicRoughness=rough)
    assert (ours.alpha, *ours.color) == pytest.approx((theirs.alpha, *theirs.color)) and ours.metallic == 0


def test_each_lamp_has_the_animation_that_points_at_it(tmp_path):
    """Two lamps: one changes its colour, the other its intensity; W/sr are cd / 683 (KHR_lights_punctual)."""
    lamps = [{"type": "point", "intensity": 683.0}, {"type": "spot", "intensity": 1366.0, "color": [1.0, 0.5, 0.25]}]
    nodes = [{"name": f"lamp{k}", "extensions": {"KHR_lights_punctual": {"light": k}}} for k in range(2)]
    tree = with_camera(gltf(nodes=[{"mesh": 0}, *nodes], scenes=[{"nodes": [0, 1, 2]}]))
    tree |= {"extensions": {"KHR_lights_punctual": {"lights": lamps}}, "extensionsRequired": ["KHR_animation_pointer"]}
    animate(tree, (0, "pointer", [0.0, 1.0], [[1.0, 1.0, 1.0], [0.0, 1.0, 0.5]], "LINEAR"))
    animate(tree, (0, "pointer", [0.0, 1.0], [1366.0, 683.0], "LINEAR"))
    for animation, where in zip(tree["animations"], ("0/color", "1/intensity"), strict=True):
        pointer = f"/extensions/KHR_lights_punctual/lights/{where}"
        animation["channels"][0]["target"] = {
            "path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": pointer}},
        }  # fmt: skip
    world = load_gltf(write_gltf(tmp_path, tree))
    first, second = sorted(world.punctual_lights, key=lambda light: light.name)
    for time_s in (0.0, 0.5, 1.0):
        shine = [np.multiply(light.intensity, light.modulation.mean(time_s, time_s)) for light in (first, second)]
        assert shine[0] == pytest.approx((1 - time_s, 1, 1 - 0.5 * time_s), abs=1e-6)
        assert shine[1] == pytest.approx(np.multiply(2 - time_s, (1.0, 0.5, 0.25)), abs=1e-6)


@given(st.floats(0.1, 2.5), st.one_of(st.none(), st.floats(0.5, 3.0)))
def test_a_camera_sees_its_height_whether_its_aspect_is_told_or_not(yfov, aspect):
    with tempfile.TemporaryDirectory() as folder:
        tree = with_camera(gltf())
        tree["cameras"][0]["perspective"] = {"yfov": yfov} | ({} if aspect is None else {"aspectRatio": aspect})
        camera = load_gltf(write_gltf(Path(folder), tree)).camera
    across = math.tan(math.radians(camera.fov_deg) / 2)
    height = camera.height if aspect is None else camera.width / aspect
    assert across * height / camera.width == pytest.approx(math.tan(yfov / 2), rel=1e-6)
    assert camera.height == pytest.approx(height, abs=0.51)
