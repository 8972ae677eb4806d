"""glTF materials and textures."""

import math

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.gltf.scene import load_gltf
from tests.scene.gltf.gltf_files import ASSETS, add, gltf, image_uri, needs_assets, write_gltf


def test_materials_keep_their_factors_textures_and_extensions(tmp_path):
    pixels = np.arange(4 * 4 * 4).reshape(4, 4, 4)
    transform = {"offset": [0, 1], "rotation": math.pi / 2, "scale": [0.5, 0.5]}
    tree = gltf(
        images=[{"uri": image_uri(pixels)}],
        samplers=[{"wrapS": 33071, "wrapT": 33648, "magFilter": 9728}],
        textures=[{"source": 0, "sampler": 0}, {"source": 0}],
        materials=[
            {
                "pbrMetallicRoughness": {
                    "baseColorFactor": [0.1, 0.2, 0.3, 0.4],
                    "baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": transform}},
                    "metallicFactor": 0.6,
                    "roughnessFactor": 0.5,
                    "metallicRoughnessTexture": {"index": 1},
                },
                "normalTexture": {"index": 1, "scale": 0.7},
                "emissiveFactor": [0.5, 0, 1],
                "alphaMode": "MASK",
                "alphaCutoff": 0.25,
                "doubleSided": True,
                "extensions": {
                    "KHR_materials_emissive_strength": {"emissiveStrength": 8},
                    "KHR_materials_clearcoat": {"clearcoatFactor": 0.9, "clearcoatRoughnessFactor": 0.3},
                    "KHR_materials_transmission": {"transmissionFactor": 0.2},
                    "KHR_materials_ior": {"ior": 1.33},
                    "KHR_materials_sheen": {},
                },
            }
        ],
    )
    tree["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = add(tree, np.zeros((3, 2)))
    tree["meshes"][0]["primitives"][0]["material"] = 0
    path = write_gltf(tmp_path, tree)
    world = load_gltf(path)
    m = world.materials[0]
    assert (m.color, m.opacity, m.metallic, m.alpha) == ((0.1, 0.2, 0.3), 0.4, 0.6, 0.25)
    assert (m.alpha_mode, m.alpha_cutoff, m.opacity_texture) == ("mask", 0.25, m.texture)
    assert (m.emits_behind, m.back) == (True, "same")
    assert (m.emission, m.ior, m.transmission, m.normal_scale) == ((4, 0, 8), 1.33, 0.2, 0.7)
    assert (m.clearcoat, m.clearcoat_alpha) == (0.9, pytest.approx(0.09))
    color, normal = world.textures[m.texture], world.textures[m.normal_texture]
    assert (color.srgb, color.wrap_u, color.wrap_v, color.nearest) == (True, "clamp", "mirror", True)
    assert (normal.srgb, normal.wrap_u, normal.nearest) == (False, "repeat", False)
    assert m.roughness_texture == m.normal_texture  # the same image, read the same way
    assert color.pixels is normal.pixels
    # The extension's own example: the lower left quadrant, that is u and v below one half with v up.
    corners = np.array([(0, 0, 1), (1, 0, 1), (0, 1, 1), (1, 1, 1)]) @ np.array(color.uv_matrix).T
    assert corners.min() == pytest.approx(0) and corners.max() == pytest.approx(0.5)
    (warning,) = world.warnings
    assert "KHR_materials_sheen" in warning
    with pytest.raises(InputError, match="KHR_materials_sheen"):
        load_world(path, strict=True)


@pytest.mark.parametrize(
    ("name", "feature"),
    [
        ("clearcoatNormalTexture", "clearcoat normal textures"),
    ],
)
def test_textures_of_coats_are_left_out_with_a_word(tmp_path, name, feature):
    coat = {"clearcoatFactor": 0.5, name: {"index": 0}}
    tree = gltf(materials=[{"name": "paint", "extensions": {"KHR_materials_clearcoat": coat}}])
    tree["meshes"][0]["primitives"][0]["material"] = 0
    world = load_gltf(write_gltf(tmp_path, tree))
    assert world.materials[0].clearcoat == 0.5
    assert world.warnings == (f"scene.gltf: {feature} are left out (the first is that of paint)",)


def test_unlit_surfaces_show_their_color_whatever_the_light(tmp_path):
    tree = gltf(
        materials=[
            {"pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 0, 1]}, "extensions": {"KHR_materials_unlit": {}}}
        ]
    )
    tree["meshes"][0]["primitives"][0]["material"] = 0
    material = load_gltf(write_gltf(tmp_path, tree)).materials[0]
    assert (material.emission, material.color, material.specular_color) == ((1, 0.5, 0), (0, 0, 0), (0, 0, 0))
    tree |= {"textures": [{"source": 0}], "images": [{"uri": image_uri(np.full((1, 1, 4), 9))}]}
    tree["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    world = load_gltf(write_gltf(tmp_path, tree))
    shown = world.textures[world.materials[0].emission_texture]
    assert (world.materials[0].emission_texture, shown.pixels[0, 0, 0], shown.srgb) == (0, 9, True)


@pytest.mark.parametrize(("metallic", "kind"), [(0.0, "dielectric"), (0.25, "disney")])
def test_solid_glass_has_the_colour_of_the_volume_after_its_distance(tmp_path, metallic, kind):
    """Beer's law: after 0.5 m light has `attenuationColor`; what has no thickness is a pane and dims nothing."""
    tint, through = (0.2, 0.5, 1.0), (0.25, 1.0, 0.64)
    volume = {"thicknessFactor": 0.1, "attenuationDistance": 0.5, "attenuationColor": tint}
    extensions = {"KHR_materials_transmission": {"transmissionFactor": 1.0}, "KHR_materials_volume": volume}
    core = {"baseColorFactor": [*through, 1], "metallicFactor": metallic, "roughnessFactor": 0}
    tree = gltf(materials=[{"pbrMetallicRoughness": core, "extensions": extensions}])
    tree["meshes"][0]["primitives"][0]["material"] = 0
    world = load_gltf(write_gltf(tmp_path, tree))
    glass = world.materials[0]
    assert glass.kind == kind and not world.warnings
    np.testing.assert_allclose(np.exp(-0.5 * np.array(glass.absorption)), tint)
    # Light crosses the surface twice.
    color = np.square(glass.color) if kind == "dielectric" else glass.color
    np.testing.assert_allclose(color, through)
    for changed in ({"thicknessFactor": 0}, {"attenuationDistance": None}):
        extensions["KHR_materials_volume"] = {k: v for k, v in (volume | changed).items() if v is not None}
        clear = load_gltf(write_gltf(tmp_path, tree)).materials[0]
        assert clear.absorption == (0, 0, 0)
        assert (clear.kind == "principled") == ("thicknessFactor" in changed)
    core["baseColorTexture"] = {"index": 0}
    tree |= {"images": [{"uri": image_uri(np.full((1, 1, 4), 128))}], "textures": [{"source": 0}]}
    assert load_gltf(write_gltf(tmp_path, tree)).materials[0].kind == "disney"


def test_each_texture_shows_its_own_image(tmp_path):
    tree = gltf(
        images=[{"uri": image_uri(first + np.arange(16).reshape(2, 2, 4))} for first in (60, 200)],
        textures=[{"source": 1}, {"source": 0}],
        materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "normalTexture": {"index": 1}}],
    )
    tree["meshes"][0]["primitives"][0]["material"] = 0
    world = load_gltf(write_gltf(tmp_path, tree))
    of = world.materials[0]
    assert [world.textures[k].pixels[0, 0, 0] for k in (of.texture, of.normal_texture)] == [200, 60]


@pytest.mark.parametrize("by_transform", [False, True])
def test_a_material_uses_the_set_of_coordinates_of_its_first_texture(tmp_path, by_transform):
    """And tells so where another of its textures wants another set."""
    second = {"index": 0, "texCoord": 1}
    if by_transform:
        second = {"index": 0, "extensions": {"KHR_texture_transform": {"texCoord": 1}}}
    tree = gltf(
        images=[{"uri": image_uri(np.zeros((2, 2, 4)))}],
        textures=[{"source": 0}],
        materials=[
            {"pbrMetallicRoughness": {"baseColorTexture": second}, "emissiveTexture": second},
            {"pbrMetallicRoughness": {"baseColorTexture": second}, "emissiveTexture": {"index": 0}, "name": "mixed"},
        ],
    )
    primitive = tree["meshes"][0]["primitives"][0]
    sets = [np.array([(0.0, 0.25), (0.5, 0.75), (1.0, 0.5)]) * scale for scale in (1, 0.5)]
    for k, coordinates in enumerate(sets):
        primitive["attributes"][f"TEXCOORD_{k}"] = add(tree, coordinates)
    for material in (0, 1):
        primitive["material"] = material
        world = load_gltf(write_gltf(tmp_path, tree))
        np.testing.assert_array_equal(world.meshes[0].uvs, (0, 1) + sets[1] * (1, -1))
        assert [text for text in world.warnings if "mixed" in text] == list(world.warnings)
        assert len(world.warnings) == material


@pytest.mark.slow
@needs_assets
def test_flight_helmet_has_its_textures_once_each():
    world = load_world(ASSETS / "FlightHelmet" / "FlightHelmet.gltf")
    assert sum(len(mesh.triangles) for mesh in world.meshes) == 94_722
    assert all(mesh.normals is not None for mesh in world.meshes)
    assert len(world.textures) == 15
    kinds = {m.texture: True for m in world.materials} | {m.normal_texture: False for m in world.materials}
    assert all(world.textures[index].srgb == srgb for index, srgb in kinds.items())
    assert not world.warnings


def test_one_image_as_colour_and_as_data_is_two_textures(tmp_path):
    """Light is decoded from sRGB, roughness and normals are plain numbers, though all name the same texture."""
    info = {"index": 0}
    tree = gltf(
        images=[{"uri": image_uri(np.full((2, 2, 4), 128))}],
        textures=[{"source": 0}],
        materials=[
            {
                "pbrMetallicRoughness": {"baseColorTexture": info, "metallicRoughnessTexture": info},
                "normalTexture": info,
                "emissiveTexture": info,
                "emissiveFactor": [1, 1, 1],
            }
        ],
    )
    tree["meshes"][0]["primitives"][0]["material"] = 0
    world = load_gltf(write_gltf(tmp_path, tree))
    m = world.materials[0]
    assert m.texture == m.emission_texture != m.roughness_texture == m.normal_texture
    assert [world.textures[k].srgb for k in (m.texture, m.roughness_texture)] == [True, False]


def test_uneven_texture_transforms_scale_then_turn_then_shift(tmp_path):
    """KHR_texture_transform, step by step, on coordinates whose v points down as in the file."""
    angle, scale, offset = 0.7, (2.0, 0.5), (0.1, -0.3)
    info = {
        "index": 0,
        "extensions": {"KHR_texture_transform": {"offset": offset, "rotation": angle, "scale": scale}},
    }
    tree = gltf(
        images=[{"uri": image_uri(np.zeros((2, 2, 4)))}],
        textures=[{"source": 0}],
        materials=[{"pbrMetallicRoughness": {"baseColorTexture": info}}],
    )
    tree["meshes"][0]["primitives"][0]["material"] = 0
    texture = load_gltf(write_gltf(tmp_path, tree)).textures[0]
    for u, v in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.3, 0.8)):
        x, y = u * scale[0], v * scale[1]
        # A counter-clockwise turn as seen on the image, whose v points down.
        x, y = x * math.cos(angle) + y * math.sin(angle), y * math.cos(angle) - x * math.sin(angle)
        expected = x + offset[0], 1 - (y + offset[1])
        np.testing.assert_allclose(np.array(texture.uv_matrix) @ (u, 1 - v, 1), expected, atol=1e-12)


@pytest.mark.parametrize("dtype", ["<f4", "u1"])
def test_vertex_colours_go_with_the_mesh(tmp_path, dtype):
    tree = gltf(materials=[{"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 1, 1]}}])
    primitive = tree["meshes"][0]["primitives"][0]
    primitive["material"] = 0
    one = 255 if dtype == "u1" else 1.0
    mixed = [(one, 0, one, one), (0, 0, one, one), (0, one, one, one)]
    clear = [(one, 0, one, one), (0, 0, one, 0), (0, one, one, one)]
    for colors, warned in ((mixed, False), (clear, True)):
        primitive["attributes"]["COLOR_0"] = add(tree, colors, dtype, normalized=dtype == "u1")
        world = load_gltf(write_gltf(tmp_path, tree))
        assert world.materials[0].color == (0.5, 0.5, 1.0)
        np.testing.assert_allclose(world.meshes[0].colors, [(1, 0, 1), (0, 0, 1), (0, 1, 1)])
        assert ["the opacity of vertex colours" in warning for warning in world.warnings] == [True] * warned
    primitive["attributes"]["COLOR_0"] = add(tree, [(one, one, one, one)] * 3, dtype, normalized=dtype == "u1")
    assert load_gltf(write_gltf(tmp_path, tree)).meshes[0].colors is None, "white changes nothing"


def test_parts_with_and_without_colours_are_joined(tmp_path):
    """A flat part beside a smooth one gets vertices of its own, and its colours go with them."""
    tree = gltf()
    plain, flat = tree["meshes"][0]["primitives"][0], {"attributes": {"POSITION": 0}}
    plain["attributes"] = {"POSITION": 0, "NORMAL": add(tree, [(0, 0, 1)] * 3)}
    flat["attributes"]["COLOR_0"] = add(tree, [(1, 0, 0), (0, 1, 0), (0, 0, 1)])
    flat["indices"] = add(tree, [2, 0, 1], "<u2")
    tree["meshes"][0]["primitives"].append(flat)
    (mesh,) = load_gltf(write_gltf(tmp_path, tree)).meshes
    np.testing.assert_allclose(mesh.colors, [(1, 1, 1)] * 3 + [(0, 0, 1), (1, 0, 0), (0, 1, 0)])


def test_weak_glow_leaves_the_default_light_and_a_lamp_replaces_it(tmp_path):
    """The triangle spans 2 × 1: its box has a surface of 4, and the default sky sends 0.5 into each part of it."""
    for emission, lit in ((0.01, False), (0.03, True), (1.0, True)):
        tree = gltf(materials=[{"emissiveFactor": [emission] * 3}])
        tree["meshes"][0]["primitives"][0]["material"] = 0
        world = load_gltf(write_gltf(tmp_path, tree))
        assert bool(world.sphere_lights) == (max(world.environment) > 0) == (not lit)
        assert ["what glows is weak" in note for note in world.notes] == [True] * (not lit)


def test_glow_that_a_picture_shapes_leaves_the_lamp(tmp_path):
    """A picture of what glows, such as lit windows or a display, is mostly black: it may light nothing."""
    glow = {"emissiveFactor": [1.0] * 3, "emissiveTexture": {"index": 0}}
    tree = gltf(materials=[glow], images=[{"uri": image_uri(np.zeros((2, 2, 3)))}], textures=[{"source": 0}])
    tree["meshes"][0]["primitives"][0]["material"] = 0
    world = load_gltf(write_gltf(tmp_path, tree))
    assert world.sphere_lights and max(world.environment) > 0


def test_single_sided_faces_are_culled(tmp_path):
    tree = gltf(materials=[{"emissiveFactor": [1, 1, 1]}])
    tree["meshes"][0]["primitives"][0]["material"] = 0
    (m,) = load_gltf(write_gltf(tmp_path, tree)).materials
    assert (m.emits_behind, m.back) == (False, "culled")


def test_opaque_materials_ignore_their_alpha(tmp_path):
    tree = gltf(
        images=[{"uri": image_uri(np.zeros((2, 2, 4)))}],
        textures=[{"source": 0}],
        materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 1, 1, 0.3]}}],
    )
    tree["meshes"][0]["primitives"][0]["material"] = 0
    (m,) = load_gltf(write_gltf(tmp_path, tree)).materials
    assert (m.alpha_mode, m.opacity, m.opacity_texture) == ("opaque", 1.0, -1)


def test_a_factor_rounded_up_is_1(tmp_path):
    tree = gltf(materials=[{"pbrMetallicRoughness": {"baseColorFactor": [1.00000012, 0.5, 0, 1]}}])
    tree["meshes"][0]["primitives"][0]["material"] = 0
    assert load_world(write_gltf(tmp_path, tree)).materials[0].color == (1.0, 0.5, 0.0)


def test_images_of_unknown_formats_are_told_in_plain_words(tmp_path):
    for data, part in (
        (b"\xabKTX 20\xbb\r\n\x1a\n", "it is KTX2, expected PNG"),
        (b"what", "it is of no known format"),
    ):
        (tmp_path / "a.bin").write_bytes(data)
        tree = gltf(
            images=[{"uri": "a.bin"}],
            textures=[{"source": 0}],
            materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        )
        tree["meshes"][0]["primitives"][0]["material"] = 0
        with pytest.raises(InputError, match=part):
            load_gltf(write_gltf(tmp_path, tree))


def test_normals_that_are_not_finite_are_left_out_with_a_word(tmp_path):
    tree = gltf()
    normals = np.array([(0, 0, 1), (0, np.nan, 1), (0, 0, 1)])
    tree["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = add(tree, normals)
    world = load_world(write_gltf(tmp_path, tree))
    assert world.meshes[0].normals is None
    assert any("normals that are not finite" in warning for warning in world.warnings)


def test_cones_of_spots(tmp_path):
    for inner, outer, expected in ((0.2, 0.5, (0.2, 0.5)), (0.7, 0.5, (0.5, 0.5))):
        spot = {"type": "spot", "intensity": 683, "spot": {"innerConeAngle": inner, "outerConeAngle": outer}}
        tree = gltf(extensions={"KHR_lights_punctual": {"lights": [spot]}})
        tree["nodes"][0]["extensions"] = {"KHR_lights_punctual": {"light": 0}}
        (light,) = load_gltf(write_gltf(tmp_path, tree)).punctual_lights
        assert (light.inner_deg, light.outer_deg) == pytest.approx(tuple(map(math.degrees, expected)))
        assert light.intensity == (1, 1, 1)


def test_means_of_textures_stand_in_for_those_of_coats_lobes_and_glass(tmp_path):
    """Half of each picture is 0 and half is full: a half, of the channel that the extension names."""
    pixels = np.zeros((2, 4, 4), np.uint8)
    pixels[:, 2:], pixels[..., 2] = 255, 255
    info = {"index": 0}
    extensions = {
        "KHR_materials_clearcoat": {
            "clearcoatFactor": 0.8,
            "clearcoatTexture": info,
            "clearcoatRoughnessFactor": 0.6,
            "clearcoatRoughnessTexture": info,
        },
        "KHR_materials_transmission": {"transmissionFactor": 0.9, "transmissionTexture": info},
        "KHR_materials_specular": {"specularFactor": 0.5, "specularTexture": info, "specularColorTexture": info},
    }
    tree = gltf(materials=[{"extensions": extensions}], images=[{"uri": image_uri(pixels)}], textures=[{"source": 0}])
    tree["meshes"][0]["primitives"][0]["material"] = 0
    world = load_world(write_gltf(tmp_path, tree))
    found = world.materials[0]
    assert (found.clearcoat, found.transmission) == pytest.approx((0.4, 0.45))
    assert found.clearcoat_alpha == pytest.approx(0.3**2)
    assert found.specular_color == pytest.approx((0.125, 0.125, 0.25))
    assert sum("stands in for them" in warning for warning in world.warnings) == 5
    assert not world.textures


def test_layers_textures_count_by_the_mean_of_their_own_channels(tmp_path):
    """Specular in alpha, a coat's share in red, its roughness in green (the extensions of Khronos)."""
    red, green, alpha = 50 / 255, 150 / 255, 100 / 255
    coat = {"clearcoatFactor": 0.5, "clearcoatTexture": {"index": 0}}
    coat |= {"clearcoatRoughnessFactor": 0.8, "clearcoatRoughnessTexture": {"index": 0}}
    specular = {"specularFactor": 0.9, "specularTexture": {"index": 0}}
    tree = gltf(
        materials=[{"extensions": {"KHR_materials_clearcoat": coat, "KHR_materials_specular": specular}}],
        images=[{"uri": image_uri(np.full((2, 2, 4), (50, 150, 200, 100)))}],
        textures=[{"source": 0}],
    )
    tree["meshes"][0]["primitives"][0]["material"] = 0
    (found,) = load_gltf(write_gltf(tmp_path, tree)).materials
    assert (found.clearcoat, found.clearcoat_alpha) == pytest.approx((0.5 * red, (0.8 * green) ** 2))
    assert found.specular_color == pytest.approx((0.9 * alpha,) * 3)


@pytest.mark.parametrize(("told", "ior"), [(0.9, 1.5), (1.0, 1.0), (2.4, 2.4)])
def test_no_index_is_below_that_of_air(tmp_path, told, ior):
    tree = gltf(materials=[{"extensions": {"KHR_materials_ior": {"ior": told}}}])
    tree["meshes"][0]["primitives"][0]["material"] = 0
    assert load_gltf(write_gltf(tmp_path, tree)).materials[0].ior == ior


def test_a_picture_in_webp_goes_before_what_stands_in_for_it(tmp_path):
    tree = gltf(
        materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        images=[{"uri": image_uri(np.full((1, 1, 3), value))} for value in (10, 200)],
        textures=[{"source": 0, "extensions": {"EXT_texture_webp": {"source": 1}}}],
    )
    tree["meshes"][0]["primitives"][0]["material"] = 0
    (texture,) = load_gltf(write_gltf(tmp_path, tree)).textures
    assert texture.pixels[0, 0, 0] == 200
