"""Materials and lamps of USD files: what they are in clsim."""

import math
import zipfile

import numpy as np
import PIL.Image
import pytest
from pxr import UsdLux

from clsim.scene import load_world
from tests.scene.usd.usd_files import METRES, SECONDS, mesh, placed, usda

SURFACE = """
def Material "paint"
{
    token outputs:surface.connect = </paint/surface.outputs:surface>
    def Shader "surface"
    {
        uniform token info:id = "UsdPreviewSurface"
        %s
        token outputs:surface
    }
    def Shader "reader"
    {
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "map1"
        float2 outputs:result
    }
    def Shader "turned"
    {
        uniform token info:id = "UsdTransform2d"
        float2 inputs:in.connect = </paint/reader.outputs:result>
        float inputs:rotation = 90
        float2 inputs:scale = (2, 3)
        float2 inputs:translation = (.25, .5)
        float2 outputs:result
    }
    def Shader "picture"
    {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @picture.png@
        token inputs:sourceColorSpace = "%s"
        token inputs:wrapS = "mirror"
        float4 inputs:scale = (2, 2, 2, 1)
        float2 inputs:st.connect = </paint/turned.outputs:result>
        float3 outputs:rgb
        float outputs:r
        float outputs:g
        float outputs:a
    }
}
"""
BOUND = "rel material:binding = </paint>\n"
UV = 'texCoord2f[] primvars:map1 = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")\n'
API = '(prepend apiSchemas = ["MaterialBindingAPI"])'


def surface(tmp_path, inputs, space="raw", extra=""):
    """Return the world of a square of that material, and the material."""
    pixels = np.array([[(0, 64, 128, 255), (255, 32, 16, 0)]], np.uint8)
    PIL.Image.fromarray(pixels).save(tmp_path / "picture.png")
    painted = mesh(BOUND + UV + extra).replace('"square"', f'"square" {API}')
    world = load_world(usda(tmp_path, SURFACE % (inputs, space) + painted))
    return world, world.materials[world.meshes[0].material_ids[0]]


def lamps(tmp_path, text, meta=METRES):
    return load_world(usda(tmp_path, mesh() + text, meta))


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
    _, found = surface(tmp_path, inputs)
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
    _, found = surface(tmp_path, f"float inputs:metallic = 1\nint inputs:useSpecularWorkflow = 1\n{color}")
    least = ((found.ior - 1) / (found.ior + 1)) ** 2
    assert np.array(found.specular_color) * least == pytest.approx(reflected)
    assert found.metallic == 0


def test_pictures_keep_their_place_their_factor_and_their_curve(tmp_path):
    world, found = surface(tmp_path, "color3f inputs:emissiveColor.connect = </paint/picture.outputs:rgb>", "sRGB")
    texture = world.textures[found.emission_texture]
    assert texture.srgb and found.emission == (2, 2, 2)
    assert (texture.wrap_u, texture.wrap_v) == ("mirror", "repeat")
    # (1, 0), twice as long, turned to (0, 2), then shifted.
    assert np.array(texture.uv_matrix) @ (1, 0, 1) == pytest.approx((0.25, 2.5))
    assert np.array(texture.uv_matrix) @ (0, 1, 1) == pytest.approx((-2.75, 0.5))
    assert world.meshes[0].uvs.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]


def test_roughness_metalness_and_opacity_take_their_channels(tmp_path):
    inputs = """
    float inputs:roughness.connect = </paint/picture.outputs:g>
    float inputs:metallic.connect = </paint/picture.outputs:r>
    float inputs:opacity.connect = </paint/picture.outputs:a>
    float inputs:opacityThreshold = .5
    """
    world, found = surface(tmp_path, inputs)
    rough = world.textures[found.roughness_texture].pixels
    assert rough[0, :, 1].tolist() == [128, 64]  # times the scale of 2
    assert rough[0, :, 2].tolist() == [0, 255]
    assert (found.alpha, found.metallic, found.alpha_mode, found.alpha_cutoff) == (1, 1, "mask", 0.5)
    assert world.textures[found.opacity_texture].pixels[0, :, 3].tolist() == [255, 0]


def test_a_picture_of_metal_leaves_roughness_as_it_is_told(tmp_path):
    inputs = "float inputs:metallic.connect = </paint/picture.outputs:r>\n    float inputs:roughness = .4\n"
    world, found = surface(tmp_path, inputs)
    assert found.metallic == 1 and world.textures[found.roughness_texture].pixels[0, :, 1].tolist() == [255, 255]
    assert found.alpha == pytest.approx(0.16)


def test_subsets_have_materials_of_their_own_and_others_their_colour(tmp_path):
    subset = """
    color3f[] primvars:displayColor = [(.1, .7, .2)]
    def GeomSubset "part" (prepend apiSchemas = ["MaterialBindingAPI"])
    {
        uniform token elementType = "face"
        uniform token familyName = "materialBind"
        int[] indices = [1]
        rel material:binding = </paint>
    }
    """
    shape = """
    int[] faceVertexCounts = [3, 3]
    int[] faceVertexIndices = [0, 1, 2, 0, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    """
    world = load_world(usda(tmp_path, SURFACE % ("", "raw") + mesh(subset, shape=shape)))
    first, second = (world.materials[k] for k in world.meshes[0].material_ids)
    assert first.color == pytest.approx((0.1, 0.7, 0.2))
    assert (second.kind, second.name) == ("principled", "paint")


def test_a_mesh_has_the_coordinates_that_the_material_of_its_first_part_asks_for(tmp_path):
    """``map1``, which the picture's node names, though the mesh itself has no material."""
    subset = f"""
    {UV}
    def GeomSubset "part" {API}
    {{
        uniform token elementType = "face"
        uniform token familyName = "materialBind"
        int[] indices = [0]
        {BOUND}
    }}
    """
    inputs = "color3f inputs:diffuseColor.connect = </paint/picture.outputs:rgb>"
    PIL.Image.fromarray(np.full((2, 2, 4), 255, np.uint8)).save(tmp_path / "picture.png")
    world = load_world(usda(tmp_path, SURFACE % (inputs, "raw") + mesh(subset)))
    _, whole = surface(tmp_path, inputs)
    assert world.materials[world.meshes[0].material_ids[0]].texture == whole.texture >= 0
    assert world.meshes[0].uvs is not None and np.ptp(world.meshes[0].uvs, axis=0) == pytest.approx((1, 1))


def test_lamps_have_their_sizes_and_their_radiance(tmp_path):
    text = """
    def SphereLight "bulb" { float inputs:radius = 50
        float inputs:intensity = 3
        float inputs:exposure = 2
        color3f inputs:color = (1, .5, .25) }
    def SphereLight "normal" { float inputs:radius = 50
        float inputs:intensity = 12
        bool inputs:normalize = 1 }
    def SphereLight "dot" { bool treatAsPoint = 1
        float inputs:radius = 2
        float inputs:intensity = 8
        bool inputs:normalize = 1 }
    def DistantLight "far" { float inputs:angle = 0
        float inputs:intensity = 7 }
    def DistantLight "sun" { float inputs:angle = 2
        float inputs:intensity = 5
        bool inputs:normalize = 1 }
    def RectLight "panel" { float inputs:width = 200
        float inputs:height = 100
        float inputs:intensity = 20000
        bool inputs:normalize = 1
        bool inputs:enableColorTemperature = 1
        float inputs:colorTemperature = 3000 }
    def DomeLight "sky" { float inputs:intensity = .5 }
    """
    world = lamps(tmp_path, text, METRES.replace("= 1", "= 0.01"))
    bulb, normal, sun = world.sphere_lights
    assert (bulb.radius_m, bulb.radiance) == (pytest.approx(0.5), pytest.approx((12, 6, 3)))
    assert normal.radiance == pytest.approx((12 / (4 * math.pi * 2500),) * 3)
    # A disk of the radiance 5 / (π·sin²(1°)) gives 5 on what faces it.
    pose = sun.motion.pose(0.0)
    away, seen = np.linalg.norm(pose[:3, 3]), sun.radius_m / np.linalg.norm(pose[:3, 3])
    assert seen == pytest.approx(math.sin(math.radians(1)), rel=1e-3)
    assert sun.radiance[0] * math.pi * seen**2 == pytest.approx(5, rel=1e-3)
    assert pose[:3, 3] / away == pytest.approx((0, 0, 1), abs=1e-3)
    dot, far = world.punctual_lights
    assert dot.intensity == pytest.approx((8 / 4 * 1e-4,) * 3)
    assert (far.kind, far.intensity) == ("directional", (7, 7, 7))
    panel = next(material for material in world.materials if material.name == "panel")
    assert panel.emission == pytest.approx(tuple(UsdLux.BlackbodyTemperatureAsRgb(3000)))
    assert not panel.emits_behind
    assert world.environment == pytest.approx((0.5, 0.5, 0.5))


@pytest.mark.parametrize("kind", ["RectLight", "DiskLight"])
def test_panels_shine_along_minus_z_with_their_whole_area(tmp_path, kind):
    world = lamps(
        tmp_path, f'def {kind} "lamp" {{ float inputs:width = 2\nfloat inputs:height = 3\nfloat inputs:radius = 2 }}'
    )
    panel = world.meshes[-1]
    a, b, c = (panel.vertices[panel.triangles[:, k]] for k in range(3))
    area = np.cross(b - a, c - a).sum(axis=0) / 2
    assert area == pytest.approx((0, 0, -6 if kind == "RectLight" else -4 * math.pi), rel=1e-6)


def test_a_tube_has_the_area_of_its_round_side(tmp_path):
    """Its light is what it emits times its area, that of 2π·r·l."""
    world = lamps(tmp_path, 'def CylinderLight "tube" { float inputs:radius = 0.5\nfloat inputs:length = 3 }')
    corners = world.meshes[-1].vertices[world.meshes[-1].triangles]
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.linalg.norm(sides, axis=1).sum() / 2 == pytest.approx(2 * math.pi * 0.5 * 3, rel=1e-5)


@pytest.mark.parametrize("metres", ["1", "0.01"])
def test_a_normalised_sphere_shines_as_brightly_however_small_it_is(tmp_path, metres):
    """Of no size at all it is a point whose intensity is π·r² of the radiance of a small one."""
    told = "float inputs:intensity = 8\nbool inputs:normalize = 1\nfloat inputs:radius ="
    text = f'def SphereLight "small" {{ {told} 0.01 }}\ndef SphereLight "none" {{ {told} 0 }}'
    world = lamps(tmp_path, text, METRES.replace("= 1", f"= {metres}"))
    (small,), (none,) = world.sphere_lights, world.punctual_lights
    assert none.intensity == pytest.approx([math.pi * small.radius_m**2 * each for each in small.radiance])
    assert (none.kind, none.intensity[0]) == ("point", pytest.approx(2 * float(metres) ** 2))


@pytest.mark.parametrize("metres", ["1", "0.01"])
@pytest.mark.parametrize("normalize", [0, 1])
def test_a_sphere_that_is_shown_as_a_point_shines_as_the_sphere_does(tmp_path, metres, normalize):
    told = f"float inputs:radius = 3\nfloat inputs:intensity = 8\nbool inputs:normalize = {normalize}\n"
    text = f'def SphereLight "ball" {{ {told} }}\ndef SphereLight "dot" {{ bool treatAsPoint = 1\n{told} }}'
    world = lamps(tmp_path, text, METRES.replace("= 1", f"= {metres}"))
    (ball,), (dot,) = world.sphere_lights, world.punctual_lights
    assert dot.intensity == pytest.approx([math.pi * ball.radius_m**2 * each for each in ball.radiance])


@pytest.mark.parametrize("kind", ["DiskLight", "RectLight", "CylinderLight", "DistantLight"])
def test_a_normalised_lamp_without_a_size_hinders_nothing(tmp_path, kind):
    """A sun of no angle gives the light of any other; what has no area is told, and leaves all else as it is."""
    sizes = "\n".join(f"float inputs:{size} = 0" for size in ("radius", "width", "height", "length", "angle"))
    lamp = f'def {kind} "lamp" {{ {sizes}\nfloat inputs:intensity = 8\nbool inputs:normalize = 1 }}'
    world = lamps(tmp_path, lamp)
    assert "square" in [each.name for each in world.instances]
    assert all(np.isfinite(each.emission).all() for each in world.materials)
    suns = [each.intensity for each in world.punctual_lights if each.kind == "directional"]
    assert suns == ([(8, 8, 8)] if kind == "DistantLight" else [])
    assert any("no area" in warning for warning in world.warnings) == (kind != "DistantLight")


def test_light_changes_with_its_samples(tmp_path):
    text = 'def SphereLight "blink" { float inputs:intensity.timeSamples = { 10: 2, 22: 8, 34: 0 } }\ndef Camera "c" {}'
    world = lamps(tmp_path, text, f"{METRES}\n    {SECONDS}")
    (lamp,) = world.sphere_lights
    for time_s, intensity in ((0.0, 2), (0.25, 5), (0.5, 8), (0.75, 4)):
        assert lamp.radiance[0] * lamp.modulation.mean(time_s, time_s)[0] == pytest.approx(intensity)
    assert world.duration_s == 1.0
    two_s = f"{METRES}\n    {SECONDS}".replace("34", "58")
    changing = "{ float inputs:intensity.timeSamples = { 10: 2, 58: 8 } }\ndef Camera"
    sun = lamps(tmp_path, f'def DistantLight "sun" {changing} "c" {{}}', two_s)
    sky = lamps(tmp_path, f'def DomeLight "sky" {changing} "c" {{}}', two_s)
    assert sky.environment[0] * sky.environment_modulation.mean(1.0, 1.0)[0] == pytest.approx(5)
    assert sun.duration_s == sky.duration_s == 2.0
    # Without a camera all goes on anew.
    (lamp,) = lamps(tmp_path, text.partition("\n")[0], f"{METRES}\n    {SECONDS}").sphere_lights
    assert lamp.radiance[0] * lamp.modulation.mean(1.25, 1.25)[0] == pytest.approx(5)


def test_the_dome_shows_each_direction_what_usd_says(tmp_path):
    pixels = np.zeros((2, 4, 3), np.uint8)
    pixels[0], pixels[1, 2] = (0, 0, 255), (255, 0, 0)  # blue above; red from +z to −x below
    PIL.Image.fromarray(pixels).save(tmp_path / "sky.png")
    dome = 'def DomeLight%s "sky" { asset inputs:texture:file = @sky.png@ }'
    world = lamps(tmp_path, dome % "")
    assert world.environment_map.to_world == pytest.approx(np.eye(3))
    turned = lamps(tmp_path, dome % "_1", METRES.replace('"Y"', '"Z"')).environment_map.to_world
    # The stage's +z, our +y, is the pole; the picture's middle lies towards its −y, our +z.
    assert turned == pytest.approx(np.eye(3), abs=1e-12)
    tilted = lamps(tmp_path, (dome % "_1").replace(" }", '\nuniform token poleAxis = "Z" }')).environment_map.to_world
    assert tilted @ (0, 1, 0) == pytest.approx((0, 0, 1), abs=1e-12), "whatever the stage's own axis is"
    spin = placed("float xformOp:rotateY.timeSamples = { 10: 0, 34: 90 }")
    spun = lamps(tmp_path, (dome % "").replace(" }", f"\n{spin} }}"), f"{METRES}\n    {SECONDS}")
    assert any("the dome sky does not turn" in warning for warning in spun.warnings)


@pytest.mark.parametrize(("meta", "pole"), [(METRES, (0, 1, 0)), (METRES.replace('"Y"', '"Z"'), (0, 0, -1))])
def test_a_dome_without_a_pole_of_its_own_has_its_y_axis_for_one(tmp_path, meta, pole):
    """UsdLux has poleAxis of DomeLight_1 alone; a DomeLight's pole is +y, whatever the stage's up axis is."""
    PIL.Image.new("RGB", (4, 2)).save(tmp_path / "sky.png")
    for more in ("", 'uniform token poleAxis = "Z"\n', 'uniform token poleAxis = "scene"\n'):
        world = lamps(tmp_path, f'def DomeLight "sky" {{ {more}asset inputs:texture:file = @sky.png@ }}', meta)
        assert world.environment_map.to_world @ (0, 1, 0) == pytest.approx(pole, abs=1e-12)


@pytest.mark.parametrize("name", ["sky.exr", "SKY.EXR", "Sky.Hdr"])
def test_a_dome_whose_picture_of_light_is_packed_says_what_to_do(tmp_path, name):
    text = usda(tmp_path, mesh() + f'def DomeLight "sky" {{ asset inputs:texture:file = @{name}@ }}').read_text()
    with zipfile.ZipFile(tmp_path / "scene.usdz", "w") as package:
        package.writestr("scene.usda", text)
        package.writestr(name, b"light")
    world = load_world(tmp_path / "scene.usdz")
    assert world.environment == (1, 1, 1) and world.environment_map is None
    said = f"the dome's texture is left out: {name} is packed, expected a file of its own, or PNG or JPEG"
    assert any(said in warning for warning in world.warnings), world.warnings


def test_what_is_lacking_is_told_once(tmp_path):
    text = """
    def BasisCurves "hair" {}
    def PortalLight "door" {}
    def SphereLight "spot" (prepend apiSchemas = ["ShapingAPI"]) { float inputs:shaping:cone:angle = 30 }
    """
    world = lamps(tmp_path, text)
    said = "\n".join(world.warnings)
    assert all(word in said for word in ("BasisCurves", "PortalLight", "spots without size"))
    (spot,) = world.punctual_lights
    assert spot.intensity[0] == pytest.approx(math.pi * 0.25)
    assert spot.outer_deg == 30


@pytest.mark.parametrize(("softness", "inner"), [(0.0, 40.0), (0.25, 30.0), (1.0, 0.0), (7.0, 0.0)])
def test_softness_is_the_share_of_the_cone_in_which_light_falls(tmp_path, softness, inner):
    """UsdLux: the smooth edge begins at the cone's angle times 1 − softness, which goes from 0 to 1."""
    angles = f"float inputs:shaping:cone:angle = 40\nfloat inputs:shaping:cone:softness = {softness}"
    lamp = f'def SphereLight "spot" (prepend apiSchemas = ["ShapingAPI"]) {{ {angles} }}'
    (spot,) = lamps(tmp_path, lamp).punctual_lights
    assert (spot.inner_deg, spot.outer_deg) == (pytest.approx(inner), 40.0)


@pytest.mark.parametrize("prefix", ["inputs:", ""])
def test_lamps_of_before_their_inputs_were_called_so(tmp_path, prefix):
    # Files of before USD 21.02, such as Blender's up to 2.93.
    ball = 'def SphereLight "ball" { float <intensity = 50\nfloat <exposure = 1\ncolor3f <color = (1, 0.5, 0.25)\n'
    ball += "float <radius = 2\nbool <normalize = 0 }\n"
    spot = 'def SphereLight "spot" { float <radius = 0.1\nfloat <shaping:cone:angle = 30 }\n'
    sky = 'def DomeLight "sky" { asset <texture:file = @sky.png@\nfloat <intensity = 3 }\n'
    PIL.Image.new("RGB", (4, 2), (255, 255, 255)).save(tmp_path / "sky.png")
    world = load_world(usda(tmp_path, mesh() + (ball + spot + sky).replace("<", prefix)))
    (found,) = world.sphere_lights
    assert (found.radius_m, found.radiance) == (2, pytest.approx((100, 50, 25)))
    assert [each.outer_deg for each in world.punctual_lights] == [30]
    assert world.environment_map is not None and world.environment_map.radiance.max() == pytest.approx(3)
