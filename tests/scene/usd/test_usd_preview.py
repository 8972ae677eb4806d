"""Preview surfaces of USD files and their pictures: what they are in clsim."""

import zipfile

import numpy as np
import PIL.Image
import pytest

from clsim.scene import load_world
from clsim.scene.pictures.images import decode_srgb
from tests.scene.usd.usd_files import METRES, mesh, usda

GRAPH = """
def Material "paint" { token outputs:surface.connect = </paint/surface.outputs:surface>
    def Shader "surface" { uniform token info:id = "UsdPreviewSurface"
        %s
        token outputs:surface }
    def Shader "reader" { uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "map1"
        float2 outputs:result }
    def Shader "inner" { uniform token info:id = "UsdTransform2d"
        float2 inputs:in.connect = </paint/reader.outputs:result>
        float2 inputs:scale = (2, 5)
        float inputs:rotation = 90
        float2 outputs:result }
    def Shader "outer" { uniform token info:id = "UsdTransform2d"
        float2 inputs:in.connect = </paint/inner.outputs:result>
        float2 inputs:translation = (.25, .5)
        float2 inputs:scale = (3, 1)
        float2 outputs:result }
    def Shader "picture" { uniform token info:id = "UsdUVTexture"
        asset inputs:file = @%s@
        token inputs:wrapS = "mirror"
        token inputs:wrapT = "clamp"
        %s
        float2 inputs:st.connect = </paint/outer.outputs:result>
        float3 outputs:rgb
        float outputs:r
        float outputs:g
        float outputs:a } }
"""
RAW, ENCODED = (f'token inputs:sourceColorSpace = "{space}"\n' for space in ("raw", "sRGB"))
DOUBLED, TRIPLED = (f"float4 inputs:scale = ({k}, {k}, {k}, 1)\n" for k in (2, 3))
TURNED = "float4 inputs:scale = (2, -2, 2, 1)\nfloat4 inputs:bias = (-1, 1, -1, 0)\n"
UV = 'texCoord2f[] primvars:map1 = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")\n'
API = '(prepend apiSchemas = ["MaterialBindingAPI"])'
BOUND = "rel material:binding = </paint>\n"
SUBSET = (
    f'def GeomSubset "part" {API} {{ uniform token elementType = "face"\nuniform token familyName = "materialBind"\n'
)


def picture_to(*names):
    """Return the texts that connect inputs, each told as ``roughness r``, to the picture."""
    types = {"diffuseColor": "color3f", "emissiveColor": "color3f", "normal": "normal3f"}
    pairs = [each.split() for each in names]
    return [f"{types.get(a, 'float')} inputs:{a}.connect = </paint/picture.outputs:{b}>" for a, b in pairs]


def graph(inputs, told=RAW, file="picture.png"):
    return GRAPH % ("\n".join(inputs), file, told)


def painted(tmp_path, *inputs, told=RAW, file="picture.png", square=BOUND, more=""):
    """Return the world of a square that is bound to that material, and its first material."""
    pixels = np.array([[(0, 64, 128, 255), (255, 32, 16, 0)]], np.uint8)
    PIL.Image.fromarray(pixels).save(tmp_path / "picture.png")
    bound = mesh(UV + square).replace('"square"', f'"square" {API}')
    world = load_world(usda(tmp_path, graph(inputs, told, file) + bound + more))
    return world, world.materials[world.meshes[0].material_ids[0]]


def test_preview_surfaces_are_principled(tmp_path):
    inputs = """
    color3f inputs:diffuseColor = (.1, .2, .3)
    color3f inputs:emissiveColor = (0, 3, 0)
    float inputs:roughness = .4
    float inputs:metallic = .75
    float inputs:ior = 1.8
    float inputs:clearcoat = .5
    float inputs:clearcoatRoughness = .3
    float inputs:opacity = .6
    """
    _, found = painted(tmp_path, inputs)
    assert (found.kind, found.metallic, found.clearcoat, found.alpha_mode) == ("principled", 0.75, 0.5, "blend")
    assert found.color == pytest.approx((0.1, 0.2, 0.3))
    assert found.emission == (0, 3, 0)
    assert (found.alpha, found.clearcoat_alpha) == pytest.approx((0.16, 0.09))
    assert (found.ior, found.opacity) == pytest.approx((1.8, 0.6))


@pytest.mark.parametrize(
    ("told", "reflected"), [((0.16, 0.08, 0.04), (0.16, 0.08, 0.04)), ((1, 1, 0.45), (0.9, 0.9, 0.45))]
)
def test_specular_colours_are_reflected_at_right_angles(tmp_path, told, reflected):
    """Up to 0.9 of the light: no index reflects all."""
    color = f"color3f inputs:specularColor = {told}"
    _, found = painted(tmp_path, "float inputs:metallic = 1", "int inputs:useSpecularWorkflow = 1", color)
    least = ((found.ior - 1) / (found.ior + 1)) ** 2
    assert np.array(found.specular_color) * least == pytest.approx(reflected)
    assert found.metallic == 0


def test_pictures_keep_their_place_their_factor_and_their_curve(tmp_path):
    """UsdTransform2d: in · scale · turn + translation, the inner one first; each direction wraps by its own rule."""
    world, found = painted(tmp_path, *picture_to("emissiveColor rgb"), told=ENCODED + DOUBLED)
    texture = world.textures[found.emission_texture]
    assert texture.srgb and found.emission == (2, 2, 2)
    assert (texture.wrap_u, texture.wrap_v) == ("mirror", "clamp")
    for u, v in ((0.0, 0.0), (1.0, 0.0), (0.3, 0.8)):
        a, b = -5 * v, 2 * u  # scaled, then turned by 90 degrees counter-clockwise
        assert np.array(texture.uv_matrix) @ (u, v, 1) == pytest.approx((3 * a + 0.25, b + 0.5))
    assert world.meshes[0].uvs.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]


def test_roughness_metalness_and_opacity_take_their_channels(tmp_path):
    inputs = picture_to("roughness g", "metallic r", "opacity a")
    world, found = painted(tmp_path, *inputs, "float inputs:opacityThreshold = .5", told=RAW + DOUBLED)
    rough = world.textures[found.roughness_texture].pixels
    assert rough[0, :, 1].tolist() == [128, 64]  # times the scale of 2
    assert rough[0, :, 2].tolist() == [0, 255]
    assert (found.alpha, found.metallic, found.alpha_mode, found.alpha_cutoff) == (1, 1, "mask", 0.5)
    assert world.textures[found.opacity_texture].pixels[0, :, 3].tolist() == [255, 0]
    world, found = painted(tmp_path, *picture_to("roughness g"), told=ENCODED)
    rough = world.textures[found.roughness_texture]
    assert not rough.srgb and rough.pixels[0, :, 1] / 255 == pytest.approx(
        decode_srgb(np.array([64, 32]) / 255), abs=2e-3
    )


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (("roughness g", RAW, "mirror"), ("roughness a", RAW, "mirror")),
        (("opacity g", RAW, "mirror"), ("opacity r", RAW, "mirror")),
        (("diffuseColor rgb", RAW, "mirror"), ("diffuseColor rgb", ENCODED, "mirror")),
        (("diffuseColor rgb", RAW, "mirror"), ("diffuseColor rgb", RAW, "clamp")),
        (("diffuseColor rgb", DOUBLED, "mirror"), ("diffuseColor rgb", TRIPLED, "mirror")),
        (("normal rgb", RAW, "mirror"), ("normal rgb", RAW + TURNED, "mirror")),
    ],
)
def test_materials_share_a_picture_where_they_take_it_alike_and_only_there(tmp_path, one, other):
    def shown(second):
        text = graph(picture_to(second[0]), second[1]).replace('"mirror"', f'"{second[2]}"').replace("paint", "other")
        square = mesh(UV + BOUND, "second").replace('"second"', f'"second" {API}').replace("paint", "other")
        world, _ = painted(tmp_path, *picture_to(one[0]), told=one[1], more=text + square)
        names = ("texture", "roughness_texture", "opacity_texture", "normal_texture")
        return [
            world.textures[getattr(each, name)]
            for each in world.materials
            for name in names
            if getattr(each, name) >= 0
        ]

    first, second = shown(other)
    differ = first.srgb != second.srgb or first.wrap_u != second.wrap_u
    assert differ or not np.array_equal(first.pixels, second.pixels)
    assert [(each.wrap_u, each.wrap_v) for each in (first, second)] == [(one[2], "clamp"), (other[2], "clamp")]
    assert first.uv_matrix == second.uv_matrix != ((1, 0, 0), (0, 1, 0))
    first, second = shown(one)
    assert first is second


def test_a_picture_of_light_is_as_bright_as_it_tells(tmp_path):
    """Radiance's format: 128/256 · 2⁴ is 8."""
    (tmp_path / "light.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n" + b"\x80\x80\x80\x84" * 2)
    world, found = painted(tmp_path, *picture_to("emissiveColor rgb"), told=DOUBLED, file="light.hdr")
    assert found.emission == pytest.approx((16, 16, 16)) and found.emission_texture >= 0 and not world.warnings


def test_a_picture_of_metal_leaves_roughness_as_it_is_told(tmp_path):
    world, found = painted(tmp_path, *picture_to("metallic r"), "float inputs:roughness = .4")
    assert found.metallic == 1 and world.textures[found.roughness_texture].pixels[0, :, 1].tolist() == [255, 255]
    assert found.alpha == pytest.approx(0.16)


@pytest.mark.parametrize(("threshold", "mode"), [(0.0, "blend"), (0.3, "mask")])
def test_opacity_is_blended_unless_there_is_a_threshold(tmp_path, threshold, mode):
    """UsdPreviewSurface: above 0, opacityThreshold cuts; else opacity blends."""
    _, found = painted(tmp_path, *picture_to("opacity a"), f"float inputs:opacityThreshold = {threshold}")
    assert found.alpha_mode == mode and found.alpha_cutoff == pytest.approx(threshold)
    assert found.opacity_texture >= 0


def test_opacity_has_no_curve_and_is_scaled_before_it_is_shifted(tmp_path):
    told = ENCODED + "float4 inputs:scale = (1, 1, 1, 0.5)\nfloat4 inputs:bias = (0, 0, 0, 0.125)\n"
    world, found = painted(tmp_path, *picture_to("opacity a"), told=told)
    assert world.textures[found.opacity_texture].pixels[0, :, 3].tolist() == [round(0.625 * 255), round(0.125 * 255)]


@pytest.mark.parametrize(
    ("fallback", "opacity"), [("float4 {} = (.1, .2, .3, .4)", 0.4), ("float3 {} = (.1, .2, .3)", 1)]
)
def test_where_a_picture_is_missing_each_channel_is_that_of_the_fallback(tmp_path, fallback, opacity):
    inputs = picture_to("diffuseColor rgb", "opacity a")
    world, found = painted(tmp_path, *inputs, told=fallback.format("inputs:fallback"), file="nowhere.png")
    assert (*found.color, found.opacity) == pytest.approx((0.1, 0.2, 0.3, opacity))
    assert any("nowhere.png" in warning for warning in world.warnings)


@pytest.mark.parametrize("file", ["picture.png", "nowhere.png"])
def test_pictures_are_looked_for_beside_the_file_that_names_them(tmp_path, file):
    inner = tmp_path / "parts"
    inner.mkdir()
    painted(inner, *picture_to("diffuseColor rgb"), file=file)
    world = load_world(usda(tmp_path, "", METRES + "\n    subLayers = [@./parts/scene.usda@]"))
    if file == "picture.png":
        assert world.materials[0].texture >= 0 and not world.warnings
        with zipfile.ZipFile(tmp_path / "packed.usdz", "w") as package:
            for name in ("scene.usda", file):
                package.write(inner / name, name)
        packed = load_world(tmp_path / "packed.usdz")
        np.testing.assert_array_equal(packed.textures[0].pixels, world.textures[0].pixels)
    else:
        assert world.warnings == (f"scene.usda: a texture is left out: the file 'nowhere.png' is missing in {inner}",)


COLORS = 'color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)] (interpolation = "vertex")\n'
HALVES = "int[] faceVertexCounts = [3, 3]\nint[] faceVertexIndices = [0, 1, 2, 0, 2, 3]\n"


@pytest.mark.parametrize("colors", ["color3f[] primvars:displayColor = [(.1, .7, .2)]\n", COLORS])
def test_subsets_have_materials_of_their_own_and_others_their_colour(tmp_path, colors):
    """One for all: colours that differ from point to point would be those of the subset's faces too.

    A subset may name faces that there are not.
    """
    points = "point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]\n"
    text = mesh(f"{colors}{SUBSET}int[] indices = [1, -2, 9]\n{BOUND} }}\n", shape=HALVES + points)
    world = load_world(usda(tmp_path, graph(["float inputs:metallic = 1"]) + text))
    first, second = (world.materials[k] for k in world.meshes[0].material_ids)
    assert first.color == pytest.approx((0.5, 0.5, 0.5) if colors == COLORS else (0.1, 0.7, 0.2))
    assert (second.metallic, second.name) == (1, "paint") and world.meshes[0].colors is None


def test_a_mesh_has_the_coordinates_that_the_material_of_its_first_part_asks_for(tmp_path):
    """``map1``, which the picture's node names, though the mesh itself has no material."""
    square = f"{SUBSET}int[] indices = [0]\n{BOUND} }}"
    world, found = painted(tmp_path, *picture_to("diffuseColor rgb"), square=square)
    assert found.name == "paint" and found.texture >= 0
    assert world.meshes[0].uvs is not None and np.ptp(world.meshes[0].uvs, axis=0) == pytest.approx((1, 1))
