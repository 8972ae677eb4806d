"""glTF accessors, animation, skins, morph targets, materials, lights and cameras against independent arithmetic."""

import base64
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pygltflib
import pytest
from gltf_files import CORNERS, glb, gltf, image_uri, write_gltf
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.gltf_accessors import GltfFile
from clsim.scene.gltf_scene import load_gltf, read_gltf

ASSETS = Path(__file__).resolve().parents[3] / "shared" / "assets" / "gltf"
needs_assets = pytest.mark.skipif(not ASSETS.is_dir(), reason="the real scenes are not beside this checkout")
SIZES = {"<f4": 5126, "<u2": 5123, "u1": 5121, "i1": 5120, "<i2": 5122, "<u4": 5125}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


def add(tree, values, dtype="<f4", **extra):
    """Append an array to a file as buffer, view and accessor; return the accessor's index."""
    array = np.asarray(values, dtype)
    data = array.tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    tree["buffers"].append({"byteLength": len(data), "uri": uri})
    tree["bufferViews"].append({"buffer": len(tree["buffers"]) - 1, "byteLength": len(data)})
    width = array.shape[1] if array.ndim > 1 else 1
    tree["accessors"].append(
        {
            "bufferView": len(tree["bufferViews"]) - 1,
            "componentType": SIZES[dtype],
            "count": len(array),
            "type": TYPES[width],
            **extra,
        }
    )
    return len(tree["accessors"]) - 1


def animate(tree, *channels):
    """Append an animation of channels (node, path, times, values, interpolation)."""
    animation = {"channels": [], "samplers": []}
    for node, path, times, values, interpolation in channels:
        sampler = {"input": add(tree, times), "output": add(tree, values), "interpolation": interpolation}
        animation["channels"].append({"sampler": len(animation["samplers"]), "target": {"node": node, "path": path}})
        animation["samplers"].append(sampler)
    tree.setdefault("animations", []).append(animation)
    return tree


# Accessors


def test_accessors_follow_stride_offset_normalization_and_sparse_replacement(tmp_path):
    tree = gltf()
    data = np.arange(64, dtype=np.uint8)
    add(tree, data, "u1")  # view 1
    tree["bufferViews"][1]["byteStride"] = 8
    tree["accessors"].append({"bufferView": 1, "byteOffset": 2, "componentType": 5121, "count": 4, "type": "VEC3"})
    strided = len(tree["accessors"]) - 1
    shorts = add(tree, [[-32768, 0], [32767, 16384]], "<i2", normalized=True)
    add(tree, [2, 0], "<u2")
    where = len(tree["bufferViews"]) - 1
    add(tree, [[7, 8], [9, 10]])
    what = len(tree["bufferViews"]) - 1
    sparse = {"count": 2, "indices": {"bufferView": where, "componentType": 5123}, "values": {"bufferView": what}}
    tree["accessors"].append({"componentType": 5126, "count": 3, "type": "VEC2", "sparse": sparse})
    file = GltfFile(write_gltf(tmp_path, tree))
    np.testing.assert_array_equal(
        file.accessor(strided, "test", "VEC3"), [[2, 3, 4], [10, 11, 12], [18, 19, 20], [26, 27, 28]]
    )
    np.testing.assert_allclose(file.accessor(shorts, "test", "VEC2"), [[-1, 0], [1, 16384 / 32767]], atol=1e-7)
    np.testing.assert_array_equal(file.accessor(shorts + 3, "test", "VEC2"), [[9, 10], [0, 0], [7, 8]])


@pytest.mark.parametrize(
    ("sparse", "part"),
    [
        ({"count": 0}, "sparse.count is 0"),
        ({"count": 9}, "sparse.count is 9"),
        ({"indices": {"bufferView": 1, "componentType": 5121, "byteOffset": 2}}, "ends at byte"),
        ({"indices": {"bufferView": 1, "componentType": 5121, "byteOffset": 1}}, "has 250, expected 0 to 2"),
        ({"values": {"bufferView": 77}}, "bufferViews[77]"),
    ],
)
def test_broken_sparse_accessors(tmp_path, sparse, part):
    tree = gltf()
    add(tree, [0, 250], "u1")
    whole = {"count": 1, "indices": {"bufferView": 1, "componentType": 5121}, "values": {"bufferView": 0}}
    tree["accessors"][0]["sparse"] = whole
    load_gltf(write_gltf(tmp_path, tree))
    tree["accessors"][0]["sparse"] = whole | sparse
    with pytest.raises(InputError, match=r"scene\.gltf") as caught:
        load_gltf(write_gltf(tmp_path, tree))
    assert part in str(caught.value)


@pytest.mark.parametrize(
    ("mode", "triangles"),
    [(4, [(0, 1, 2)]), (5, [(0, 1, 2), (1, 3, 2), (2, 3, 4)]), (6, [(0, 1, 2), (0, 2, 3), (0, 3, 4)])],
)
def test_strips_and_fans_keep_their_winding(tmp_path, mode, triangles):
    tree = gltf()
    points = add(tree, np.random.default_rng(0).normal(size=(5, 3)))
    tree["meshes"] = [{"primitives": [{"attributes": {"POSITION": points}, "mode": mode}]}]
    mesh = load_gltf(write_gltf(tmp_path, tree)).meshes[0]
    np.testing.assert_array_equal(mesh.triangles, triangles)


def test_primitives_of_one_mesh_become_one_with_a_material_each(tmp_path):
    """One is smooth and textured, the other is neither: it gets flat normals of its own, and coordinates of 0."""
    tree = gltf(materials=[{"name": "a"}, {"name": "b"}])
    smooth = {"POSITION": 0, "NORMAL": add(tree, [(0, 1, 0)] * 3), "TEXCOORD_0": add(tree, [(0.25, 0.75)] * 3)}
    tree["meshes"] = [
        {"primitives": [{"attributes": {"POSITION": 0}, "material": 1}, {"attributes": smooth, "material": 0}]}
    ]
    world = load_gltf(write_gltf(tmp_path, tree))
    (mesh,) = world.meshes
    assert [world.materials[k].name for k in mesh.material_ids] == ["b", "a"]
    np.testing.assert_allclose(mesh.normals, [(0, 0, 1)] * 3 + [(0, 1, 0)] * 3)
    np.testing.assert_allclose(mesh.uvs, [(0, 0)] * 3 + [(0.25, 0.25)] * 3)


# Animation


TIMES = [0.5, 1.0, 2.5]
MOMENTS = [0.0, 0.5, 0.7, 1.0, 1.6, 2.4999, 2.5, 9.0]


def position_at(motion, time_s):
    return motion.pose(time_s)[:3, 3]


def with_camera(tree):
    """Make a file a scene of its own: its animation then plays once."""
    tree["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.8}}]
    tree["nodes"].append({"camera": 0, "translation": [0, 0, 30]})
    tree["scenes"][0]["nodes"].append(len(tree["nodes"]) - 1)
    return tree


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
        ((0, "translation", [0, 0], [(0, 0, 0)] * 2, "LINEAR"), "do not increase"),
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


# Deformation


def test_morph_targets_move_by_their_weights(tmp_path):
    tree = with_camera(gltf())
    a, b = add(tree, [(0, 0, 1), (0, 0, 0), (0, 0, 0)]), add(tree, [(0, 0, 0), (0, 3, 0), (0, 0, 0)])
    tree["meshes"] = [
        {
            "primitives": [{"attributes": {"POSITION": 0}, "targets": [{"POSITION": a}, {"POSITION": b}]}],
            "weights": [1, 0],
        }
    ]
    still = load_gltf(write_gltf(tmp_path, tree)).meshes[0]
    assert still.deformation is None
    np.testing.assert_allclose(still.vertices, np.add(CORNERS, [(0, 0, 1), (0, 0, 0), (0, 0, 0)]))
    animate(tree, (0, "weights", [0, 2], [0, 0, 1, 0.5], "LINEAR"))
    moving = load_gltf(write_gltf(tmp_path, tree)).meshes[0]
    vertices, normals = moving.deformation.vertices_at(1.0)
    assert normals is None
    np.testing.assert_allclose(vertices, np.add(CORNERS, [(0, 0, 0.5), (0, 0.75, 0), (0, 0, 0)]))
    assert moving.deformation.duration_s == 2


def test_a_skin_in_its_bind_pose_changes_nothing_and_ignores_its_own_node(tmp_path):
    tree = with_camera(gltf(nodes=[{"mesh": 0, "skin": 0, "translation": [50, 0, 0]}, {"translation": [1, 2, 3]}]))
    tree["scenes"][0]["nodes"] = [0, 1, 2]
    bind = np.eye(4)
    bind[:3, 3] = (-1, -2, -3)
    attributes = {
        "POSITION": 0,
        "JOINTS_0": add(tree, [(0, 0, 0, 0)] * 3, "u1"),
        "WEIGHTS_0": add(tree, [(2, 0, 0, 0)] * 3),
    }
    tree["meshes"] = [{"primitives": [{"attributes": attributes}]}]
    tree["skins"] = [{"joints": [1], "inverseBindMatrices": add(tree, [bind.T.ravel()])}]
    world = load_gltf(write_gltf(tmp_path, tree))
    np.testing.assert_allclose(world.meshes[0].vertices, CORNERS, atol=1e-6)
    np.testing.assert_array_equal(world.instances[0].motion.pose(0.0), np.eye(4))
    tree["skins"][0]["joints"] = [9]
    with pytest.raises(InputError, match="uses node 9"):
        load_gltf(write_gltf(tmp_path, tree))


def decoded(source, index):
    """Decode an accessor without stride, by pygltflib's own classes."""
    accessor = source.accessors[index]
    view = source.bufferViews[accessor.bufferView]
    dtype = {5126: "<f4", 5123: "<u2", 5121: "u1"}[accessor.componentType]
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}[accessor.type]
    start = (view.byteOffset or 0) + (accessor.byteOffset or 0)
    return np.frombuffer(source.binary_blob(), dtype, accessor.count * width, start).reshape(accessor.count, width)


@needs_assets
@pytest.mark.parametrize("time_s", [0.0, 0.1234, 0.5])
def test_fox_walks_as_scipy_says(time_s):
    """Joint by joint and vertex by vertex, in loops, from the file as another library reads it."""
    source = pygltflib.GLTF2().load(str(ASSETS / "Fox.glb"))
    animation = next(a for a in source.animations if a.name == "Walk")
    local = {}
    for i, node in enumerate(source.nodes):
        local[i] = [node.translation or [0, 0, 0], Rotation.from_quat(node.rotation or [0, 0, 0, 1])]
    for channel in animation.channels:
        sampler = animation.samplers[channel.sampler]
        times, values = decoded(source, sampler.input)[:, 0].astype(float), decoded(source, sampler.output)
        if channel.target.path == "rotation":
            local[channel.target.node][1] = Slerp(times, Rotation.from_quat(values))(
                np.clip(time_s, times[0], times[-1])
            )
        else:
            assert channel.target.path == "translation"
            local[channel.target.node][0] = [np.interp(time_s, times, values[:, k]) for k in range(3)]

    def world_of(index):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = local[index][1].as_matrix(), local[index][0]
        parents = [i for i, node in enumerate(source.nodes) if index in (node.children or [])]
        return world_of(parents[0]) @ matrix if parents else matrix

    skin, attributes = source.skins[0], source.meshes[0].primitives[0].attributes
    binds = decoded(source, skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
    joints = [world_of(joint) @ bind for joint, bind in zip(skin.joints, binds, strict=True)]
    points = decoded(source, attributes.POSITION)
    indices, weights = decoded(source, attributes.JOINTS_0), decoded(source, attributes.WEIGHTS_0)
    expected = [
        sum(w * (joints[j] @ (*point, 1))[:3] for j, w in zip(js, ws, strict=True))
        for point, js, ws in zip(points, indices, weights, strict=True)
    ]
    mesh = load_world(f"{ASSETS / 'Fox.glb'}#Walk").meshes[0]
    np.testing.assert_allclose(mesh.deformation.vertices_at(time_s)[0], expected, atol=2e-3)  # of 155 units


@needs_assets
def test_fox_stays_in_view_and_moves():
    world = load_world(ASSETS / "Fox.glb")
    deformation = world.meshes[0].deformation
    moments = [deformation.vertices_at(t)[0] for t in np.linspace(0, deformation.duration_s, 7)]
    assert all(40 < np.ptp(v, axis=0).max() < 200 for v in moments)
    assert all(np.abs(b - a).max() > 1 for a, b in pairwise(moments))
    assert world.meshes[0].normals is None
    assert not world.warnings


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


@needs_assets
def test_flight_helmet_has_its_textures_once_each():
    world = load_world(ASSETS / "FlightHelmet" / "FlightHelmet.gltf")
    assert sum(len(mesh.triangles) for mesh in world.meshes) == 94_722
    assert all(mesh.normals is not None for mesh in world.meshes)
    assert len(world.textures) == 15
    kinds = {m.texture: True for m in world.materials} | {m.normal_texture: False for m in world.materials}
    assert all(world.textures[index].srgb == srgb for index, srgb in kinds.items())
    assert not world.warnings


# Materials


def test_materials_keep_their_factors_textures_and_extensions(tmp_path):
    pixels = np.arange(4 * 4 * 4).reshape(4, 4, 4)
    transform = {"offset": [0, 1], "rotation": math.pi / 2, "scale": [0.5, 0.5]}
    tree = gltf(
        images=[{"uri": image_uri(pixels)}],
        samplers=[{"wrapS": 33071, "wrapT": 33648, "magFilter": 9728}],
        textures=[{"source": 0, "sampler": 0}, {"source": 0}],
        materials=[
            {
                "pbrMetallicRoughness": {
                    "baseColorFactor": [0.1, 0.2, 0.3, 0.4],
                    "baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": transform}},
                    "metallicFactor": 0.6,
                    "roughnessFactor": 0.5,
                    "metallicRoughnessTexture": {"index": 1},
                },
                "normalTexture": {"index": 1, "scale": 0.7},
                "emissiveFactor": [0.5, 0, 1],
                "alphaMode": "MASK",
                "alphaCutoff": 0.25,
                "doubleSided": True,
                "extensions": {
                    "KHR_materials_emissive_strength": {"emissiveStrength": 8},
                    "KHR_materials_clearcoat": {"clearcoatFactor": 0.9, "clearcoatRoughnessFactor": 0.3},
                    "KHR_materials_transmission": {"transmissionFactor": 0.2},
                    "KHR_materials_ior": {"ior": 1.33},
                    "KHR_materials_sheen": {},
                },
            }
        ],
    )
    tree["meshes"][0]["primitives"][0]["material"] = 0
    path = write_gltf(tmp_path, tree)
    world = load_gltf(path)
    m = world.materials[0]
    assert (m.color, m.opacity, m.metallic, m.alpha) == ((0.1, 0.2, 0.3), 0.4, 0.6, 0.25)
    assert (m.alpha_mode, m.alpha_cutoff, m.two_sided, m.opacity_texture) == ("mask", 0.25, True, m.texture)
    assert (m.emission, m.ior, m.transmission, m.normal_scale) == ((4, 0, 8), 1.33, 0.2, 0.7)
    assert (m.clearcoat, m.clearcoat_alpha) == (0.9, pytest.approx(0.09))
    color, normal = world.textures[m.texture], world.textures[m.normal_texture]
    assert (color.srgb, color.wrap_u, color.wrap_v, color.nearest) == (True, "clamp", "mirror", True)
    assert (normal.srgb, normal.wrap_u, normal.nearest) == (False, "repeat", False)
    assert m.roughness_texture == m.normal_texture  # the same image, read the same way
    assert color.pixels is normal.pixels
    # The extension's own example: the lower left quadrant, that is u and v below one half with v up.
    corners = np.array([(0, 0, 1), (1, 0, 1), (0, 1, 1), (1, 1, 1)]) @ np.array(color.uv_matrix).T
    assert corners.min() == pytest.approx(0) and corners.max() == pytest.approx(0.5)
    (warning,) = world.warnings
    assert "KHR_materials_sheen" in warning
    with pytest.raises(InputError, match="KHR_materials_sheen"):
        load_world(path, strict=True)


def test_unlit_surfaces_show_their_color_whatever_the_light(tmp_path):
    tree = gltf(
        materials=[
            {"pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 0, 1]}, "extensions": {"KHR_materials_unlit": {}}}
        ]
    )
    tree["meshes"][0]["primitives"][0]["material"] = 0
    material = load_gltf(write_gltf(tmp_path, tree)).materials[0]
    assert (material.emission, material.color, material.specular_color) == ((1, 0.5, 0), (0, 0, 0), (0, 0, 0))


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_bytes_never_raise_anything_but_an_input_error(tmp_path, data):
    """Bytes of a working file, with animation and a skin, are changed, cut out or repeated."""
    tree = gltf(buffers=[{"byteLength": 36}], nodes=[{"mesh": 0, "skin": 0}, {}])
    attributes = {
        "POSITION": 0,
        "JOINTS_0": add(tree, [(0, 0, 0, 0)] * 3, "u1"),
        "WEIGHTS_0": add(tree, [(1, 0, 0, 0)] * 3),
    }
    tree["meshes"] = [{"primitives": [{"attributes": attributes}]}]
    tree["skins"] = [{"joints": [1]}]
    animate(tree, (1, "rotation", [0, 1], [(0, 0, 0, 1), (0, 1, 0, 0)], "LINEAR"))
    whole = bytearray(glb(tree, np.array(CORNERS, "<f4").tobytes()))
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(whole) - 1))
        kind = data.draw(st.sampled_from(["set", "cut", "digit"]))
        if kind == "set":
            whole[at] = data.draw(st.integers(0, 255))
        elif kind == "cut":
            del whole[at : at + data.draw(st.integers(1, 8))]
        else:
            digits = [i for i, byte in enumerate(whole) if chr(byte).isdigit()]
            whole[data.draw(st.sampled_from(digits))] = ord(data.draw(st.sampled_from("0123456789-.e")))
    path = tmp_path / "fuzz.glb"
    path.write_bytes(whole)
    try:
        world = load_world(path)
        for mesh in world.meshes:
            if mesh.deformation is not None:
                mesh.deformation.vertices_at(0.3)
    except InputError as error:
        assert "fuzz.glb" in str(error)


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
