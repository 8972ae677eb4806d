"""Lamps of USD files: what they are in clsim."""

import math
import zipfile

import numpy as np
import PIL.Image
import pytest
from pxr import Usd, UsdGeom, UsdLux

from clsim.scene import load_world
from tests.scene.usd.usd_files import METRES, SECONDS, mesh, placed, usda


def lamps(tmp_path, text, meta=METRES):
    return load_world(usda(tmp_path, mesh() + text, meta))


def test_lamps_have_their_sizes_and_their_radiance(tmp_path):
    text = """
    def SphereLight "normal" { float inputs:radius = 50
        float inputs:intensity = 12
        bool inputs:normalize = 1 }
    def SphereLight "dot" { bool treatAsPoint = 1
        float inputs:radius = 2
        float inputs:intensity = 8
        bool inputs:normalize = 1 }
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
    normal, sun = world.sphere_lights
    assert (normal.radius_m, *normal.radiance) == pytest.approx((0.5, *(12 / (4 * math.pi * 2500),) * 3))
    # A disk of the radiance 5 / (π·sin²(1°)) gives 5 on what faces it.
    seen = sun.radius_m / np.linalg.norm(sun.motion.pose(0.0)[:3, 3])
    assert sun.radiance[0] * math.pi * seen**2 == pytest.approx(5, rel=1e-6)
    (dot,) = world.punctual_lights
    assert dot.intensity == pytest.approx((8 / 4 * 1e-4,) * 3)
    panel = next(material for material in world.materials if material.name == "panel")
    assert panel.emission == pytest.approx(tuple(UsdLux.BlackbodyTemperatureAsRgb(3000)))
    assert not panel.emits_behind
    assert world.environment == pytest.approx((0.5, 0.5, 0.5))


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("kind", "area"), [("RectLight", 6), ("DiskLight", 4 * math.pi), ("CylinderLight", 12 * math.pi)]
)
def test_lamps_with_a_shape_shine_with_their_whole_area(tmp_path, kind, area, sign):
    """Panels along −z, a tube all around; a size below 0 is as one above."""
    sizes = "".join(f"float inputs:{name} = {sign * size}\n" for name, size in SIZES.items())
    found = lamps(tmp_path, f'def {kind} "lamp" {{ {sizes} }}').meshes[-1]
    a, b, c = (found.vertices[found.triangles[:, k]].astype(np.float64) for k in range(3))
    sides, middles = np.cross(b - a, c - a) / 2, (a + b + c) / 3
    assert np.linalg.norm(sides, axis=1).sum() == pytest.approx(area, rel=1e-5)
    outwards = middles * (0, 1, 1) if kind == "CylinderLight" else np.tile((0, 0, -1), (len(sides), 1))
    assert (np.einsum("nk,nk->n", sides, outwards) > 0).all()


SIZES = {"width": 2, "height": 3, "radius": 2, "length": 3}


@pytest.mark.parametrize("metres", ["1", "0.01"])
def test_a_normalised_sphere_shines_as_brightly_however_small_it_is(tmp_path, metres):
    """Of no size at all it is a point whose intensity is π·r² of the radiance of a small one.

    One that is not normalised has a quarter of its surface's in every unit, as if that were one of the unit (UsdLux).
    """
    told = "float inputs:intensity = 8\nbool inputs:normalize = {}\nfloat inputs:radius = {}"
    given = (("small", 1, 0.01), ("none", 1, 0), ("plain", 0, 0))
    text = "".join(f'def SphereLight "{name}" {{ {told.format(*values)} }}\n' for name, *values in given)
    world = lamps(tmp_path, text, METRES.replace("= 1", f"= {metres}"))
    (small,), (none, plain) = world.sphere_lights, world.punctual_lights
    assert none.intensity == pytest.approx([math.pi * small.radius_m**2 * each for each in small.radiance])
    assert (none.kind, none.intensity[0]) == ("point", pytest.approx(2 * float(metres) ** 2))
    assert plain.intensity == pytest.approx((2, 2, 2))


@pytest.mark.parametrize("metres", ["1", "0.01"])
@pytest.mark.parametrize("normalize", [0, 1])
def test_a_sphere_that_is_shown_as_a_point_shines_as_the_sphere_does(tmp_path, metres, normalize):
    told = f"float inputs:radius = 3\nfloat inputs:intensity = 8\nbool inputs:normalize = {normalize}\n"
    told += placed("float3 xformOp:scale = (2, 2, 2)")
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


CHANGING = "float inputs:intensity.timeSamples = { 10: 2, 22: 8, 34: 0 }\n"
CONE = "float inputs:shaping:cone:angle = 30"


@pytest.mark.parametrize(
    ("kind", "told", "share"),
    [
        ("SphereLight", "", 1.0),
        ("SphereLight", "bool treatAsPoint = 1", math.pi * 0.25),
        ("SphereLight", CONE, math.pi * 0.25),
        ("DistantLight", "float inputs:angle = 2", 1.0),
        ("DistantLight", "float inputs:angle = 0", 1.0),
        ("RectLight", "", 1.0),
        ("DomeLight", "", 1.0),
    ],
)
def test_light_changes_with_its_samples(tmp_path, kind, told, share):
    timed = f"{METRES}\n    {SECONDS}"
    text = f'def {kind} "lamp" {{ {CHANGING}{told} }}\n'
    world = lamps(tmp_path, text + 'def Camera "c" {}', timed)
    found = [(each.radiance, each.modulation) for each in world.sphere_lights]
    found += [(each.intensity, each.modulation) for each in world.punctual_lights]
    found += [(each.emission, each.modulation) for each in world.materials if any(each.emission)]
    found += [(world.environment, world.environment_modulation)] if kind == "DomeLight" else []
    ((most, change),) = found
    for time_s, intensity in ((0.0, 2), (0.25, 5), (0.5, 8), (0.75, 4), (5.0, 0)):
        assert most[0] * change.mean(time_s, time_s)[0] == pytest.approx(share * intensity)
    assert world.duration_s == 1.0
    if kind == "SphereLight" and not told:  # without a camera all goes on anew
        (lamp,) = lamps(tmp_path, text, timed).sphere_lights
        assert lamp.radiance[0] * lamp.modulation.mean(1.25, 1.25)[0] == pytest.approx(5)


def test_a_sun_turns_about_the_middle_of_what_it_lights(tmp_path):
    """At each time it stands where usd-core's +z axis of it points to, and is as far and as large as at the start."""
    turning = placed("float xformOp:rotateX.timeSamples = { 10: 0, 34: -120 }", "float xformOp:rotateY = 30")
    square = mesh(placed("double3 xformOp:translate = (50, 0, 0)"))
    text = square + f'def DistantLight "sun" {{ float inputs:angle = 2\n{turning} }}\ndef Camera "c" {{}}'
    path = usda(tmp_path, text, f"{METRES}\n    {SECONDS}")
    (sun,) = load_world(path).sphere_lights
    stage = Usd.Stage.Open(str(path))
    prim = UsdGeom.Xformable(stage.GetPrimAtPath("/sun"))
    for code in (10, 16, 22, 34):
        away = sun.motion.pose((code - 10) / 24)[:3, 3] - (50, 0, 0)
        assert np.linalg.norm(away) == pytest.approx(1e4 * math.sqrt(2))
        axis = np.array(prim.ComputeLocalToWorldTransform(code))[2, :3]
        assert away / np.linalg.norm(away) == pytest.approx(axis, abs=1e-4)


@pytest.mark.parametrize("first", ["asset inputs:texture:file = @sky.png@", "float inputs:intensity = 3"])
def test_of_several_domes_the_first_is_used(tmp_path, first):
    PIL.Image.new("RGB", (4, 2), (255, 0, 0)).save(tmp_path / "sky.png")
    second = 'def DomeLight "more" { asset inputs:texture:file = @sky.png@\nfloat inputs:intensity = 9 }'
    world = lamps(tmp_path, f'def DomeLight "sky" {{ {first} }}\n{second}')
    light = world.environment if world.environment_map is None else world.environment_map.radiance.max(axis=(0, 1))
    assert tuple(light) == ((3, 3, 3) if "intensity" in first else (1, 0, 0))
    assert any("of several domes the first is used (more is left out)" in warning for warning in world.warnings)


def test_a_dome_of_another_layout_is_told(tmp_path):
    PIL.Image.new("RGB", (4, 2)).save(tmp_path / "sky.png")
    picture = 'asset inputs:texture:file = @sky.png@\ntoken inputs:texture:format = "angular"'
    world = lamps(tmp_path, f'def DomeLight "sky" {{ {picture} }}')
    assert world.environment == (1, 1, 1) and world.environment_map is None
    assert any("its format is angular, expected latlong" in warning for warning in world.warnings)


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


def test_a_dome_s_picture_in_a_package_is_that_of_the_file(tmp_path):
    PIL.Image.fromarray(np.arange(0, 240, 10, dtype=np.uint8).reshape(2, 4, 3)).save(tmp_path / "sky.png")
    path = usda(tmp_path, mesh() + 'def DomeLight "sky" { asset inputs:texture:file = @sky.png@ }')
    with zipfile.ZipFile(tmp_path / "scene.usdz", "w") as package:
        package.write(path, "scene.usda")
        package.write(tmp_path / "sky.png", "sky.png")
    loose, packed = (load_world(each).environment_map.radiance for each in (path, tmp_path / "scene.usdz"))
    np.testing.assert_allclose(packed, loose, rtol=1e-5)


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
    ball += "float <radius = 2\nbool <normalize = 0\n" + ("float intensity = 7 }\n" if prefix else "}\n")
    spot = 'def SphereLight "spot" { float <radius = 0.1\nfloat <shaping:cone:angle = 30 }\n'
    sky = 'def DomeLight "sky" { asset <texture:file = @sky.png@\nfloat <intensity = 3 }\n'
    PIL.Image.new("RGB", (4, 2), (255, 255, 255)).save(tmp_path / "sky.png")
    world = load_world(usda(tmp_path, mesh() + (ball + spot + sky).replace("<", prefix)))
    (found,) = world.sphere_lights
    assert (found.radius_m, found.radiance) == (2, pytest.approx((100, 50, 25)))
    assert [each.outer_deg for each in world.punctual_lights] == [30]
    assert world.environment_map is not None and world.environment_map.radiance.max() == pytest.approx(3)
