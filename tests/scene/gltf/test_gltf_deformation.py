"""glTF skins and morph targets against independent arithmetic."""

from itertools import pairwise

import numpy as np
import pygltflib
import pytest
from scipy.spatial.transform import Rotation, Slerp

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.gltf.scene import load_gltf
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
    tree["nodes"][0]["weights"] = [0, 0.5]
    own = load_gltf(write_gltf(tmp_path, tree)).meshes[0]
    np.testing.assert_allclose(own.vertices, np.add(CORNERS, [(0, 0, 0), (0, 1.5, 0), (0, 0, 0)]), err_msg="the node's")
    animate(tree, (0, "weights", [0, 2], [0, 0, 1, 0.5], "LINEAR"))
    moving = load_gltf(write_gltf(tmp_path, tree)).meshes[0]
    vertices, normals = moving.deformation.vertices_at(1.0)
    assert normals is None
    np.testing.assert_allclose(vertices, np.add(CORNERS, [(0, 0, 0.5), (0, 0.75, 0), (0, 0, 0)]))
    assert moving.deformation.duration_s == 2


def test_what_changes_its_shape_alone_stands_where_its_node_puts_it(tmp_path):
    nodes = [{"translation": [5, 0, 0]}, {"mesh": 0, "translation": [1, 2, 3], "rotation": [0, 1, 0, 0]}]
    tree = with_camera(gltf(nodes=nodes, scenes=[{"nodes": [0, 1]}]))
    tree["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": add(tree, [(0, 0, 1)] * 3)}]
    animate(tree, (1, "weights", [0, 2], [0, 1], "LINEAR"))
    world = load_gltf(write_gltf(tmp_path, tree))
    pose = world.instances[0].motion.pose(1.0)
    assert world.meshes[0].deformation is not None
    np.testing.assert_allclose(pose[:3, 3], (1, 2, 3))
    np.testing.assert_allclose(pose[:3, :3], np.diag((-1, 1, -1)), atol=1e-12)


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


@pytest.mark.parametrize("scale", [(1, 3, 1), (0.5, 3, 2)])
@pytest.mark.parametrize("corner", [(1, 0, 0), (1, -0.5, 2), (-1, 2, 0.3)])
def test_normals_of_a_skin_that_stretches_stay_across_their_triangle(tmp_path, corner, scale):
    """The first slanted triangle's normal is wrong by 37° where it is stretched as its corners are."""
    slanted = np.array([(0, 0, 0), corner, (0, 1, 1)], float)
    told = np.cross(slanted[1], slanted[2])
    tree = with_camera(gltf(points=slanted, nodes=[{"mesh": 0, "skin": 0}, {"scale": scale}]))
    tree["scenes"][0]["nodes"] = [0, 1, 2]
    attributes = {
        "POSITION": 0,
        "NORMAL": add(tree, [told / np.linalg.norm(told)] * 3),
        "JOINTS_0": add(tree, [(0, 0, 0, 0)] * 3, "u1"),
        "WEIGHTS_0": add(tree, [(1, 0, 0, 0)] * 3),
    }
    tree["meshes"] = [{"primitives": [{"attributes": attributes}]}]
    tree["skins"] = [{"joints": [1], "inverseBindMatrices": add(tree, [np.eye(4).ravel()])}]
    mesh = load_gltf(write_gltf(tmp_path, tree)).meshes[0]
    np.testing.assert_allclose(mesh.vertices, slanted * scale, atol=1e-6)
    across = np.cross(mesh.vertices[1] - mesh.vertices[0], mesh.vertices[2] - mesh.vertices[0])
    np.testing.assert_allclose(mesh.normals, [across / np.linalg.norm(across)] * 3, atol=1e-6)


def test_a_vertex_without_weight_follows_its_first_joint(tmp_path):
    """As three.js has it (SkinnedMesh.normalizeSkinWeights); other weights count by their share of the sum."""
    joints = [{"translation": [0, 0, 1]}, {"translation": [0, 0, 5]}]
    tree = with_camera(gltf(nodes=[{"mesh": 0, "skin": 0}, *joints]))
    tree["scenes"][0]["nodes"] = [0, 1, 2, 3]
    attributes = {
        "POSITION": 0,
        "JOINTS_0": add(tree, [(0, 1, 0, 0), (1, 0, 0, 0), (0, 1, 0, 0)], "u1"),
        "WEIGHTS_0": add(tree, [(1, 0, 0, 0), (0, 0, 0, 0), (0.5, 1.5, 0, 0)]),
    }
    tree["meshes"] = [{"primitives": [{"attributes": attributes}]}]
    tree["skins"] = [{"joints": [1, 2]}]
    mesh = load_gltf(write_gltf(tmp_path, tree)).meshes[0]
    np.testing.assert_allclose(mesh.vertices, np.add(CORNERS, [(0, 0, 1), (0, 0, 5), (0, 0, 4)]), atol=1e-6)


def test_morph_targets_start_over_with_an_asset_s_animation(tmp_path):
    """Without a camera of its own a file is an asset, whose animation repeats: shapes as well as places."""
    tree = gltf()
    targets = [{"POSITION": add(tree, [(0, 0, 1), (0, 0, 0), (0, 0, 0)])}]
    tree["meshes"] = [{"primitives": [{"attributes": {"POSITION": 0}, "targets": targets}]}]
    animate(tree, (0, "weights", [0, 2], [0, 1], "LINEAR"))
    deformation = load_gltf(write_gltf(tmp_path, tree)).meshes[0].deformation
    for time_s in (0.5, 2.5, 40.5):
        np.testing.assert_allclose(
            deformation.vertices_at(time_s)[0], np.add(CORNERS, [(0, 0, 0.25), (0,) * 3, (0,) * 3])
        )


def test_a_second_set_of_joints_pulls_as_the_first_does(tmp_path):
    tree = with_camera(gltf(nodes=[{"mesh": 0, "skin": 0}, {"translation": [0, 0, 1]}, {"translation": [0, 0, 5]}]))
    tree["scenes"][0]["nodes"] = [0, 1, 2, 3]
    attributes = {"POSITION": 0}
    for k, weight in enumerate((0.25, 0.75)):
        attributes[f"JOINTS_{k}"] = add(tree, [(k, 0, 0, 0)] * 3, "u1")
        attributes[f"WEIGHTS_{k}"] = add(tree, [(weight, 0, 0, 0)] * 3)
    tree["meshes"] = [{"primitives": [{"attributes": attributes}]}]
    tree["skins"] = [{"joints": [1, 2]}]
    mesh = load_gltf(write_gltf(tmp_path, tree)).meshes[0]
    np.testing.assert_allclose(mesh.vertices, np.add(CORNERS, (0, 0, 4)), atol=1e-6)


@pytest.mark.parametrize("mirror", [(-1, 1, 1), (1, -1, 1), (-1, -1, -1)])
@pytest.mark.parametrize("skinned", [False, True])
def test_what_a_node_mirrors_is_the_mirror_image_at_all_times(tmp_path, mirror, skinned):
    """Corners, the normals that morph targets turn, and which side is the front."""

    def shown(scale):
        nodes = [{"mesh": 0, "scale": scale}]
        if skinned:
            nodes = [{"mesh": 0, "skin": 0}, {"scale": scale}]
        tree = with_camera(gltf(nodes=nodes))
        tree["scenes"][0]["nodes"] = list(range(len(tree["nodes"])))
        target = {"POSITION": add(tree, [(0, 0, 1), (0, 0, 0), (0, 1, 0)]), "NORMAL": add(tree, [(0.4, 0.2, 0)] * 3)}
        attributes = {"POSITION": 0, "NORMAL": add(tree, [(0, 0, 1)] * 3)}
        if skinned:
            attributes |= {"JOINTS_0": add(tree, [(0,) * 4] * 3, "u1"), "WEIGHTS_0": add(tree, [(1, 0, 0, 0)] * 3)}
            tree["skins"] = [{"joints": [1]}]
        tree["meshes"] = [{"primitives": [{"attributes": attributes, "targets": [target]}]}]
        animate(tree, (0, "weights", [0, 2], [0, 1], "LINEAR"))
        world = load_gltf(write_gltf(tmp_path, tree))
        mesh, motion = world.meshes[0], world.instances[0].motion
        for time_s in (0.0, 0.7, 2.0):
            pose = motion.pose(time_s)
            vertices, normals = mesh.deformation.vertices_at(time_s)
            a, b, c = vertices[mesh.triangles[0]] @ pose[:3, :3].T
            yield vertices @ pose[:3, :3].T + pose[:3, 3], normals @ pose[:3, :3].T, np.cross(b - a, c - a)

    for (corners, normals, front), (seen, seen_normals, seen_front) in zip(
        shown((1, 1, 1)), shown(mirror), strict=True
    ):
        np.testing.assert_allclose(seen, corners * mirror, atol=1e-6)
        np.testing.assert_allclose(seen_normals, normals * mirror, atol=1e-6)
        np.testing.assert_allclose(seen_front, front * mirror, atol=1e-6)
