"""glTF files: what they become, and what a hostile one is told."""

import base64
import json
import resource
from pathlib import Path

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.scene import describe, load_world
from clsim.scene.gltf.scene import read_gltf
from tests.scene.gltf.gltf_files import CORNERS, glb, gltf, image_uri, write_gltf

ASSETS = Path(__file__).resolve().parents[4] / "shared" / "assets" / "gltf"


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


@pytest.mark.parametrize(("told", "shown"), [(None, "node"), (0, "node"), (1, "other")])
def test_of_several_scenes_the_default_one_is_shown(tmp_path, told, shown):
    nodes = [{"mesh": 0, "name": "node"}, {"mesh": 0, "name": "other"}]
    tree = gltf(nodes=nodes, scenes=[{"nodes": [0]}, {"nodes": [1]}], scene=told)
    if told is None:
        del tree["scene"]
    assert [each.name for each in load_world(write_gltf(tmp_path, tree)).instances] == [shown]


def test_base_colors_keep_their_factor_and_their_texture_with_its_top_row_first(tmp_path):
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
    parts = read_gltf(write_gltf(tmp_path, tree))
    material = parts.materials[0]
    assert material.kind == "principled"
    assert material.color == (1, 0.4, 0)
    texture = parts.textures[material.texture]
    assert texture.srgb
    np.testing.assert_array_equal(texture.pixels[..., :3], pixels)
    np.testing.assert_allclose(parts.meshes[0].uvs[2], (0.6, 0.6), atol=1e-6)  # glTF's v runs down, ours up


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
    assert world.materials[world.meshes[first.mesh].material_ids[0]].color == (1, 1, 1)
    toml.write_text(text + 'material = "red"\n')
    world = load_world(toml)
    colors = [world.materials[world.meshes[i.mesh].material_ids[0]].color for i in world.instances]
    assert colors == [(0.5, 0.5, 0.5), (1, 0, 0), (1, 0, 0)]


# What a hostile or broken file is told


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"points": [(0, 0, 0), (float("nan"), 0, 0), (0, 1, 0)]}, "accessors[0] holds a number that is not finite"),
        ({"points": [(0, 0, 0), (float("inf"), 0, 0), (0, 1, 0)]}, "accessors[0] holds a number that is not finite"),
        ({"points": [(1, 1, 1)] * 3}, "no extent"),
        ({"meshes": [], "nodes": [{}]}, "no triangles"),
        ({"nodes": []}, "uses nodes[0], of 0"),
        ({"buffers": [{"byteLength": 36, "uri": "missing.bin"}]}, "'missing.bin' is missing"),
        ({"buffers": [{"byteLength": 36, "uri": "http://example.com/a.bin"}]}, "address"),
        ({"buffers": [{"byteLength": 36, "uri": "//example.com/a.bin"}]}, "address"),
        ({"buffers": [{"byteLength": 36, "uri": "file:///etc/passwd"}]}, "address"),
        ({"buffers": [{"byteLength": 36, "uri": "/etc/passwd"}]}, "outside the folder"),
        ({"buffers": [{"byteLength": 36, "uri": "../secret.bin"}]}, "outside the folder"),
        ({"buffers": [{"byteLength": 36, "uri": "%2e%2e/secret.bin"}]}, "outside the folder"),
        ({"buffers": [{"byteLength": 99, "uri": "data:;base64,AAAA"}]}, "truncated"),
        ({"buffers": [{"byteLength": 36}]}, "truncated"),
        ({"images": [{"uri": "https://example.com/a.png"}]}, "address"),
        ({"images": [{"uri": "../secret.bin"}]}, "outside the folder"),
        ({"bufferViews": [{"buffer": 0, "byteLength": 999}]}, "bufferViews[0] ends at byte 999"),
        ({"bufferViews": [{"buffer": 7, "byteLength": 36}]}, "uses buffers[7]"),
        ({"bufferViews": [{"buffer": 0, "byteLength": -1}]}, "bufferViews.0.byteLength"),
        ({"accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}]}, "accessors[0] ends"),
        ({"accessors": [{"componentType": 5126, "count": 10**12, "type": "VEC3"}]}, "more than"),
        ({"accessors": [{"bufferView": 5, "componentType": 5126, "count": 3, "type": "VEC3"}]}, "uses bufferViews[5]"),
        (
            {"accessors": [{"bufferView": 0, "componentType": 9, "count": 3, "type": "VEC3"}]},
            "accessors.0.componentType",
        ),
        ({"accessors": "x"}, "accessors"),
        ({"asset": {"version": "1.0"}, "accessors": {"a": {}}}, "is glTF 1.0, expected 2.0"),
        ({"meshes": [{"primitives": [{"attributes": {"POSITION": 3}}]}]}, "uses accessors[3], of 1"),
        (  # a cycle that no root leads to
            {"nodes": [{"mesh": 0}, {"children": [2]}, {"children": [1]}]},
            "its own ancestor",
        ),
        ({"nodes": [{"children": [k + 1]} for k in range(5000)] + [{"mesh": 0}]}, "1000 levels deep"),
        ({"nodes": [{"mesh": 3}]}, "uses meshes[3], of 1"),
        ({"nodes": [{"children": [0]}]}, "nodes[0] has child 0"),
        ({"nodes": [{"children": [2]}, {"children": [2]}, {"mesh": 0}]}, "no other parent"),
        ({"nodes": [{"children": [9]}]}, "existing node"),
        ({"nodes": [{"mesh": 0, "scale": [0, 0, 0]}]}, "no extent"),
        ({"nodes": [{"mesh": 0, "translation": [1e300, 0, 0]}]}, "finite"),
        (
            {"extensionsRequired": ["EXT_meshopt_compression"]},
            "EXT_meshopt_compression, which clsim does not support; gltfpack",
        ),
        (
            {"extensionsRequired": ["KHR_texture_basisu", "KHR_meshopt_compression"]},
            "support; gltf-transform ktxdecompress IN OUT and gltfpack -i IN -o OUT unpacks it",
        ),
    ],
)
def test_broken_gltf_gets_one_sentence(tmp_path, changes, part):
    folder = tmp_path / "inner"
    folder.mkdir()
    (tmp_path / "secret.bin").write_bytes(np.array(CORNERS, "<f4").tobytes())
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


def test_a_glb_of_another_version_and_one_without_json_are_told_apart(tmp_path):
    path = tmp_path / "a.glb"
    whole = glb(gltf(), b"")
    path.write_bytes(whole[:4] + b"\1" + whole[5:])
    assert "is glTF version 1, expected 2" in complaint(path)
    path.write_bytes(whole[:16] + b"BIN\0" + whole[20:])
    assert "begins with a chunk of the kind b'BIN\\x00', expected its JSON" in complaint(path)


def test_a_mark_of_byte_order_before_the_json_is_no_fault(tmp_path):
    path = tmp_path / "marked.gltf"
    path.write_text(json.dumps(gltf()), encoding="utf-8-sig")
    assert len(load_world(path).meshes[0].triangles) == 1


@pytest.mark.parametrize("text", ["", "[]", "{", '{"a": NaN}', "[" * 100_000, "\udc80"])
def test_what_is_no_gltf_json(tmp_path, text):
    path = tmp_path / "a.gltf"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    complaint(path)


def test_an_image_that_unpacks_to_far_more_than_its_size_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("clsim.scene.pictures.images.MAX_PIXELS", 100)
    tree = gltf(
        materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        textures=[{"source": 0}],
        images=[{"uri": image_uri(np.zeros((11, 10, 3)))}],
    )
    tree["meshes"][0]["primitives"][0]["material"] = 0
    assert "10×11" in complaint(write_gltf(tmp_path, tree))


def test_a_small_file_cannot_fill_the_memory(tmp_path):
    """One page of JSON that claims terabytes: refused before anything of that size is allocated."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for count in (10**7, 10**9, 10**12):
        tree = gltf(accessors=[{"componentType": 5126, "count": count, "type": "MAT4"}])
        complaint(write_gltf(tmp_path, tree))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300 << 10  # KiB
