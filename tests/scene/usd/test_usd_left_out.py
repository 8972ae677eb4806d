"""What USD files ask for and clsim lacks is told, and what is written in rarer ways is read."""

import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from clsim.scene import load_world
from clsim.scene.pictures.images import decode_srgb
from tests.scene.usd.usd_files import CAMERA, METRES, SQUARE, TIMED, mesh, placed, points_at, usda

ST = 'texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (\ninterpolation = "vertex")'
BOUND = '(prepend apiSchemas = ["MaterialBindingAPI"])'
TEXTURE = """def Shader "%s" { uniform token info:id = "UsdUVTexture"
asset inputs:file = @t.png@
float2 inputs:st.connect = </M/%s.outputs:result>
%s
float3 outputs:rgb }
def Shader "%s" { uniform token info:id = "UsdPrimvarReader_float2"
string inputs:varname = "%s"
float2 outputs:result }"""
PLAIN = TEXTURE % ("T", "R", "", "R", "st")
PAINTED = "color3f inputs:diffuseColor.connect = </M/T.outputs:rgb>"
GIVEN = """def Shader "C" { uniform token info:id = "UsdPrimvarReader_float3"
string inputs:varname = "tint"
float3 outputs:result }"""


def surface(name, inputs, nodes=""):
    return f"""def Material "{name}" {{ token outputs:surface.connect = </{name}/S.outputs:surface>
def Shader "S" {{ uniform token info:id = "UsdPreviewSurface"
{inputs}
token outputs:surface }}
{nodes} }}
"""


def bound_world(tmp_path, inputs, nodes="", extra="", meta=METRES):
    """Return the world of a square that has a preview surface of those inputs."""
    Image.fromarray(np.full((4, 4, 3), 99, np.uint8)).save(tmp_path / "t.png")
    square = mesh(f"rel material:binding = </M>\n{extra}").replace('"square"', f'"square" {BOUND}')
    return load_world(usda(tmp_path, square + surface("M", inputs, nodes), meta))


@pytest.mark.parametrize(
    ("full", "preview", "expected"),
    [
        ("red", "green", (1, 0, 0)),
        ("", "green", (0, 1, 0)),
        ("other", "green", (0, 1, 0)),
        ("other", "", (0.5, 0.5, 0.5)),
    ],
)
def test_materials_bound_for_a_purpose_are_found(tmp_path, full, preview, expected):
    # Exporters bind one material for final pictures, which may be of another program's kind, and one for previews.
    bindings = [
        f"rel material:binding:{kind} = </{name}>" for kind, name in (("full", full), ("preview", preview)) if name
    ]
    square = mesh("\n".join(bindings)).replace('"square"', f'"square" {BOUND}')
    shaders = [
        surface(name, f"color3f inputs:diffuseColor = {color}")
        for name, color in (("red", (1, 0, 0)), ("green", (0, 1, 0)))
    ]
    other = surface("other", "").replace("UsdPreviewSurface", "PxrSurface")
    world = load_world(usda(tmp_path, square + "".join(shaders) + other))
    assert world.materials[world.meshes[0].material_ids[0]].color == expected
    assert world.warnings == () if preview or full == "red" else "are grey (first other)" in world.warnings[0]


@pytest.mark.parametrize("meta", ["", "\n    timeCodesPerSecond = 24"])
def test_motion_without_a_range_of_time_lasts_as_long_as_its_samples(tmp_path, meta):
    moving = placed("double3 xformOp:translate.timeSamples = { 24: (0, 0, 0), 72: (4, 0, 0) }")
    world = load_world(usda(tmp_path, f'def Xform "X" {{\n{moving}{mesh()}}}\n{CAMERA}', METRES + meta))
    assert world.duration_s == pytest.approx(2) and not world.warnings
    middle = points_at(world, world.instances[0], 1.0) - points_at(world, world.instances[0], 0.0)
    assert middle == pytest.approx(np.tile([2, 0, 0], (4, 1)), abs=1e-5)


def test_motion_within_instances_counts_for_the_range_of_time(tmp_path):
    moving = placed("double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 48: (4, 0, 0) }")
    shared = f'class "_shared" {{ def Xform "X" {{\n{moving}{mesh()}}}\n}}\n'
    one = 'def Xform "one" (instanceable = true\ninherits = </_shared>) { }\n'
    world = load_world(usda(tmp_path, shared + one + CAMERA, METRES + "\n    timeCodesPerSecond = 24"))
    assert world.duration_s == pytest.approx(2)


def test_opacity_of_a_mesh_without_a_material(tmp_path):
    one = "color3f[] primvars:displayColor = [(1, 0, 0)]\nfloat[] primvars:displayOpacity = [0.25]"
    several = 'float[] primvars:displayOpacity = [0, 1, 1, 1] (\ninterpolation = "vertex")'
    world = load_world(usda(tmp_path, mesh(one) + mesh(several, "faded") + mesh("", "plain")))
    found = [world.materials[each.material_ids[0]] for each in world.meshes]
    assert [(each.alpha_mode, each.opacity) for each in found] == [("blend", 0.25), ("blend", 0.75), ("opaque", 1.0)]
    assert world.warnings == ("scene.usda: opacity that differs over a mesh is its mean (first faded)",)


@pytest.mark.parametrize(
    ("scale", "bias", "seen"),
    [
        ((2, 2, 2), (-1, -1, -1), [99, 99, 99]),
        ((2, -2, 2), (-1, 1, -1), [99, 156, 99]),
        ((-2, -2, 2), (1, 1, -1), [156, 156, 99]),
        ((1, 1, 1), (0, 0, 0), [99, 99, 99]),
    ],
)
def test_normal_maps_whose_green_points_down_are_turned(tmp_path, scale, bias, seen):
    told = f"float4 inputs:scale = {(*scale, 1)}\nfloat4 inputs:bias = {(*bias, 0)}"
    texture = TEXTURE % ("T", "R", told, "R", "st")
    world = bound_world(tmp_path, "normal3f inputs:normal.connect = </M/T.outputs:rgb>", texture, ST)
    pixels = world.textures[world.materials[0].normal_texture].pixels
    assert pixels[0, 0, :3].tolist() == seen and not world.warnings


def test_a_picture_of_colours_may_be_multiplied_by_more_than_one(tmp_path):
    texture = TEXTURE % (
        "T",
        "R",
        'float4 inputs:scale = (2, 2, 2, 1)\ntoken inputs:sourceColorSpace = "raw"',
        "R",
        "st",
    )
    world = bound_world(tmp_path, PAINTED, texture, ST)
    (found,) = world.materials
    texel = world.textures[found.texture]
    assert found.color == (1, 1, 1) and texel.srgb
    assert decode_srgb(texel.pixels[0, 0, :3] / 255) == pytest.approx(2 * 99 / 255, abs=0.005)


@pytest.mark.parametrize(("space", "srgb"), [("auto", False), ("sRGB", True), ("raw", False)])
def test_pictures_of_16_bits_are_light_unless_the_file_says_otherwise(tmp_path, space, srgb):
    texture = TEXTURE % ("T", "R", f'token inputs:sourceColorSpace = "{space}"', "R", "st")
    texture = texture.replace("t.png", "deep.png")
    rows = b"".join(b"\0" + np.full((2, 3), 32768, ">u2").tobytes() for _ in range(2))
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", 2, 2, 16, 2, 0, 0, 0)), (b"IDAT", zlib.compress(rows)), (b"IEND", b"")]
    parts = [
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)) for kind, body in chunks
    ]
    (tmp_path / "deep.png").write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts))
    world = bound_world(tmp_path, PAINTED, texture, ST)
    assert world.textures[0].srgb == srgb and world.textures[0].pixels[0, 0, 0] == 128


def test_texture_coordinates_with_a_third_number(tmp_path):
    st = 'texCoord3f[] primvars:st = [(0, 0, 7), (1, 0, 7), (1, 1, 7), (0, 1, 7)] (\ninterpolation = "vertex")'
    texture = PLAIN
    world = bound_world(tmp_path, PAINTED, texture, st)
    assert world.meshes[0].uvs == pytest.approx(np.array([(0, 0), (1, 0), (1, 1), (0, 1)])) and not world.warnings


@pytest.mark.parametrize(
    ("inputs", "nodes", "extra", "told"),
    [
        (
            "int inputs:useSpecularWorkflow = 1\ncolor3f inputs:specularColor.connect = </M/T.outputs:rgb>",
            PLAIN,
            ST,
            "textures of specularColor are left out (first that of M)",
        ),
        (
            "color3f inputs:diffuseColor.connect = </M/C.outputs:result>",
            GIVEN.replace("UsdPrimvarReader_float3", "ND_noise3d_color3"),
            "",
            "what ND_noise3d_color3 gives to materials is left out (first diffuseColor of /M/S)",
        ),
        ("float inputs:displacement = 0.3", "", "", "displacement of materials is left out"),
        (
            "color3f inputs:diffuseColor.timeSamples = { 10: (1, 0, 0), 34: (0, 1, 0) }",
            "",
            "",
            "diffuseColor that changes",
        ),
        ("float inputs:opacity.timeSamples = { 10: 1, 34: 0 }", "", "", "opacity that changes with time is as at"),
        (
            "color3f inputs:emissiveColor.connect = </M/C.outputs:result>",
            GIVEN,
            "color3f[] primvars:tint = [(1, 1, 1)]",
            "what a mesh gives to emissiveColor of materials is left out",
        ),
        (
            "color3f inputs:diffuseColor.connect = </M/C.outputs:result>",
            GIVEN,
            "",
            "tint that a material asks for is missing: white stands for it (first square)",
        ),
        (
            PAINTED,
            TEXTURE % ("T", "R", 'token inputs:wrapS = "black"', "R", "st"),
            ST,
            "pictures that are black outside are as at their edge there",
        ),
        (
            f"{PAINTED}\ncolor3f inputs:emissiveColor.connect = </M/T2.outputs:rgb>",
            PLAIN + "\n" + TEXTURE % ("T2", "R2", "", "R2", "other"),
            ST,
            "all textures of a mesh use the first of its texture coordinates",
        ),
        (
            PAINTED,
            PLAIN.replace("t.png", "t.<UDIM>.png"),
            ST,
            "t.<UDIM>.png is a picture in tiles (UDIM), expected a single one",
        ),
        (
            PAINTED,
            PLAIN,
            "",
            "st that a texture asks for is missing: it shows one colour (first square)",
        ),
        (
            PAINTED,
            PLAIN,
            'texCoord2f[] primvars:st = [(0, 0), (1, 0)] (\ninterpolation = "vertex")',
            "st does not fit its mesh and is left out (first square)",
        ),
        (
            PAINTED,
            PLAIN.replace("file = @t.png@", "file.timeSamples = { 10: @t.png@, 12: @u.png@ }"),
            ST,
            "file that changes with time is as at the start (first T)",
        ),
    ],
)
def test_materials_tell_what_they_leave_out(tmp_path, inputs, nodes, extra, told):
    world = bound_world(tmp_path, inputs, nodes, extra, TIMED)
    assert len(world.warnings) == 1 and told in world.warnings[0]


def test_samples_that_are_all_alike_change_nothing(tmp_path):
    body = 'def Sphere "ball" { double radius.timeSamples = { 10: 1, 20: 1, 34: 1 } }\n'
    assert not load_world(usda(tmp_path, body + CAMERA, TIMED)).warnings


@pytest.mark.parametrize(
    ("body", "told"),
    [
        (
            mesh('token visibility.timeSamples = { 10: "inherited", 34: "invisible" }', "blinks"),
            "what appears or vanishes is as at the start (first blinks)",
        ),
        (
            'def Points "P" { float[] widths = [1]\npoint3f[] points.timeSamples = { 9: [(0, 0, 0)], 20: [(1,0,0)] } }',
            "points that move stand as at the start (first P)",
        ),
        (
            'def PointInstancer "I" { rel prototypes = [</square>]\nint[] protoIndices = [0, 0]\n'
            "point3f[] positions = [(0, 0, 0)] }",
            "the copies of I are left out: it has 2 of them, 1 places, at most 99999",
        ),
        (
            'def PointInstancer "I" { rel prototypes = </x>\nint[] protoIndices = [0]\n'
            "point3f[] positions = [(0, 0, 0)] }",
            "the copies of I are left out: one of its prototypes is missing",
        ),
        (
            'def Sphere "ball" { double radius.timeSamples = { 10: 1, 34: 2 } }',
            "radius that changes with time is as at",
        ),
        (
            mesh(
                "point3f[] points.timeSamples = { 10: [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)],\n"
                "22: [(0, 0, 0), (1, 0, 0), (0, 0, 1)] }",
                "melting",
            ),
            "melting keeps its first shape: it has 3 points at time 22, not 4",
        ),
        (
            mesh(
                "int[] faceVertexCounts.timeSamples = { 10: [4], 34: [3] }\npoint3f[] points.timeSamples = { "
                "10: [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], 34: [(0, 0, 0), (1, 0, 0), (0, 0, 1)] }",
                "flat",
            ),
            "meshes whose polygons change with time keep their first shape (first flat)",
        ),
        (
            mesh("color3f[] primvars:displayColor.timeSamples = { 10: [(1, 0, 0)], 34: [(0, 1, 0)] }", "painted"),
            "displayColor that changes with time is as at the start (first painted)",
        ),
        (
            'def Camera "zoom" { float focusDistance.timeSamples = { 10: 1, 34: 6 } }',
            "focusDistance that changes with time is as at the start (first zoom)",
        ),
        ('def Camera "bright" { float exposure = 2 }', "exposure of cameras is left out (first bright)"),
        ('def Camera "zoom" { float focalLength.timeSamples = { 10: 20, 34: 60 } }', "focalLength that changes"),
        (
            'def Camera "flat" { token projection = "orthographic"\nfloat horizontalApertureOffset = 5 }',
            "offsets of orthographic cameras are left out (first flat)",
        ),
        ('def SphereLight "l" { float inputs:radius.timeSamples = { 10: 1, 34: 3 } }', "radius that changes with time"),
        (
            'def SphereLight "l" (prepend apiSchemas = ["ShapingAPI"]) { float inputs:shaping:focus = 3 }',
            "shaping:focus of lamps is left out (first l)",
        ),
        (
            'def SphereLight "l" (prepend apiSchemas = ["ShapingAPI"]) { asset inputs:shaping:ies:file = @x.ies@ }',
            "shaping:ies:file of lamps is left out (first l)",
        ),
        ('def RectLight "l" { asset inputs:texture:file = @x.png@ }', "texture:file of lamps is left out (first l)"),
        (
            'def RectLight "l" { float inputs:diffuse = 0 }',
            "factors of lamps on diffuse and specular light are left out",
        ),
        (
            'def DiskLight "l" (prepend apiSchemas = ["ShadowAPI"]) { bool inputs:shadow:enable = 0 }',
            "lamps without shadows have shadows (first l)",
        ),
        (
            'def DistantLight "l" { rel collection:lightLink:includes = </square> }',
            "lamps for some objects shine on all",
        ),
        (
            'def DistantLight "l" { rel collection:shadowLink:excludes = </square> }',
            "lamps for some objects shine on all",
        ),
        (
            'def PointInstancer "I" { rel prototypes = [</square>]\nint[] protoIndices = [0, 0]\n'
            "point3f[] positions = [(0, 0, 0), (1, 0, 0)]\n"
            'color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0)] (\ninterpolation = "vertex") }',
            "colours of single copies are left out (first I)",
        ),
        (
            'def PointInstancer "I" { rel prototypes = [</square>]\nint[] protoIndices = [0, 0]\n'
            "point3f[] positions = [(0, 0, 0), (1, 0, 0)]\nint64[] invisibleIds.timeSamples = { 10: [], 20: [1] } }",
            "copies that appear or vanish are as at the start (first I)",
        ),
        (
            'def PointInstancer "I" { rel prototypes = [</square>]\npoint3f[] positions = [(0, 0, 0)]\n'
            "int[] protoIndices.timeSamples = { 10: [0], 20: [0] } }",
            "copies that appear or vanish are as at the start (first I)",
        ),
    ],
)
def test_bodies_lamps_and_cameras_tell_what_they_leave_out(tmp_path, body, told):
    world = load_world(usda(tmp_path, f"{mesh()}{body}\n", TIMED))
    assert len(world.warnings) == 1 and told in world.warnings[0]


def test_a_mesh_that_is_a_lamp_is_still_seen(tmp_path):
    lamp = mesh("float inputs:intensity = 4", "lamp", SQUARE).replace(
        '"lamp"', '"lamp" (prepend apiSchemas = ["MeshLightAPI"])'
    )
    world = load_world(usda(tmp_path, lamp))
    assert [each.name for each in world.instances] == ["lamp"]
    assert "lamps of type Mesh are left out (first lamp)" in world.warnings[0]


def test_a_warning_names_the_first_alone(tmp_path):
    curves = 'def BasisCurves "{}" {{ point3f[] points = [(0, 0, 0)] }}\n'
    world = load_world(usda(tmp_path, mesh() + curves.format("a") + curves.format("b")))
    assert [text for text in world.warnings if "BasisCurves" in text] == [
        "scene.usda: BasisCurves is left out (first a)"
    ]


def test_mtlx_files_are_told_once(tmp_path):
    (tmp_path / "a.mtlx").write_text("<materialx/>")
    parts = "".join(f'def Material "M{k}" (references = @a.mtlx@</MaterialX>) {{}}\n' for k in range(3))
    world = load_world(usda(tmp_path, mesh() + parts))
    assert len(world.warnings) == 1 and "(first a.mtlx)" in world.warnings[0] and "--flatten" in world.warnings[0]


def test_usd_core_does_not_write_past_clsim(tmp_path, capfd):
    """A material that is bound without saying so is used; usd-core would tell it on standard error, for each prim."""
    material = 'def Material "M" { token outputs:surface.connect = </M/S.outputs:surface>\n def Shader "S" { '
    material += 'uniform token info:id = "UsdPreviewSurface"\n color3f inputs:diffuseColor = (1, 0, 0)\n '
    material += "token outputs:surface } }\n"
    world = load_world(usda(tmp_path, mesh("rel material:binding = </M>") + material))
    assert world.materials[world.meshes[0].material_ids[0]].color == (1, 0, 0) and not world.warnings
    assert capfd.readouterr().err == ""
