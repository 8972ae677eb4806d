"""Copies of meshes (EXT_mesh_gpu_instancing)."""

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.scene.gltf.scene import load_gltf
from tests.scene.gltf.gltf_files import add, animate, gltf, with_camera, write_gltf


def instanced(**arrays):
    """A triangle whose node has copies."""
    tree = gltf()
    attributes = {name: add(tree, values) for name, values in arrays.items()}
    tree["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    tree["nodes"][0]["translation"] = [0.0, 0.0, 5.0]
    return tree | {"extensionsUsed": ["EXT_mesh_gpu_instancing"], "extensionsRequired": ["EXT_mesh_gpu_instancing"]}


def test_copies_of_a_mesh_stand_where_the_file_says(tmp_path):
    """Twice as wide, then a quarter turn about z, then two to the right, within the node; and one that is stretched."""
    half = 0.5**0.5
    tree = instanced(
        TRANSLATION=[(2.0, 0.0, 0.0), (0.0, 1.0, 0.0)],
        ROTATION=[(0.0, 0.0, half, half), (0.0, 0.0, 0.0, 1.0)],
        SCALE=[(2.0, 1.0, 1.0), (1.0, 3.0, 1.0)],
    )
    world = load_gltf(write_gltf(tmp_path, tree))
    assert [instance.name for instance in world.instances] == ["node[0]", "node[1]"] and world.warnings == ()
    corners = [
        world.meshes[each.mesh].vertices @ each.motion.pose(0.0)[:3, :3].T + each.motion.pose(0.0)[:3, 3]
        for each in world.instances
    ]
    np.testing.assert_allclose(corners[0], [(2, 0, 5), (2, 4, 5), (1, 0, 5)], atol=1e-6)
    np.testing.assert_allclose(corners[1], [(0, 1, 5), (2, 1, 5), (0, 4, 5)], atol=1e-6)
    assert world.instances[0].mesh != world.instances[1].mesh, "what is stretched is a mesh of its own"


def test_copies_share_triangles_and_move_with_their_node(tmp_path):
    tree = instanced(TRANSLATION=[(float(k), 0.0, 0.0) for k in range(50)])
    animate(tree, (0, "translation", [0.0, 1.0], [(0, 0, 5), (0, 7, 5)], "LINEAR"))
    world = load_gltf(write_gltf(tmp_path, with_camera(tree)))
    assert len(world.meshes) == 1 and len(world.instances) == 50
    np.testing.assert_allclose(world.instances[49].motion.pose(1.0)[:3, 3], (49, 7, 5))


def test_copies_that_cannot_be_are_refused(tmp_path):
    for arrays, expected in (
        ({"TRANSLATION": [(0, 0, 0)] * 2, "SCALE": [(1, 1, 1)] * 3}, r"nodes\[0\]: its copies have \[2, 3\] places"),
        ({}, "its copies have no places"),
        ({"ROTATION": [(0, 0, 0, 0)]}, "a copy has a quaternion of length 0"),
    ):
        with pytest.raises(InputError, match=expected):
            load_gltf(write_gltf(tmp_path, instanced(**arrays)))
