"""glTF accessors and primitives against independent arithmetic, and damaged files."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.gltf.accessors import GltfFile
from clsim.scene.gltf.scene import load_gltf
from tests.scene.gltf.gltf_files import CORNERS, add, animate, glb, gltf, write_gltf


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
