"""Binary PLY files whose faces have different numbers of corners, as Blender writes them."""

import logging
import struct

import numpy as np
import pytest
import trimesh

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


ARROW = [(0, 0), (4, 0), (1, 1), (0, 4)]
"""Concave at (1, 1): its area is 4, and a fan from (4, 0) covers 12."""


def _area(path):
    mesh = load_triangles(path)
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(("faces", "area"), [([(1, 2, 3, 0)], 4), ([(1, 2, 3, 0), (0, 1, 3)], 12)])
def test_concave_faces_of_binary_files_end_at_their_outline(tmp_path, order, faces, area):
    name = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = f"ply\nformat {name} 1.0\nelement vertex 4\nproperty uchar flag\nproperty float y\nproperty double x\n"
    head += f"property float z\nelement face {len(faces)}\nproperty list uchar ushort vertex_indices\nend_header\n"
    body = b"".join(struct.pack(f"{order}Bfdf", 9, y, x, 0) for x, y in ARROW)
    body += b"".join(struct.pack(f"{order}B{len(face)}H", len(face), *face) for face in faces)
    (tmp_path / "a.ply").write_bytes(head.encode() + body)
    assert _area(tmp_path / "a.ply") == pytest.approx(area)


def test_concave_faces_of_text_end_at_their_outline_and_keep_what_follows_them(tmp_path):
    head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 2\nproperty list uchar int vertex_indices\nproperty uchar red\nproperty uchar green\n"
    head += "property uchar blue\nelement other 1\nproperty int q\nend_header\n"
    body = "".join(f"{x} {y} 0\n" for x, y in ARROW) + "4 1 2 3 0 255 0 0\n3 0 1 3 255 0 0\n5\n"
    (tmp_path / "a.ply").write_text(head + body)
    assert _area(tmp_path / "a.ply") == pytest.approx(12)
    assert load_parts(tmp_path / "a.ply").materials[0].color == pytest.approx((1, 0, 0))


@pytest.mark.parametrize("names", ["red green blue", "diffuse_red diffuse_green diffuse_blue", "r g b"])
def test_colours_go_by_several_names(tmp_path, names):
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    head += "".join(f"property uchar {name}\n" for name in names.split())
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(head + "0 0 0 255 0 0\n1 0 0 0 128 0\n0 1 0 0 0 255\n3 0 1 2\n")
    assert load_parts(tmp_path / "a.ply").meshes[0].colors == pytest.approx(np.diag((1, 0.21586, 1)), abs=1e-5), "sRGB"


@pytest.mark.parametrize("names", ["u v", "s t", "texture_u texture_v", "texture_s texture_t"])
def test_texture_coordinates_go_by_several_names(tmp_path, names):
    """Those that pbrt-v4 reads."""
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    head += "".join(f"property float {name}\n" for name in names.split())
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(head + "0 0 0 .1 .2\n1 0 0 .3 .4\n0 1 0 .5 .6\n3 0 1 2\n")
    assert load_triangles(tmp_path / "a.ply").uvs == pytest.approx(np.array([(0.1, 0.2), (0.3, 0.4), (0.5, 0.6)]))


def test_strips_are_refused_with_advice(tmp_path):
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(head + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    with pytest.raises(InputError, match="strips of triangles, expected faces: open it in MeshLab and save it anew"):
        load_parts(tmp_path / "a.ply")


def test_an_image_that_is_missing_is_told_once(tmp_path, capsys):
    head = "ply\nformat ascii 1.0\ncomment TextureFile no.png\nelement vertex 3\nproperty float x\nproperty float y\n"
    head += "property float z\nproperty float s\nproperty float t\nelement face 1\n"
    head += "property list uchar int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(head + "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n")
    logger = trimesh.util.log
    handler = logging.StreamHandler()
    logger.addHandler(handler)
    try:
        (told,) = load_parts(tmp_path / "a.ply").warnings
    finally:
        logger.removeHandler(handler)
    assert "the image no.png cannot be read" in told and not capsys.readouterr().err and not logger.disabled


@pytest.mark.parametrize("line", ["property", "property\x0cist uchar int vertex_indices", "propertylist"])
def test_headers_that_are_damaged_are_told(tmp_path, line):
    head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    (tmp_path / "a.ply").write_text(
        f"{head}element face 1\n{line}\nend_header\n" + "".join(f"{x} {y} 0\n" for x, y in ARROW) + "4 0 1 2 3\n"
    )
    with pytest.raises(InputError, match=r"a\.ply: "):
        load_parts(tmp_path / "a.ply")
