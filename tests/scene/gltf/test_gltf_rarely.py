"""What glTF files say rarely: it is read, or a warning tells that it is not."""

import numpy as np
import pytest

from clsim.scene.gltf.scene import load_gltf
from clsim.scene.pictures.images import decode_srgb
from tests.scene.gltf.gltf_files import CORNERS, add, animate, glb, gltf, image_uri, with_camera, write_gltf


def with_material(material, **changes):
    tree = gltf(materials=[material], **changes)
    tree["meshes"][0]["primitives"][0]["material"] = 0
    return tree


def test_an_index_of_zero_leaves_reflection_to_the_specular_colour(tmp_path):
    # KHR_materials_ior: Fresnel's term is 1 then, which stands for the specular-glossiness of old.
    extensions = {"KHR_materials_ior": {"ior": 0}, "KHR_materials_specular": {"specularColorFactor": [0.5, 0.6, 0.7]}}
    (found,) = load_gltf(write_gltf(tmp_path, with_material({"extensions": extensions}))).materials
    straight = ((found.ior - 1) / (found.ior + 1)) ** 2
    assert np.multiply(found.specular_color, straight) == pytest.approx((0.5, 0.6, 0.7), rel=0.01)


@pytest.mark.parametrize("textured", [False, True])
def test_specular_and_glossiness_reflect_as_told(tmp_path, textured):
    # The extension's own gold, whose diffuse colour is black.
    gold = {"diffuseFactor": [0, 0, 0, 1], "specularFactor": [1, 0.766, 0.336], "glossinessFactor": 0.9}
    pixels = np.full((2, 2, 4), (255, 188, 128, 51))
    picture = {"images": [{"uri": image_uri(pixels)}], "textures": [{"source": 0}]} if textured else {}
    extension = gold | ({"specularGlossinessTexture": {"index": 0}} if textured else {})
    tree = with_material({"extensions": {"KHR_materials_pbrSpecularGlossiness": extension}}, **picture)
    (found,) = load_gltf(write_gltf(tmp_path, tree)).materials
    straight = ((found.ior - 1) / (found.ior + 1)) ** 2
    expected = np.array(gold["specularFactor"]) * (decode_srgb(pixels[0, 0, :3] / 255) if textured else 1)
    assert np.multiply(found.specular_color, straight) == pytest.approx(expected, rel=0.01)
    assert (found.color, found.metallic) == ((0, 0, 0), 0)
    assert found.alpha == pytest.approx((1 - 0.9 * (0.2 if textured else 1)) ** 2)


def test_normals_that_are_all_zero_are_none(tmp_path):
    tree = gltf()
    tree["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = add(tree, np.zeros((3, 3)))
    world = load_gltf(write_gltf(tmp_path, tree))
    assert world.meshes[0].normals is None
    assert world.warnings == ("scene.gltf: a mesh whose normals are all 0 is rendered flat",)


def test_nodes_that_are_not_visible_are_not_there_nor_what_they_hold(tmp_path):
    hidden = {"mesh": 0, "children": [2], "extensions": {"KHR_node_visibility": {"visible": False}}}
    nodes = [{"mesh": 0, "name": "seen"}, hidden, {"mesh": 0}]
    required = ["KHR_node_visibility"]
    tree = gltf(nodes=nodes, scenes=[{"nodes": [0, 1]}], extensionsUsed=required, extensionsRequired=required)
    world = load_gltf(write_gltf(tmp_path, tree))
    assert [each.name for each in world.instances] == ["seen"] and not world.warnings


@pytest.mark.parametrize("name", ["scene.gltf", "scene.glb"])
@pytest.mark.parametrize("binary", [False, True])
def test_a_file_is_read_as_what_it_is_whatever_its_ending(tmp_path, name, binary):
    write_gltf(tmp_path, gltf())
    text = (tmp_path / "scene.gltf").read_bytes()
    (tmp_path / name).write_bytes(glb(gltf()) if binary else text)
    world = load_gltf(tmp_path / name)
    assert world.meshes[0].vertices == pytest.approx(np.array(CORNERS, float))


def test_a_text_that_is_filled_up_with_zeros_is_read(tmp_path):
    whole = glb(gltf())
    length = int.from_bytes(whole[12:16], "little")
    filled = (
        whole[:8] + (len(whole) + 4).to_bytes(4, "little") + (length + 4).to_bytes(4, "little") + whole[16:] + bytes(4)
    )
    (tmp_path / "a.glb").write_bytes(filled)
    assert load_gltf(tmp_path / "a.glb").meshes[0].vertices == pytest.approx(np.array(CORNERS, float))


@pytest.mark.parametrize(("coordinates", "told"), [([], 1), (["TEXCOORD_1"], 1), (["TEXCOORD_0"], 0)])
def test_a_texture_without_its_coordinates_is_told(tmp_path, coordinates, told):
    tree = with_material(
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}},
        images=[{"uri": image_uri(np.full((2, 2, 3), 99))}],
        textures=[{"source": 0}],
    )
    found = {name: add(tree, np.zeros((3, 2))) for name in coordinates}
    tree["meshes"][0]["primitives"][0]["attributes"] |= found
    sentence = "scene.gltf: a texture on a mesh without its texture coordinates shows one colour"
    assert load_gltf(write_gltf(tmp_path, tree)).warnings == (sentence,) * told


def test_colours_of_vertices_do_not_shine(tmp_path):
    tree = with_material({"extensions": {"KHR_materials_unlit": {}}})
    tree["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = add(tree, np.eye(3))
    assert load_gltf(write_gltf(tmp_path, tree)).warnings == (
        "scene.gltf: colours of vertices of unlit materials are left out",
    )


@pytest.mark.parametrize(("name", "width"), [("COLOR_0", 3), ("TEXCOORD_0", 2)])
def test_morph_targets_of_colours_are_told(tmp_path, name, width):
    tree = gltf()
    tree["meshes"][0]["primitives"][0]["targets"] = [{name: add(tree, np.ones((3, width)))}]
    assert load_gltf(write_gltf(tmp_path, tree)).warnings == (f"scene.gltf: {name} of morph targets is left out",)


def test_the_range_of_lamps_is_told(tmp_path):
    tree = gltf(extensions={"KHR_lights_punctual": {"lights": [{"type": "point", "range": 3}]}})
    tree["nodes"].append({"extensions": {"KHR_lights_punctual": {"light": 0}}})
    tree["scenes"][0]["nodes"].append(1)
    warnings = load_gltf(write_gltf(tmp_path, tree)).warnings
    assert warnings == ("scene.gltf: the range of lamps is left out: their light never ends",)


def test_extensions_that_are_not_known_are_told_once(tmp_path):
    harmless = ["KHR_materials_variants", "KHR_xmp_json_ld", "KHR_texture_basisu", "KHR_mesh_quantization"]
    tree = gltf(extensionsUsed=["MSFT_lod", "EXT_lights_image_based", *harmless])
    warnings = load_gltf(write_gltf(tmp_path, tree)).warnings
    assert warnings == ("scene.gltf: extensions are left out: EXT_lights_image_based, MSFT_lod",)


def test_visibility_that_an_animation_changes_is_told(tmp_path):
    tree = with_camera(animate(gltf(), (0, "translation", [0.0, 1.0], np.zeros((2, 3)), "STEP")))
    pointed = {"KHR_animation_pointer": {"pointer": "/nodes/0/extensions/KHR_node_visibility/visible"}}
    channel = {"sampler": 0, "target": {"path": "pointer", "extensions": pointed}}
    tree["animations"][0]["channels"].append(channel)
    (warning,) = load_gltf(write_gltf(tmp_path, tree)).warnings
    assert "animations of /nodes/0/extensions/KHR_node_visibility/visible are not played" in warning
