"""Mitsuba's serialized meshes, by the table of the format in its documentation; and what a shape says of normals."""

import struct
import zlib

import numpy as np
import pytest

from clsim.scene.world import Mesh
from tests.scene.mitsuba.mitsuba_files import load

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


PLY = """ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z
property float u\nproperty float v\nelement face 1\nproperty list uchar int vertex_indices\nend_header
0 0 0 .1 .2\n1 0 0 .3 .4\n0 1 0 .5 .9\n3 0 1 2\n"""
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt .1 .2\nvt .3 .4\nvt .5 .9\nf 1/1 2/2 3/3\n"


@pytest.mark.parametrize("kind", ["obj", "ply"])
@pytest.mark.parametrize("told", [None, "true", "false"])
def test_which_way_v_runs_is_the_shapes_to_say(tmp_path, kind: str, told: str | None) -> None:
    """Mitsuba's pictures begin on top, and flip_tex_coords turns v round: by default in OBJ, and not in PLY."""
    (tmp_path / f"a.{kind}").write_text(OBJ if kind == "obj" else PLY)
    more = "" if told is None else f'<boolean name="flip_tex_coords" value="{told}"/>'
    mesh = load(tmp_path, f'<shape type="{kind}"><string name="filename" value="a.{kind}"/>{more}</shape>').meshes[0]
    flipped = kind == "obj" if told is None else told == "true"
    from_top = {0.2: 0.2, 0.4: 0.4, 0.9: 0.9} if not flipped else {0.2: 0.8, 0.4: 0.6, 0.9: 0.1}
    found = dict(zip(map(tuple, mesh.vertices.tolist()), mesh.uvs.tolist(), strict=True))
    for place, u, v in (((0, 0, 0), 0.1, 0.2), ((1, 0, 0), 0.3, 0.4), ((0, 1, 0), 0.5, 0.9)):
        assert found[place] == pytest.approx((u, 1 - from_top[v]))


@pytest.mark.parametrize("radius", [0.5, 3.0])
def test_spheres_have_their_radius_about_their_centre(tmp_path, radius: float) -> None:
    told = f'<point name="center" x="1" y="2" z="3"/><float name="radius" value="{radius}"/>'
    world = load(tmp_path, f'<shape type="sphere">{told}</shape>')
    pose = world.instances[0].motion.pose(0.0)
    away = world.meshes[0].vertices @ pose[:3, :3].T + pose[:3, 3] - (1, 2, 3)
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), radius, rtol=1e-5)


@pytest.mark.parametrize(
    ("kind", "more", "area", "from_uv"),
    [
        (
            "sphere",
            '<point name="center" x="1" y="2" z="3"/><float name="radius" value="0.5"/>',
            np.pi,
            lambda u, v: (
                (1, 2, 3) + 0.5 * np.array([np.sin(v / 2) * np.cos(u), np.sin(v / 2) * np.sin(u), np.cos(v / 2)])
            ),
        ),
        ("disk", "", np.pi, lambda u, v: u / (2 * np.pi) * np.array([np.cos(v), np.sin(v), 0.0])),
        (
            "cylinder",
            '<point name="p0" z="-1"/><point name="p1" z="2"/><float name="radius" value="0.5"/>',
            3 * np.pi,
            None,
        ),
    ],
)
def test_round_shapes_are_as_large_and_laid_out_as_mitsuba_says(tmp_path, kind, more, area, from_uv):
    """A sphere's u is its longitude and v its angle from +z, a disk's u the radius and v the angle."""
    (mesh,) = load(tmp_path, f'<shape type="{kind}">{more}<bsdf type="diffuse"/></shape>').meshes
    corners = mesh.vertices.astype(float)[mesh.triangles]
    across, middles = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), corners.mean(axis=1)
    assert np.linalg.norm(across, axis=1).sum() / 2 == pytest.approx(area, rel=0.01)
    outwards = {"sphere": middles - (1, 2, 3), "disk": np.array([0, 0, 1]), "cylinder": middles * (1, 1, 0)}[kind]
    assert ((across * outwards).sum(axis=1) > 0).all(), "fronts are outside"
    if from_uv is not None:
        # Here v counts from a picture's bottom.
        expected = [from_uv(2 * np.pi * float(u), 2 * np.pi * (1 - float(v))) for u, v in mesh.uvs]
        np.testing.assert_allclose(mesh.vertices, expected, atol=1e-5)


CUBE = """1 -1 -1  1 -1 1  -1 -1 1  -1 -1 -1    1 1 -1  -1 1 -1  -1 1 1  1 1 1    1 -1 -1  1 1 -1  1 1 1  1 -1 1
1 -1 1  1 1 1  -1 1 1  -1 -1 1    -1 -1 1  -1 1 1  -1 1 -1  -1 -1 -1    1 1 -1  1 -1 -1  -1 -1 -1  -1 1 -1"""
"""The corners of its faces in Mitsuba's own table; each has the texture coordinates 0 1, 1 1, 1 0 and 0 0."""


def test_pictures_lie_on_a_cube_as_in_mitsuba(tmp_path):
    """Corners are told apart by the face that they are of: the axis along which all four are alike."""
    faces = np.array(CUBE.split(), float).reshape(6, 4, 3)
    expected = {
        (*face.sum(axis=0), *corner, *uv)
        for face in faces
        for corner, uv in zip(face, ((0, 1), (1, 1), (1, 0), (0, 0)), strict=True)
    }
    (mesh,) = load(tmp_path, '<shape type="cube"><bsdf type="diffuse"/></shape>').meshes
    found = zip(mesh.vertices.reshape(6, 4, 3), mesh.uvs.reshape(6, 4, 2), strict=True)
    # Here v counts from a picture's bottom.
    assert {(*f.sum(axis=0), *c, u, 1 - v) for f, uvs in found for c, (u, v) in zip(f, uvs, strict=True)} == expected


def test_what_is_stretched_moves_as_far_as_its_keys_say(tmp_path) -> None:
    keys = ((0, 0, 3), (1, 90, 5))
    rows = "".join(
        f'<transform time="{time}"><scale x="2"/><rotate y="1" angle="{angle}"/><translate x="{x}"/></transform>'
        for time, angle, x in keys
    )
    world = load(tmp_path, f'<shape type="cube"><animation name="to_world">{rows}</animation></shape>')
    (cube,) = world.instances
    for time_s, middle, reach in ((0.0, 3, (2, 1, 1)), (1.0, 5, (1, 1, 2))):
        pose = cube.motion.pose(time_s)
        points = world.meshes[cube.mesh].vertices @ pose[:3, :3].T + pose[:3, 3]
        assert points.mean(axis=0) == pytest.approx((middle, 0, 0), abs=1e-5)
        assert np.ptp(points, axis=0) / 2 == pytest.approx(reach, abs=1e-5)
