"""Mesh files: what they become, and what a hostile one is told."""

import base64
import io
import json
import math
import resource
import socket
import struct
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from clsim.errors import InputError
from clsim.scene import describe, load_world
from clsim.scene.files import inside_folder
from clsim.scene.trimesh_scene import load_parts

ASSETS = Path(__file__).resolve().parents[3] / "shared" / "assets" / "gltf"
CORNERS = [(0, 0, 0), (2, 0, 0), (0, 1, 0)]
OBJ = "v 0 0 0\nv 2 0 0\nv 0 1 0\n"


def gltf(**changes):
    """Return the JSON of one triangle, its positions in a data URI; keywords replace top-level keys."""
    points = np.array(changes.pop("points", CORNERS), "<f4").tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(points).decode()
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "node"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": uri}],
    }
    return tree | changes


def write_gltf(tmp_path, tree):
    path = tmp_path / "scene.gltf"
    path.write_text(json.dumps(tree))
    return path


def glb(tree, binary=b""):
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if binary:
        chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def image_uri(pixels):
    data = io.BytesIO()
    PIL.Image.fromarray(np.asarray(pixels, np.uint8)).save(data, "PNG")
    return "data:image/png;base64," + base64.b64encode(data.getvalue()).decode()


def world_point(world, instance, vertex, time_s=0.0):
    point = instance.motion.pose(time_s) @ (*world.meshes[instance.mesh].vertices[vertex], 1)
    return tuple(float(x) for x in point[:3])


def complaint(path):
    with pytest.raises(InputError) as caught:
        load_world(path)
    message = str(caught.value)
    assert path.name in message
    assert "\n" not in message
    return message


# What files become


def test_gltf_places_meshes_and_shares_them_between_nodes(tmp_path):
    nodes = [
        {"children": [1, 2, 3], "translation": [10, 0, 0]},
        {"mesh": 0, "name": "a", "translation": [0, 1, 0]},
        {"mesh": 0, "name": "b", "scale": [2, 2, 2]},
        {"mesh": 0, "name": "c", "scale": [1, 3, 1]},
    ]
    world = load_world(write_gltf(tmp_path, gltf(nodes=nodes)))
    corners = {tuple(world_point(world, instance, k) for k in (1, 2)): instance.mesh for instance in world.instances}
    assert set(corners) == {((12, 1, 0), (10, 2, 0)), ((14, 0, 0), (10, 2, 0)), ((12, 0, 0), (10, 3, 0))}
    a, b, c = (corners[key] for key in (((12, 1, 0), (10, 2, 0)), ((14, 0, 0), (10, 2, 0)), ((12, 0, 0), (10, 3, 0))))
    assert a == b != c  # only the stretched one needs its own
    assert describe(world)["triangles"] == 3


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


def test_base_color_factors_and_textures_become_a_linear_color(tmp_path):
    """The texture is black but for its upper right quarter, and the triangle lies on that quarter alone."""
    uvs = np.array([(0.6, 0.1), (0.9, 0.1), (0.6, 0.4)], "<f4").tobytes()
    pixels = np.zeros((4, 8, 3))
    pixels[:2, 4:] = 188  # sRGB 188 is linear 0.503
    tree = gltf(
        materials=[{"pbrMetallicRoughness": {"baseColorFactor": [1, 0.4, 0, 1], "baseColorTexture": {"index": 0}}}],
        textures=[{"source": 0}],
        images=[{"uri": image_uri(pixels)}],
        meshes=[{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
    )
    tree["buffers"].append(
        {"byteLength": 24, "uri": "data:application/octet-stream;base64," + base64.b64encode(uvs).decode()}
    )
    tree["bufferViews"].append({"buffer": 1, "byteLength": 24})
    tree["accessors"].append({"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"})
    parts = load_parts(write_gltf(tmp_path, tree))
    linear = ((188 / 255 + 0.055) / 1.055) ** 2.4
    assert parts.materials[0].color == pytest.approx((linear, 0.4 * linear, 0), abs=2e-3)
    np.testing.assert_allclose(parts.meshes[0].uvs[2], (0.6, 0.6), atol=1e-6)  # glTF's v runs down, ours up


def test_obj_materials_keep_their_diffuse_color(tmp_path):
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 0.611 0.02 0.003\n")
    path = tmp_path / "a.obj"
    path.write_text("mtllib a.mtl\n" + OBJ + "usemtl red\nf 1 2 3\n")
    assert load_parts(path).materials[0].color == pytest.approx((0.611, 0.02, 0.003))


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


def test_a_toml_places_a_file_with_all_its_parts(tmp_path):
    nodes = [{"mesh": 0, "translation": [0, 7, 0]}, {"mesh": 0, "scale": [1, 2, 1]}]
    write_gltf(tmp_path, gltf(nodes=nodes, scenes=[{"nodes": [0, 1]}]))
    toml = tmp_path / "scene.toml"
    text = """
        [camera]
        position = [0, 0, 9]
        [materials.red]
        color = [1, 0, 0]
        [[objects]]
        shape = "box"
        [[objects]]
        file = "scene.gltf"
        scale = 2
        keyframes = [{ time_s = 0, position = [0, 0, 0] }, { time_s = 1, position = [5, 0, 0] }]
    """
    toml.write_text(text)
    world = load_world(toml)
    _, first, second = world.instances
    ends = {world_point(world, instance, 2, time_s=1.0) for instance in (first, second)}
    assert ends == {(5, 16, 0), (5, 4, 0)}
    assert world.materials[world.meshes[first.mesh].material_ids[0]].color == (0.5, 0.5, 0.5)
    toml.write_text(text + 'material = "red"\n')
    world = load_world(toml)
    colors = [world.materials[world.meshes[i.mesh].material_ids[0]].color for i in world.instances]
    assert colors == [(0.5, 0.5, 0.5), (1, 0, 0), (1, 0, 0)]


@pytest.mark.skipif(not ASSETS.is_dir(), reason="the real scenes are not beside this checkout")
def test_real_scenes_load_with_their_size_color_and_what_they_lack():
    helmet = load_world(ASSETS / "FlightHelmet" / "FlightHelmet.gltf")
    assert describe(helmet)["triangles"] == 94_722
    assert all(mesh.normals is not None for mesh in helmet.meshes)
    assert len({material.color for material in helmet.materials}) == 6
    fox = load_world(ASSETS / "Fox.glb")
    assert describe(fox)["triangles"] == 576
    assert np.ptp(fox.meshes[0].vertices, axis=0).max() == pytest.approx(154.7, abs=0.1)
    red, green, blue = fox.materials[0].color
    assert red > green > blue  # it is a fox
    assert any("animations" in warning for warning in fox.warnings)
    assert any("skins" in warning for warning in fox.warnings)


# What a hostile or broken file is told


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"points": [(0, 0, 0), (float("nan"), 0, 0), (0, 1, 0)]}, "vertex 1 is (nan, 0, 0)"),
        ({"points": [(0, 0, 0), (float("inf"), 0, 0), (0, 1, 0)]}, "vertex 1 is (inf, 0, 0)"),
        ({"points": [(1, 1, 1)] * 3}, "no extent"),
        ({"meshes": [], "nodes": [{}]}, "no triangles"),
        ({"nodes": []}, "cannot be read as GLTF"),
        ({"buffers": [{"byteLength": 36, "uri": "missing.bin"}]}, "'missing.bin' is missing"),
        ({"buffers": [{"byteLength": 36, "uri": "http://example.com/a.bin"}]}, "address"),
        ({"buffers": [{"byteLength": 36, "uri": "//example.com/a.bin"}]}, "address"),
        ({"buffers": [{"byteLength": 36, "uri": "file:///etc/passwd"}]}, "address"),
        ({"buffers": [{"byteLength": 36, "uri": "/etc/passwd"}]}, "outside the folder"),
        ({"buffers": [{"byteLength": 36, "uri": "../secret.bin"}]}, "outside the folder"),
        ({"buffers": [{"byteLength": 36, "uri": "%2e%2e/secret.bin"}]}, "outside the folder"),
        ({"buffers": [{"byteLength": 36, "uri": "link.bin"}]}, "outside the folder"),
        ({"buffers": [{"byteLength": 99, "uri": "data:;base64,AAAA"}]}, "truncated"),
        ({"buffers": [{"byteLength": 36}]}, "truncated"),
        ({"images": [{"uri": "https://example.com/a.png"}]}, "address"),
        ({"images": [{"uri": "../secret.bin"}]}, "outside the folder"),
        ({"bufferViews": [{"buffer": 0, "byteLength": 999}]}, "bufferViews[0] ends after its buffer"),
        ({"bufferViews": [{"buffer": 7, "byteLength": 36}]}, "bufferViews[0] uses buffer 7"),
        ({"bufferViews": [{"buffer": 0, "byteLength": -1}]}, "bufferViews.0.byteLength"),
        ({"accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}]}, "accessors[0] ends"),
        ({"accessors": [{"componentType": 5126, "count": 10**12, "type": "VEC3"}]}, "more than"),
        ({"accessors": [{"bufferView": 5, "componentType": 5126, "count": 3, "type": "VEC3"}]}, "bufferView 5"),
        ({"accessors": [{"bufferView": 0, "componentType": 9, "count": 3, "type": "VEC3"}]}, "accessors[0]"),
        ({"accessors": "x"}, "accessors"),
        ({"meshes": [{"primitives": [{"attributes": {"POSITION": 3}}]}]}, "uses accessor 3"),
        ({"meshes": [{"primitives": [{"attributes": {"POSITION": 0}}] * 100_001}]}, "more than"),
        (
            {"nodes": [{"mesh": 0}] * 40_000, "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}] * 3}]},
            "more than",
        ),
        ({"nodes": [{"mesh": 3}]}, "nodes[0] uses mesh 3"),
        ({"nodes": [{"children": [0]}]}, "ancestor"),
        ({"nodes": [{"children": [2]}, {"children": [2]}, {"mesh": 0}]}, "no other parent"),
        ({"nodes": [{"children": [9]}]}, "existing node"),
        ({"nodes": [{"mesh": 0, "scale": [0, 0, 0]}]}, "no extent"),
        ({"nodes": [{"mesh": 0, "translation": [1e300, 0, 0]}]}, "finite"),
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "KHR_draco_mesh_compression"),
    ],
)
def test_broken_gltf_gets_one_sentence(tmp_path, changes, part):
    folder = tmp_path / "inner"
    folder.mkdir()
    (tmp_path / "secret.bin").write_bytes(np.array(CORNERS, "<f4").tobytes())
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    assert part in complaint(write_gltf(folder, gltf(**changes)))


@pytest.mark.parametrize("length", [0, 3, 12, 19, 40, 400, -1])
def test_truncated_glb(tmp_path, length):
    path = tmp_path / "cut.glb"
    whole = glb(gltf(buffers=[{"byteLength": 36}]), np.array(CORNERS, "<f4").tobytes())
    path.write_bytes(whole)
    load_world(path)
    path.write_bytes(whole[:length])
    message = complaint(path)
    assert "truncated" in message or "not a binary glTF" in message


@pytest.mark.parametrize("text", ["", "[]", "{", '{"a": NaN}', "[" * 100_000, "\udc80"])
def test_what_is_no_gltf_json(tmp_path, text):
    path = tmp_path / "a.gltf"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    complaint(path)


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


def test_an_image_that_unpacks_to_far_more_than_its_size_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("clsim.scene.trimesh_scene.MAX_PIXELS", 100)
    tree = gltf(
        materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        textures=[{"source": 0}],
        images=[{"uri": image_uri(np.zeros((11, 10, 3)))}],
    )
    tree["meshes"][0]["primitives"][0]["material"] = 0
    assert "10×11" in complaint(write_gltf(tmp_path, tree))


def test_nothing_reaches_for_the_network(tmp_path, monkeypatch):
    def refuse(*_):
        raise AssertionError("a scene file opened a socket")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd http://example.com/a.png\n")
    path = tmp_path / "a.obj"
    path.write_text("mtllib a.mtl\n" + OBJ + "usemtl m\nf 1 2 3\n")
    assert "address" in complaint(path)


def test_a_small_file_cannot_fill_the_memory(tmp_path):
    """One page of JSON that claims terabytes: refused before anything of that size is allocated."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for count in (10**7, 10**9, 10**12):
        tree = gltf(accessors=[{"componentType": 5126, "count": count, "type": "MAT4"}])
        complaint(write_gltf(tmp_path, tree))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300 << 10  # KiB


@pytest.mark.parametrize("reference", ["a.bin", "sub/a.bin", "a%20b.bin", "sub/../a.bin"])
def test_files_beside_the_scene_are_allowed(tmp_path, reference):
    assert not inside_folder(reference, tmp_path).is_absolute()


@pytest.mark.parametrize("reference", ["a\0b", "C:\\a.bin", "..\\a.bin", "sub/../../a.bin", "data:x"])
def test_other_references_are_not(tmp_path, reference):
    with pytest.raises(InputError):
        inside_folder(reference, tmp_path)
