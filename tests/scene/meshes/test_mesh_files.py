"""Mesh files: what they become, and what a hostile one is told."""

import json
import math
import os
import shutil
import socket
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.files import asset_file, named_file
from clsim.scene.meshes.trimesh_scene import load_parts, load_triangles
from tests.scene.gltf.gltf_files import CORNERS, glb, gltf

ASSETS = Path(__file__).resolve().parents[4] / "shared" / "assets" / "gltf"
OBJ = "v 0 0 0\nv 2 0 0\nv 0 1 0\n"


def complaint(path):
    with pytest.raises(InputError) as caught:
        load_world(path)
    message = str(caught.value)
    assert path.name in message
    assert "\n" not in message
    return message


# What files become


def test_parts_of_which_some_lack_normals_are_one_flat_mesh(tmp_path):
    """Normals of a few vertices would be those of others; texture coordinates that lack are 0."""
    parts = "vn 0 0 1\nvt 0.5 0.25\nusemtl a\nf 1//1 2//1 3//1\nusemtl b\nf 1/1 2/1 3/1\n"
    (tmp_path / "a.obj").write_text(OBJ + parts)
    mesh = load_triangles(tmp_path / "a.obj")
    assert mesh.normals is None and len(mesh.triangles) == 2 and len(mesh.uvs) == len(mesh.vertices) == 6
    assert sorted(mesh.uvs[:, 0].tolist()) == [0, 0, 0, 0.5, 0.5, 0.5]


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".gltf", ".glb"])
def test_every_format_yields_the_same_triangle_and_is_flat_without_normals(tmp_path, suffix):
    path = tmp_path / f"triangle{suffix}"
    binary = np.array(CORNERS, "<f4").tobytes()
    if suffix == ".obj":
        path.write_text(OBJ + "f 1 2 3\n")
    elif suffix == ".ply":
        header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        path.write_text(
            header
            + "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n2 0 0\n0 1 0\n3 0 1 2\n"
        )
    elif suffix == ".gltf":
        path.write_text(json.dumps(gltf()))
    else:
        path.write_bytes(glb(gltf(buffers=[{"byteLength": 36}]), binary))
    world = load_world(path)
    mesh = world.meshes[world.instances[0].mesh]
    np.testing.assert_array_equal(mesh.vertices[mesh.triangles[0]], CORNERS)
    assert mesh.normals is None
    assert world.name == "triangle"


def test_obj_materials_keep_their_diffuse_color(tmp_path):
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 0.611 0.02 0.003\n")
    path = tmp_path / "a.obj"
    path.write_text("mtllib a.mtl\n" + OBJ + "usemtl red\nf 1 2 3\n")
    assert load_parts(path).materials[0].color == pytest.approx((0.611, 0.02, 0.003))


def test_colours_of_faces_are_averaged_as_light(tmp_path):
    head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    face = "element face 2\nproperty list uchar int vertex_indices\n"
    colors = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    body = "0 0 0\n1 0 0\n0 1 0\n1 1 0\n3 0 1 2 255 255 0\n3 1 3 2 0 255 0\n"
    (tmp_path / "a.ply").write_text(head + face + colors + "end_header\n" + body)
    parts = load_parts(tmp_path / "a.ply")
    assert parts.materials[0].color == pytest.approx((0.5, 1.0, 0.0))
    assert len(parts.warnings) == 1 and "faces are averaged" in parts.warnings[0]


@pytest.mark.parametrize("faces", ["f 1 2 3\n", "vt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"])
def test_meshes_without_any_color_are_grey(tmp_path, faces):
    path = tmp_path / "a.obj"
    path.write_text(OBJ + faces)
    assert load_parts(path).materials[0].color == (0.5, 0.5, 0.5)


@pytest.mark.parametrize("size", [0.01, 1.0, 1000.0])
def test_a_bare_file_is_framed_whatever_its_size(tmp_path, size):
    """All corners of the bounding box stay in view all the way round, and the lamp never does."""
    path = tmp_path / "a.obj"
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 2) for z in (0, 3)]) * size + 5 * size
    faces = "".join(f"f {a} {a + 1} {a + 2}\n" for a in range(1, 7))
    path.write_text("".join("v {} {} {}\n".format(*corner) for corner in corners) + faces)
    world = load_world(path)
    camera = world.camera
    tangent = math.tan(math.radians(camera.fov_deg / 2))
    for time_s in np.linspace(0, world.duration_s, 13):
        to_camera = np.linalg.inv(camera.motion.pose(time_s))

        def in_view(point, to_camera=to_camera):
            x, y, z, _ = to_camera @ (*point, 1)
            return z < 0 and abs(x / z) < tangent and abs(y / z) < tangent * camera.height / camera.width

        assert all(in_view(corner) for corner in corners)
        assert not in_view(world.sphere_lights[0].motion.pose(time_s)[:3, 3])
    assert world.duration_s > 0
    assert any(world.environment)


# What a hostile or broken file is told


PLY = "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
PLY_FACES = "element face {}\nproperty list uchar int vertex_indices\nend_header\n"


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "not a PLY file"),
        ("ply\nformat ascii 1.0\n", "not a PLY file"),
        (PLY.format(4_000_000_000) + PLY_FACES.format(1) + "0 0 0\n", "truncated"),
        (
            PLY.format(4_000_000_000).replace("ascii", "binary_little_endian") + PLY_FACES.format(1),
            "4000000001 elements",
        ),
        (PLY.format("many") + PLY_FACES.format(1), "line 3"),
        (PLY.format(3) + PLY_FACES.format(1) + "0 0 0\n2 0 0\n0 1 0\n", "truncated"),
        (PLY.format(3) + PLY_FACES.format(1) + "0 0 0\n2 0 0\n0 1 0\n3 0 1 7\n", "vertex 7"),
        (PLY.format(3) + PLY_FACES.format(1) + "0 0 0\nnan 0 0\n0 1 0\n3 0 1 2\n", "vertex 1 is (nan, 0, 0)"),
        (PLY.format(3) + PLY_FACES.format(0) + "0 0 0\n2 0 0\n0 1 0\n", ""),
        (
            PLY.format(3).replace("ascii", "binary_little_endian") + PLY_FACES.format(1) + "\0" * 40,
            "PLY",
        ),
    ],
)
def test_broken_ply_gets_one_sentence(tmp_path, text, part):
    path = tmp_path / "a.ply"
    path.write_text(text)
    assert part in complaint(path)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", ""),
        ("nothing here\n", ""),
        (OBJ, "no triangles"),
        (OBJ + "f 1 2 9\n", ""),
        ("v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", "vertex 1 is (nan, 0, 0)"),
        ("v 0 0 0\nv x 0 0\nv 0 1 0\nf 1 2 3\n", ""),
        (OBJ + "f 1 2 3\nf a b c\n", ""),
        ("mtllib ../up.mtl\n" + OBJ + "f 1 2 3\n", "outside the folder"),
        ("mtllib http://example.com/a.mtl\n" + OBJ + "f 1 2 3\n", "address"),
    ],
)
def test_broken_obj_gets_one_sentence(tmp_path, text, part):
    path = tmp_path / "a.obj"
    path.write_text(text)
    assert part in complaint(path)


def test_nothing_reaches_for_the_network(tmp_path, monkeypatch):
    def refuse(*_):
        raise AssertionError("a scene file opened a socket")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd http://example.com/a.png\n")
    path = tmp_path / "a.obj"
    path.write_text("mtllib a.mtl\n" + OBJ + "usemtl m\nf 1 2 3\n")
    assert "address" in complaint(path)


@pytest.mark.parametrize("reference", ["a.bin", "sub/a.bin", "a%20b.bin", "sub/../a.bin"])
def test_files_beside_the_scene_are_allowed(tmp_path, reference):
    assert asset_file(reference, tmp_path).is_relative_to(tmp_path)


@pytest.mark.parametrize("reference", ["a\0b", "C:\\a.bin", "..\\a.bin", "sub/../../a.bin", "data:x"])
def test_other_references_are_not(tmp_path, reference):
    with pytest.raises(InputError):
        asset_file(reference, tmp_path)


def test_a_scene_names_files_above_it_and_an_asset_only_where_its_user_says_so(tmp_path, monkeypatch):
    inner = tmp_path / "inner"
    inner.mkdir()
    above = tmp_path / "a.bin"
    above.write_bytes(b"x")
    (inner / "link.bin").symlink_to(above)
    for reference in ("../a.bin", "..\\a.bin", str(above), "link.bin"):
        assert named_file(reference, inner).resolve() == above.resolve()
    assert asset_file("link.bin", inner).resolve() == above.resolve()
    with pytest.raises(InputError, match=r"outside the folder .* CLSIM_ASSET_FOLDERS"):
        asset_file("../a.bin", inner)
    monkeypatch.setenv("CLSIM_ASSET_FOLDERS", f"/nowhere:{tmp_path}")
    assert asset_file("../a.bin", inner).resolve() == above.resolve()
    with pytest.raises(InputError, match="outside"):
        asset_file("../../a.bin", inner)
    for reference, part in (("/dev/null", "ordinary"), (".", "ordinary"), ("no", "missing"), ("http://a/b", "address")):
        with pytest.raises(InputError, match=part):
            named_file(reference, inner)


def test_what_an_obj_lacks_is_told_and_strict_refuses_it(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("mtllib a.mtl\n" + OBJ + "usemtl m\nf 1 2 3\n")
    for library, part in (
        (None, "a.obj: the material library a.mtl cannot be read (No such file or directory)"),
        ("newmtl n\nKd 1 0 0\n", "a.obj: there is no material m; grey stands in"),
        ("newmtl m\nmap_Kd no.png\n", "a.obj: the image no.png cannot be read (No such file or directory)"),
        ("newmtl m\nmap_Kd a.mtl\n", "a.obj: the image a.mtl cannot be decoded"),
        ("newmtl m\nKd 1 0 0\n", ""),
    ):
        if library is not None:
            (tmp_path / "a.mtl").write_text(library)
        assert [part in warning for warning in load_world(path).warnings] == [True] * bool(part)
        if part:
            with pytest.raises(InputError, match="refused by strict"):
                load_world(path, strict=True)


def test_names_in_another_encoding_are_read(tmp_path):
    """The image's own name is spelt in Latin-1, too."""
    folder = os.fsencode(tmp_path)
    image = os.path.join(folder, b"gr\xfcn.png")
    shutil.move(_png(tmp_path / "x.png"), image)
    (tmp_path / "b\u00fc.mtl").write_bytes(b"newmtl gr\xfcn\nmap_Kd gr\xfcn.png\n")
    path = tmp_path / "a.obj"
    path.write_bytes(b"# gr\xfcn\nmtllib b\xfc.mtl\n" + OBJ.encode() + b"vt 0 0\nusemtl gr\xfcn\nf 1/1 2/1 3/1\n")
    world = load_world(path)
    assert not world.warnings
    assert world.materials[0].texture == 0


def _png(path):
    PIL.Image.fromarray(np.full((2, 2, 3), 99, np.uint8)).save(path)
    return path


@pytest.mark.parametrize("color", ["Kd 0 0 0\n", ""], ids=["black", "none"])
def test_black_or_no_colour_beside_a_texture_means_the_texture(tmp_path, color):
    _png(tmp_path / "a.png")
    (tmp_path / "a.mtl").write_text(f"newmtl m\n{color}map_Kd a.png\n")
    path = tmp_path / "a.obj"
    path.write_text("mtllib a.mtl\n" + OBJ + "vt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n")
    assert load_world(path).materials[0].color == (1, 1, 1)


def test_a_ply_of_fewer_lines_than_all_of_its_elements_is_cut(tmp_path):
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    face = "element face 3\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(head + face + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2")
    assert "declares 6 elements, more than it has room for: it is truncated" in complaint(tmp_path / "a.ply")


UTM = np.array([448262.0, 5411932.0, 310.0])
"""Metres east and north in zone 32, and above the sea."""


@pytest.mark.parametrize("suffix", [".obj", ".ply"])
def test_a_surveyed_mesh_keeps_its_millimetres(tmp_path, suffix):
    corners = np.add(UTM, [(0.001, 0.002, 0.004), (3.123, 0.001, 0.003), (1.007, 2.501, 0.123)])
    rows = [" ".join(f"{x:.3f}" for x in corner) for corner in corners]
    text = "\n".join(["# a", *(f"v {row}" for row in rows), "f 1 2 3\n"])
    if suffix == ".ply":
        head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\n"
        text = "\n".join(
            [head + "element face 1\nproperty list uchar int vertex_indices\nend_header", *rows, "3 0 1 2\n"]
        )
    (tmp_path / f"a{suffix}").write_text(text)
    (tmp_path / "a.toml").write_text(
        "[camera]\nposition = [0, 0, 9]\n[environment]\nradiance = [1, 1, 1]\n"
        f"[[objects]]\nfile = 'a{suffix}'\nposition = [0, 0, 1000]\n"
    )
    for name, moved in ((f"a{suffix}", 0), ("a.toml", 1000)):
        world = load_world(tmp_path / name)
        pose = world.instances[0].motion.pose(0.0)
        places = world.meshes[0].vertices.astype(np.float64) @ pose[:3, :3].T + pose[:3, 3]
        np.testing.assert_allclose(places, corners + np.array((0, 0, moved)), rtol=0, atol=1e-5)
    assert np.linalg.norm(load_world(tmp_path / f"a{suffix}").camera.motion.pose(0.0)[:3, 3] - corners[0]) < 20
