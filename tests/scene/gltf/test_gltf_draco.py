"""glTF meshes compressed with Draco against the arrays that went in."""

import base64
import sys

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.scene.gltf.scene import load_gltf
from tests.scene.gltf.gltf_files import gltf, write_gltf

POINTS = np.array([(0, 0, 0), (2, 0, 0), (0, 1, 0), (2, 1, 0.5)], np.float32)
FACES = np.array([(0, 1, 2), (1, 3, 2)], np.uint32)
UVS = POINTS[:, :2] / 2


def compressed(data=None, **ids):
    """A file of two triangles; their accessors have no bytes of their own."""
    draco = pytest.importorskip("DracoPy", reason="compressed meshes need the draco extra")
    data = draco.encode(POINTS, FACES, quantization_bits=16, tex_coord=UVS.astype(float)) if data is None else data
    kinds = {attribute["attribute_type"]: attribute["unique_id"] for attribute in draco.decode(data).attributes}
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    extension = {"bufferView": 0, "attributes": {"POSITION": kinds[0], "TEXCOORD_0": kinds[3]} | ids}
    primitive = {
        "attributes": {"POSITION": 0, "TEXCOORD_0": 1},
        "indices": 2,
        "extensions": {"KHR_draco_mesh_compression": extension},
    }
    return gltf(
        meshes=[{"primitives": [primitive]}],
        accessors=[
            {"componentType": 5126, "count": 4, "type": "VEC3"},
            {"componentType": 5126, "count": 4, "type": "VEC2"},
            {"componentType": 5125, "count": 6, "type": "SCALAR"},
        ],
        bufferViews=[{"buffer": 0, "byteLength": len(data)}],
        buffers=[{"byteLength": len(data), "uri": uri}],
        extensionsRequired=["KHR_draco_mesh_compression"],
    )


def corners(points, uvs, triangles):
    """Triangles as sets of corners in their order, whatever the numbers of vertices."""
    both = np.round(np.column_stack([points, uvs]), 3) + 0.0
    found = set()
    for triangle in triangles:
        rows = [tuple(both[k].tolist()) for k in triangle]
        first = rows.index(min(rows))
        found.add(tuple(rows[first:] + rows[:first]))
    return found


@pytest.mark.parametrize("mode", [4, 5])
def test_compressed_triangles_are_those_that_went_in(tmp_path, mode):
    """Also of what was a strip: what comes out has all corners of each triangle."""
    tree = compressed()
    tree["meshes"][0]["primitives"][0]["mode"] = mode
    mesh = load_gltf(write_gltf(tmp_path, tree)).meshes[0]
    up = np.column_stack([UVS[:, 0], 1 - UVS[:, 1]])
    assert corners(mesh.vertices, mesh.uvs, mesh.triangles) == corners(POINTS, up, FACES)


def test_damaged_or_other_data_are_named(tmp_path):
    tree = compressed()
    tree["bufferViews"][0]["byteLength"] = 20
    with pytest.raises(InputError, match=r"scene\.gltf: meshes\[0\].primitives\[0\]: its Draco data cannot be decoded"):
        load_gltf(write_gltf(tmp_path, tree))
    with pytest.raises(InputError, match="no attribute 77 for POSITION"):
        load_gltf(write_gltf(tmp_path, compressed(POSITION=77)))
    tree = compressed()
    tree["accessors"][0]["count"] = 5
    with pytest.raises(InputError, match=r"accessors\[0\] has the shape \(4, 3\) when unpacked, expected \(5, 3\)"):
        load_gltf(write_gltf(tmp_path, tree))


def test_the_missing_library_is_named(tmp_path, monkeypatch):
    tree = compressed()
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    with pytest.raises(InputError, match=r"pip install 'clsim\[draco\]'"):
        load_gltf(write_gltf(tmp_path, tree))
    plain = gltf()
    plain["meshes"][0]["primitives"][0]["extensions"] = tree["meshes"][0]["primitives"][0]["extensions"]
    assert len(load_gltf(write_gltf(tmp_path, plain)).meshes[0].triangles) == 1
