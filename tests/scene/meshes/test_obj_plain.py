"""OBJ files of triangles alone: the same mesh as trimesh's, and what is left to trimesh."""

import numpy as np
import pytest

from clsim.scene.meshes import obj_plain, trimesh_scene
from clsim.scene.meshes.obj_plain import read_plain_obj
from clsim.scene.meshes.trimesh_scene import load_triangles

POINTS = "v 0 0 0.1\nv 2 -1e-3 0\nv 0 1.25 0\nv 3 3 3\nv 7 7 7\n"
UVS = "vt 0 0\nvt .5 0.25\nvt 0 1\n"
NORMALS = "vn 0 0 2\nvn 0 0.6 0.8\nvn 0 0 0\n"
FACES = {
    "positions": "f 1 2 3\nf 2 4 3\n",
    "uvs": "f 1/1 2/2 3/3\nf 2/1 4/2 3/3\n",
    "normals": "f 1//1 2//2 3//3\nf 2//2 4//1 3//3\n",
    "both": "f 1/1/1 2/2/2 3/3/3\nf 2/2/1 4/1/1 3/3/3\n",
}
TEXT = {name: "# a\n" + POINTS + UVS + NORMALS + faces for name, faces in FACES.items()}


def corners(mesh):
    """Return what each corner of each triangle has: the order of the vertices themselves means nothing."""
    return {
        name: None if values is None else values[mesh.triangles]
        for name, values in (("vertices", mesh.vertices), ("normals", mesh.normals), ("uvs", mesh.uvs))
    }


def by_trimesh(path, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr(trimesh_scene, "read_plain_obj", lambda data: None)
        return load_triangles(path)


@pytest.mark.parametrize(
    "text",
    [
        *TEXT.values(),
        TEXT["both"].replace("\n", "\r\n"),
        TEXT["both"].replace(" ", "  ").replace("\n", " \n"),
        "mtllib a.mtl\n" + POINTS + "usemtl a\ns off\ng part\n" + FACES["positions"],
        "o first\n" + POINTS + UVS + "f 1/1 2/2 3/3\no second\nv 9 9 9\nvt 1 1\nf 6/4 4/1 1/2\n",
        "vt 0 0 0\nvt 1 0 0\nvt 0 1 0\n" + POINTS + FACES["uvs"],
    ],
)
def test_the_mesh_is_that_of_trimesh_to_the_last_bit(tmp_path, monkeypatch, text):
    path = tmp_path / "a.obj"
    path.write_text(text, newline="")
    mesh = read_plain_obj(path.read_bytes())
    expected = by_trimesh(path, monkeypatch)
    assert mesh is not None
    assert len(mesh.vertices) == len(expected.vertices)
    found, wanted = corners(mesh), corners(expected)
    assert [name for name in found if found[name] is None] == [name for name in wanted if wanted[name] is None]
    for name, values in wanted.items():
        if values is not None:
            np.testing.assert_array_equal(found[name], values)
    np.testing.assert_array_equal(mesh.material_ids, expected.material_ids)


def test_a_plain_file_is_read_without_trimesh(tmp_path, monkeypatch):
    path = tmp_path / "a.obj"
    path.write_text(TEXT["both"])
    monkeypatch.setattr(trimesh_scene, "_read", lambda *args, **options: pytest.fail("trimesh was asked"))
    assert len(load_triangles(path).triangles) == 2


@pytest.mark.parametrize(
    "text",
    [
        POINTS + "f 1 2 3 4\n",
        POINTS + "f 1 2 3\nf 1 2 3 4\n",
        POINTS + "f 1 2 3\nf 1 2\nf 1 2 3 4\n",  # as many numbers as three triangles have
        POINTS + "f -1 -2 -3\n",
        POINTS + "f 1 2 0\n",
        POINTS + "f 1 2 6\n",
        POINTS + UVS + "f 1/1 2/2 3\n",
        POINTS + UVS + NORMALS + "f 1//1 2//2 3/3/3\n",
        POINTS + NORMALS + "f 1//3 2//3 3//\nf 1/2/3 2//2 3//3\n",
        POINTS + UVS + "f 1/1 2/2 3/4\n",
        POINTS + UVS + "f 1/1 2/2 3/9223372036854775807\n",
        POINTS + "f 1/1 2/2 3/3\n",
        POINTS + "f 1 2 x\n",
        POINTS + "l 1 2\nf 1 2 3\n",
        POINTS + "f 1 2 \\\n3\n",
        POINTS + "usemtl a\nf 1 2 3\nusemtl b\nf 2 3 4\n",
        "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
        "v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1 0 0\nf 1 2 3\n",
        "v 0 0\nv 1 0 0 1\nv 0 1 0\nf 1 2 3\n",
        POINTS,
        "",
    ],
)
def test_what_is_written_in_other_ways_is_left_to_trimesh(text):
    assert read_plain_obj(text.encode()) is None


def test_tabs_part_words_too():
    """For trimesh, which would find no triangle."""
    found, wanted = (read_plain_obj(text.encode()) for text in (TEXT["both"].replace(" ", "\t"), TEXT["both"]))
    np.testing.assert_array_equal(found.triangles, wanted.triangles)


def test_each_combination_that_corners_name_is_a_vertex():
    mesh = read_plain_obj(TEXT["both"].encode())
    assert len(mesh.vertices) == 5  # the second position has two
    assert obj_plain.read_plain_obj(TEXT["positions"].encode()).vertices.shape == (4, 3)
