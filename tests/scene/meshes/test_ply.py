"""Binary PLY files whose faces have different numbers of corners, as Blender writes them."""

import struct

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.scene.meshes.ply import even_faces
from clsim.scene.meshes.trimesh_scene import load_parts, load_triangles

POINTS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1)]


def _ply(path, faces, *, order="<", number="uchar", more="", tails=b""):
    """Write a file with a flag before the corners of each face and a colour after them, if ``more`` says so."""
    name = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = (
        f"ply\nformat {name} 1.0\nelement vertex {len(POINTS)}\nproperty double x\nproperty float y\nproperty float z\n"
    )
    head += f"element face {len(faces)}\n{'property short flag' + chr(10) if more else ''}"
    head += f"property list {number} int vertex_indices\n{more}element other 1\nproperty uchar q\nend_header\n"
    body = b"".join(struct.pack(f"{order}dff", *point) for point in POINTS)
    for face in faces:
        body += struct.pack(f"{order}h", 7) if more else b""
        body += struct.pack(f"{order}{'B' if number == 'uchar' else 'i'}{len(face)}i", len(face), *face) + tails
    path.write_bytes(head.encode() + body + b"\x05")
    return path


def _triangles(path):
    mesh = load_triangles(path)
    return {tuple(map(tuple, mesh.vertices[row].astype(int).tolist())) for row in mesh.triangles}


def _expected(*rows):
    return {tuple(POINTS[k] for k in row) for row in rows}


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("number", ["uchar", "int"])
def test_faces_of_three_four_and_five_corners_become_triangles(tmp_path, order, number):
    faces = [(4, 5, 6), (0, 1, 2, 3), (0, 1), (1, 2, 6), (3, 2, 6, 5, 4)]
    expected = _expected((4, 5, 6), (1, 2, 6), (0, 1, 2), (0, 2, 3), (3, 2, 6), (3, 6, 5), (3, 5, 4))
    assert _triangles(_ply(tmp_path / "a.ply", faces, order=order, number=number)) == expected


def test_colours_of_faces_are_those_of_their_triangles(tmp_path):
    path = _ply(
        tmp_path / "a.ply",
        [(4, 5, 6), (0, 1, 2, 3)],
        more="property uchar red\nproperty uchar green\nproperty uchar blue\n",
        tails=bytes((255, 0, 0)),
    )
    assert _triangles(path) == _expected((4, 5, 6), (0, 1, 2), (0, 2, 3))
    assert np.allclose(load_parts(path).materials[0].color, (1, 0, 0))


def test_files_of_faces_that_are_alike_are_left_as_they_are_and_cut_ones_are_told(tmp_path):
    data = _ply(tmp_path / "a.ply", [(0, 1, 2, 3), (0, 1, 5, 4)]).read_bytes()
    assert even_faces(data) is data
    data = _ply(tmp_path / "a.ply", [(0, 1, 2), (0, 1, 5, 4)]).read_bytes()
    (tmp_path / "a.ply").write_bytes(data[:-12])
    with pytest.raises(InputError, match=r"a\.ply: "):
        load_parts(tmp_path / "a.ply")
