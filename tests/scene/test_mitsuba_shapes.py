"""Mitsuba's serialized meshes, by the table of the format in its documentation; and what a shape says of normals."""

import struct
import zlib

import numpy as np
import pytest

from clsim.scene.world import Mesh
from tests.scene.mitsuba_files import load

ROOF = [(-1, 0, 0), (1, 0, 0), (0, 1, 1), (0, -1, 1)]
"""Two triangles that share an edge, at an angle."""
FACES = [(0, 1, 2), (1, 0, 3)]
NORMALS = [(0, 0, -1), (0, 0, -1), (0, -0.6, 0.8), (0, 0.6, 0.8)]
UVS = [(0.1, 0.2), (0.3, 0.4), (0.5, 0.6), (0.7, 0.8)]
COLORS = [(1, 0, 0)] * 4


def serialized(tmp_path, flags: int, version: int, *columns: list[tuple[float, ...]], first: bytes = b"") -> None:
    """Write a file whose last mesh is the roof with these columns, after another."""
    real = "<f8" if flags & 0x2000 else "<f4"
    name = b"roof\0" if version == 4 else b""
    body = struct.pack("<I", flags) + name + struct.pack("<QQ", len(ROOF), len(FACES))
    body += b"".join(np.asarray(column, real).tobytes() for column in (ROOF, *columns))
    data = struct.pack("<HH", 0x041C, version) + zlib.compress(body + np.asarray(FACES, "<u4").tobytes())
    kind = "Q" if version == 4 else "I"
    offsets = struct.pack(f"<{kind}", 0) + (struct.pack(f"<{kind}", len(data)) if first else b"")
    (tmp_path / "a.serialized").write_bytes(data + first + offsets + struct.pack("<I", 2 if first else 1))


def read(tmp_path, more: str = "") -> Mesh:
    shape = f'<shape type="serialized"><string name="filename" value="a.serialized"/>{more}</shape>'
    return load(tmp_path, shape).meshes[0]


@pytest.mark.parametrize("precision", [0x1000, 0x2000])
@pytest.mark.parametrize("version", [3, 4])
def test_columns_are_those_of_the_table(tmp_path, precision: int, version: int) -> None:
    serialized(tmp_path, precision | 0x1 | 0x2 | 0x8, version, NORMALS, UVS, COLORS)
    mesh = read(tmp_path)
    np.testing.assert_allclose(mesh.vertices, ROOF)
    np.testing.assert_allclose(mesh.normals, NORMALS, atol=1e-6)
    # Mitsuba's v runs down.
    np.testing.assert_allclose(mesh.uvs, [(u, 1 - v) for u, v in UVS], atol=1e-6)
    assert mesh.triangles.tolist() == [list(face) for face in FACES]


def test_meshes_without_normals_are_smooth_unless_file_or_scene_ask_for_faces(tmp_path) -> None:
    serialized(tmp_path, 0x1000, 4)
    smooth = read(tmp_path)
    # Where both triangles meet, their normals' mean: up between two slopes of 45 degrees.
    np.testing.assert_allclose(smooth.normals[:2], [(0, 0, 1)] * 2, atol=1e-6)
    assert read(tmp_path, '<boolean name="face_normals" value="true"/>').normals is None
    serialized(tmp_path, 0x1000 | 0x10, 4)
    assert read(tmp_path).normals is None
    serialized(tmp_path, 0x1000 | 0x10 | 0x1, 4, NORMALS)
    assert read(tmp_path).normals is None


def test_flipped_normals_turn_triangles_and_normals(tmp_path) -> None:
    serialized(tmp_path, 0x1000 | 0x1, 4, NORMALS)
    plain, flipped = read(tmp_path), read(tmp_path, '<boolean name="flip_normals" value="true"/>')
    np.testing.assert_allclose(flipped.normals, -plain.normals)
    for before, after in zip(plain.triangles, flipped.triangles, strict=True):
        a, b = (np.cross(*(mesh[1:] - mesh[0])) for mesh in (plain.vertices[before], flipped.vertices[after]))
        np.testing.assert_allclose(a, -b)
