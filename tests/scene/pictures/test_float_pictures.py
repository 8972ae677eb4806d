"""Pictures of floating point as data, such as normal maps, and as light that is brighter than 1."""

import numpy as np
import OpenEXR
import PIL.Image
import pytest

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.pictures.images import PixelBudget, decode_srgb, encode_srgb8, read_linear, read_texture

VALUES = np.array([[(0.5, 0.25, 1.0), (0.1, 0.8, 0.6)]], np.float32)
CODES = np.round(VALUES * 255)


def write(path, values=VALUES):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": np.ascontiguousarray(values)}) as file:
        file.write(str(path))


def test_data_is_read_as_it_is_and_colours_get_a_curve(tmp_path):
    write(tmp_path / "a.exr")
    data, colours = (read_texture(tmp_path / "a.exr", PixelBudget(), srgb=srgb) for srgb in (False, True))
    np.testing.assert_allclose(data[..., :3], CODES, atol=1)
    np.testing.assert_array_equal(colours[..., :3], encode_srgb8(VALUES))


MITSUBA = """<scene version="3.0.0"><emitter type="constant"/><shape type="rectangle">{inside}</shape></scene>"""
BITMAP = '<texture type="bitmap" name="{name}"><string name="filename" value="a.exr"/>{more}</texture>'
RAW = '<boolean name="raw" value="true"/>'
PBRT = """WorldBegin LightSource "infinite"
{inside} Shape "trianglemesh" "point3 P" [0 0 0  1 0 0  0 1 0]"""
TOML = """[camera]
position = [0, 0, 3]
[materials.m]
{inside}
[[objects]]
shape = "quad"
material = "m"
"""


@pytest.mark.parametrize(
    ("ending", "text", "inside", "use"),
    [
        (
            "xml",
            MITSUBA,
            f'<bsdf type="normalmap">{BITMAP.format(name="normalmap", more=RAW)}<bsdf type="diffuse"/></bsdf>',
            "normal_texture",
        ),
        (
            "xml",
            MITSUBA,
            f'<bsdf type="diffuse">{BITMAP.format(name="reflectance", more=RAW)}</bsdf>',
            "texture",
        ),
        ("pbrt", PBRT, 'Material "diffuse" "string normalmap" "a.exr"', "normal_texture"),
        (
            "pbrt",
            PBRT,
            'Texture "t" "spectrum" "imagemap" "string filename" "a.exr" "string encoding" "linear"\n'
            'Material "diffuse" "texture reflectance" "t"',
            "texture",
        ),
        ("toml", TOML, 'normal_texture = { file = "a.exr" }', "normal_texture"),
    ],
)
def test_maps_of_data_are_not_encoded(tmp_path, ending, text, inside, use):
    write(tmp_path / "a.exr")
    path = tmp_path / f"scene.{ending}"
    path.write_text(text.format(inside=inside))
    world = load_world(path)
    material = world.materials[int(world.meshes[0].material_ids[0])]
    texture = world.textures[getattr(material, use)]
    assert not texture.srgb
    np.testing.assert_allclose(texture.pixels[..., :3], CODES, atol=1)


USD = """#usda 1.0
def Mesh "m" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (0, 1)] (interpolation = "vertex")
    rel material:binding = </look>
}
def Material "look" {
    token outputs:surface.connect = </look/surface.outputs:surface>
    def Shader "surface" {
        uniform token info:id = "UsdPreviewSurface"
        @inside@.connect = </look/picture.outputs:rgb>
        token outputs:surface
    }
    def Shader "picture" {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @a.exr@
        float4 inputs:scale = (0.5, 1, 1, 1)
        token inputs:sourceColorSpace = "raw"
        float3 outputs:rgb
    }
}
"""


def material_of(path, text):
    """Write a scene of one mesh; return its world and its material."""
    path.write_text(text)
    world = load_world(path)
    return world, world.materials[int(world.meshes[0].material_ids[0])]


def test_normals_of_usd_are_not_encoded(tmp_path):
    pytest.importorskip("pxr", reason="usd-core is not installed")
    write(tmp_path / "a.exr")
    world, material = material_of(tmp_path / "scene.usda", USD.replace("@inside@", "normal3f inputs:normal"))
    np.testing.assert_array_equal(world.textures[material.normal_texture].pixels[..., :3], (VALUES * 255 + 0.5) // 1)


AREA = '<emitter type="area">{texture}</emitter>'
SQUARES = """<texture type="checkerboard" name="radiance"><rgb name="color0" value="3 30 0"/>
  <rgb name="color1" value="0.5"/></texture>"""


def glow(path, text):
    """Return the light of a mesh's picture."""
    world, material = material_of(path, text)
    texture = world.textures[material.emission_texture]
    assert texture.srgb
    return decode_srgb(texture.pixels[..., :3] / 255) * material.emission


def mitsuba(tmp_path, texture):
    return glow(tmp_path / "scene.xml", MITSUBA.format(inside=AREA.format(texture=texture)))


def test_textures_of_light_may_be_brighter_than_1(tmp_path):
    write(tmp_path / "a.exr", VALUES * 40)
    found = mitsuba(tmp_path, BITMAP.format(name="radiance", more=""))
    np.testing.assert_allclose(found, VALUES * 40, atol=0.3)
    np.testing.assert_allclose(mitsuba(tmp_path, SQUARES)[0], [(3, 30, 0), (0.5, 0.5, 0.5)], atol=0.25)
    told = 'emission = [2.0, 1.0, 1.0]\nemission_texture = { file = "a.exr" }'
    found = glow(tmp_path / "scene.toml", TOML.format(inside=told))
    np.testing.assert_allclose(found, VALUES * 40 * (2, 1, 1), atol=0.6)


def test_textures_of_light_in_usd_may_be_brighter_than_1(tmp_path):
    pytest.importorskip("pxr", reason="usd-core is not installed")
    write(tmp_path / "a.exr", VALUES * 40)
    found = glow(tmp_path / "scene.usda", USD.replace("@inside@", "color3f inputs:emissiveColor"))
    np.testing.assert_allclose(found, VALUES * 40 * (0.5, 1, 1), atol=0.3)


def test_a_projected_picture_may_be_brighter_than_1(tmp_path):
    write(tmp_path / "a.exr", VALUES * 40)
    spot = '[[lights]]\nkind = "spot"\nintensity = [2.0, 1.0, 1.0]\npicture = { file = "a.exr" }\n'
    (tmp_path / "scene.toml").write_text(TOML.format(inside="") + spot)
    world = load_world(tmp_path / "scene.toml")
    light = world.punctual_lights[0]
    pixels = world.textures[light.picture].pixels[..., :3]
    np.testing.assert_allclose(decode_srgb(pixels / 255) * light.intensity, VALUES * 40 * (2, 1, 1), atol=0.6)


def test_textures_of_dim_light_are_as_they_were(tmp_path):
    PIL.Image.fromarray(np.full((2, 2, 3), 188, np.uint8)).save(tmp_path / "a.png")
    found = mitsuba(tmp_path, BITMAP.format(name="radiance", more="").replace("exr", "png"))
    np.testing.assert_allclose(found, decode_srgb(188 / 255), atol=1e-6)
    found = glow(
        tmp_path / "scene.toml", TOML.format(inside='emission = [3, 3, 3]\nemission_texture = { file = "a.png" }')
    )
    np.testing.assert_allclose(found, 3 * decode_srgb(188 / 255), atol=1e-6)


@pytest.mark.parametrize(
    ("held", "shown", "expected"),
    [
        (((2, 1), (3, 2)), ((0, 0), (4, 3)), [(1, 2, 1.0), (1, 3, 2.0), (2, 2, 3.0), (2, 3, 4.0)]),
        (((-1, -1), (0, 0)), ((0, 0), (2, 1)), [(0, 0, 4.0)]),
        (((7, 7), (8, 8)), ((0, 0), (1, 1)), []),
        (((7, 7), (8, 8)), ((7, 7), (8, 8)), [(0, 0, 1.0), (0, 1, 2.0), (1, 0, 3.0), (1, 1, 4.0)]),
    ],
)
def test_a_picture_is_what_its_display_window_shows(tmp_path, held, shown, expected):
    plane = np.array([[1, 2], [3, 4]], np.float32)
    windows = {"dataWindow": held, "displayWindow": shown}
    header = {name: tuple(np.array(corner, np.int32) for corner in window) for name, window in windows.items()}
    OpenEXR.File(header, dict.fromkeys("RGB", plane)).write(str(tmp_path / "a.exr"))
    found = read_linear(tmp_path / "a.exr", PixelBudget())
    width, height = np.subtract(shown[1], shown[0]) + 1
    assert found.shape == (height, width, 3)
    assert [(y, x, found[y, x, 1]) for y, x in zip(*np.nonzero(found[..., 1]), strict=True)] == expected


def test_luminance_with_chroma_has_colours(tmp_path):
    plane = np.ones((2, 2), np.float32)
    OpenEXR.File({}, {"Y": plane, "RY": plane / 2, "BY": -plane / 2}).write(str(tmp_path / "a.exr"))
    # Y = .2126 R + .7152 G + .0722 B (BT.709) is 1, R is 1.5 and B .5.
    expected = (1.5, (1 - 0.2126 * 1.5 - 0.0722 * 0.5) / 0.7152, 0.5)
    np.testing.assert_allclose(read_linear(tmp_path / "a.exr", PixelBudget())[1, 1], expected, atol=1e-6)


ACES = {"chromaticities": (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)}
"""SMPTE ST 2065-1."""


def test_a_sky_of_other_primaries_has_the_colours_of_rec_709(tmp_path):
    # Of ACES' white, and of Rec. 709's red as the colour sciences of others give it in ACES (adapted by Bradford).
    values = np.array([[(1, 1, 1), (0.4395856, 0.0895395, 0.0173872)]], np.float32)
    OpenEXR.File(dict(ACES), {"RGB": values}).write(str(tmp_path / "a.exr"))
    np.testing.assert_allclose(read_linear(tmp_path / "a.exr", PixelBudget())[0], [(1, 1, 1), (1, 0, 0)], atol=2e-3)
    data = read_texture(tmp_path / "a.exr", PixelBudget(), srgb=False)
    np.testing.assert_allclose(data[0, 1, :3], values[0, 1] * 255, atol=0.51)  # a normal map has no colours


def test_a_multilayer_file_shows_its_picture(tmp_path):
    plane = np.ones((2, 2), np.float32)
    passes = {f"View.Combined.{letter}": plane * level for letter, level in zip("RGB", (3, 2, 1), strict=True)}
    OpenEXR.File({}, passes | {f"View.AO.{letter}": plane for letter in "RGB"}).write(str(tmp_path / "a.exr"))
    np.testing.assert_array_equal(read_linear(tmp_path / "a.exr", PixelBudget())[0, 0], (3, 2, 1))


def test_a_file_that_is_too_large_is_not_unpacked(tmp_path):
    write(tmp_path / "a.exr", np.zeros((40, 30, 3), np.float32))
    whole = (tmp_path / "a.exr").read_bytes()
    (tmp_path / "a.exr").write_bytes(whole[:-40])  # its pixels could not be read
    with pytest.raises(InputError, match="all images together have more than"):
        read_linear(tmp_path / "a.exr", PixelBudget(40 * 30 - 1))
    with pytest.raises(InputError, match=r"a\.exr"):
        read_linear(tmp_path / "a.exr", PixelBudget())


def test_positions_are_not_taken_for_a_picture(tmp_path):
    OpenEXR.File({}, dict.fromkeys("XYZ", np.ones((2, 2), np.float32))).write(str(tmp_path / "a.exr"))
    with pytest.raises(InputError, match=r"has no radiance that a known layout names .*: channels X, Y, Z"):
        read_linear(tmp_path / "a.exr", PixelBudget())
