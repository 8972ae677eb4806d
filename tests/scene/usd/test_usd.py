"""USD files: where things are and how they move, against usd-core's own evaluation, and what a hostile file is told."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pxr import Usd, UsdGeom, UsdUtils

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.defaults.framing import ENVIRONMENT, ORBIT_S
from tests.scene.usd.usd_files import (
    CAMERA,
    CENTIMETRES_Z_UP,
    METRES,
    TIMED,
    VANISHING,
    mesh,
    placed,
    points_at,
    usda,
)

ARM = placed(
    "double3 xformOp:translate.timeSamples = { 10: (0, 0, 0), 34: (3, 2, 1) }",
    "float xformOp:rotateZ.timeSamples = { 10: 0, 22: 720, 34: 90 }",
    "float3 xformOp:scale = (2, 2, 2)",
)
HAND = placed(
    "double3 xformOp:translate = (1, 2, 3)",
    "float3 xformOp:rotateXYZ.timeSamples = { 15: (0, 0, 0), 30: (40, 100, 10) }",
)

HOT = 'def SphereLight "bulb" { bool inputs:enableColorTemperature = 1\n float inputs:colorTemperature = nan }'
RED = """def Material "red" { token outputs:surface.connect = </red/it.outputs:surface>
def Shader "it" { uniform token info:id = "UsdPreviewSurface"\n token outputs:surface
string inputs:diffuseColor = "red" } }"""


def moving(inside):
    return f'def Xform "arm" {{ {ARM}\ndef Xform "hand" {{ {HAND}\n{inside} }} }}\n'


def points_of_usd(path, prim, code, unit=1.0):
    """Return a mesh's points in a world with +y up, as usd-core evaluates them."""
    stage = Usd.Stage.Open(str(path))
    shape = UsdGeom.Mesh(stage.GetPrimAtPath(prim))
    matrix = np.array(shape.ComputeLocalToWorldTransform(code))
    points = np.array(shape.GetPointsAttr().Get(code), np.float64)
    return (points @ matrix[:3, :3] + matrix[3, :3]) * unit


@pytest.mark.parametrize("scale", ["(1, 1, 1)", "(1, 3, -1)"], ids=["rigid", "stretched"])
def test_things_move_as_usd_moves_them_at_all_times(tmp_path, scale):
    text = moving(mesh(placed(f"float3 xformOp:scale = {scale}"))) + CAMERA
    path = usda(tmp_path, text, TIMED)
    world = load_world(path)
    (instance,) = world.instances
    assert world.duration_s == 1.0
    for code in np.linspace(10, 34, 97):
        expected = points_of_usd(path, "/arm/hand/square", code)
        assert np.abs(points_at(world, instance, (code - 10) / 24) - expected).max() < 2e-3


@pytest.mark.parametrize("samples", ["10: 0, 34: 720", "0: 0, 44: 300", "-20: 70, 22: 0, 60: 200"])
def test_turns_between_samples_are_turns_also_of_those_outside_of_the_file_s_time(tmp_path, samples):
    turning = placed(f"float xformOp:rotateY.timeSamples = {{ {samples} }}")
    path = usda(tmp_path, mesh(turning) + CAMERA, TIMED)
    world = load_world(path)
    for code in (10, 13, 16, 22, 28):
        expected = points_of_usd(path, "/square", code)
        assert np.abs(points_at(world, world.instances[0], (code - 10) / 24) - expected).max() < 1e-3


TILTING = """
    point3f[] points.timeSamples = { 10: [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)],
        34: [(-1, -2, 1), (1, 2, 1), (1, 2, -1), (-1, -2, -1)] }
    normal3f[] normals.timeSamples = { 10: [(0, 1, 0), (0, 1, 0), (0, 1, 0), (0, 1, 0)],
        34: [(-2, 1, 0), (-2, 1, 0), (-2, 1, 0), (-2, 1, 0)] }
"""


@pytest.mark.parametrize("shape", ["", TILTING])
@pytest.mark.parametrize("scale", [".timeSamples = { 10: (1, 1, 1), 34: (1, 4, 0.5) }", " = (1, 3, -0.5)"])
@pytest.mark.parametrize("moves", [True, False])
def test_what_is_stretched_and_bends_in_time_is_where_usd_says_and_has_its_own_normals(tmp_path, shape, scale, moves):
    inner = mesh(shape + placed(f"float3 xformOp:scale{scale}"))
    path = usda(tmp_path, (moving(inner) if moves else inner) + CAMERA, TIMED)
    world = load_world(path)
    (instance,) = world.instances
    for code in (10, 22, 34):
        expected = points_of_usd(path, "/arm/hand/square" if moves else "/square", code)
        assert np.abs(points_at(world, instance, (code - 10) / 24) - expected).max() < 1e-5
        if shape and code != 22:
            _, normals = world.meshes[instance.mesh].deformation.vertices_at((code - 10) / 24)
            normals = normals @ instance.motion.pose((code - 10) / 24)[:3, :3].T
            across = np.cross(expected[1] - expected[0], expected[3] - expected[0])
            cosines = normals @ across / np.linalg.norm(across) / np.linalg.norm(normals, axis=1)
            np.testing.assert_allclose(np.abs(cosines), 1, atol=1e-5)


def test_what_shears_between_its_samples_alone_is_a_deformation(tmp_path):
    """It turns by half within what is stretched: at both ends it is as wide as it was."""
    turning = placed("float xformOp:rotateY.timeSamples = { 10: 0, 34: 180 }")
    wide = f'def Xform "wide" {{ {placed("float3 xformOp:scale = (2, 1, 1)")}{mesh(turning)} }}\n'
    path = usda(tmp_path, wide + CAMERA, TIMED)
    world = load_world(path)
    for code in (10, 19, 22, 34):
        expected = points_of_usd(path, "/wide/square", code)
        assert np.abs(points_at(world, world.instances[0], (code - 10) / 24) - expected).max() < 5e-3


def test_units_are_metres_and_y_is_up(tmp_path):
    path = usda(tmp_path, mesh(placed("double3 xformOp:translate = (100, 200, 300)")), CENTIMETRES_Z_UP)
    world = load_world(path)
    x, y, z = points_of_usd(path, "/square", 0, 0.01).T
    assert np.allclose(points_at(world, world.instances[0], 0.0), np.stack([x, z, -y], 1), atol=1e-6)


def test_points_that_move_are_joined_by_lines_and_keep_corners_apart(tmp_path):
    shape = """
    int[] faceVertexCounts = [3, 3]
    int[] faceVertexIndices = [0, 1, 2, 0, 2, 3]
    point3f[] points.timeSamples = {
        0: [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)],
        12: [(0, 0, 5), (1, 0, 0), (3, 1, 0), (0, 1, 0)]
    }
    uniform token subdivisionScheme = "none"
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (.5, 0), (.5, 1), (0, 1)] (interpolation = "faceVarying")
    """
    path = usda(tmp_path, mesh(shape=shape) + CAMERA, f"{METRES}\n startTimeCode = 0\n endTimeCode = 24")
    world = load_world(path)
    (found,) = world.meshes
    assert found.uvs.tolist() == [[0, 0], [1, 0], [1, 1], [0.5, 0], [0.5, 1], [0, 1]]
    for code in (0, 3, 12, 20):
        expected = points_of_usd(path, "/square", code)[[0, 1, 2, 0, 2, 3]]
        assert np.allclose(found.deformation.vertices_at(code / 24)[0], expected, atol=1e-6)
    assert world.duration_s == 1.0


def test_skins_are_followed(tmp_path):
    weights = """
    int[] primvars:skel:jointIndices = [0, 0, 0, 0] (interpolation = "vertex"\n elementSize = 1)
    float[] primvars:skel:jointWeights = [1, 1, 1, 1] (interpolation = "vertex"\n elementSize = 1)
    rel skel:skeleton = </root/bones>
    """
    api = '(prepend apiSchemas = ["SkelBindingAPI"])'
    skinned = mesh(weights).replace('"square"', f'"square" {api}')
    rest = "[((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))]"
    rig = f"""
    def SkelRoot "root"
    {{
        {skinned}
        def Skeleton "bones" {api}
        {{
            uniform token[] joints = ["bone"]
            uniform matrix4d[] bindTransforms = {rest}
            uniform matrix4d[] restTransforms = {rest}
            rel skel:animationSource = </root/bones/moves>
            def SkelAnimation "moves"
            {{
                uniform token[] joints = ["bone"]
                float3[] translations.timeSamples = {{ 10: [(0, 0, 0)], 34: [(0, 4, 0)] }}
                quatf[] rotations = [(1, 0, 0, 0)]
                half3[] scales = [(1, 1, 1)]
            }}
        }}
    }}
    """
    world = load_world(usda(tmp_path, rig + CAMERA, TIMED))
    assert points_at(world, world.instances[0], 0.5)[:, 1] == pytest.approx(2.0)


def test_packages_and_binaries_are_read(tmp_path):
    text = usda(tmp_path, mesh())
    binary, package = tmp_path / "scene.usdc", tmp_path / "scene.usdz"
    Usd.Stage.Open(str(text)).Export(str(binary))
    assert UsdUtils.CreateNewUsdzPackage(str(binary), str(package))
    for path in (binary, package):
        world = load_world(path)
        assert len(world.meshes[0].triangles) == 2


def test_a_usd_as_part_of_a_toml_and_as_a_path(tmp_path):
    lamp = 'def SphereLight "bulb" { float inputs:radius = 1\n float inputs:intensity = 3 }\n'
    text = mesh(placed("double3 xformOp:translate = (100, 0, 0)")) + lamp + CAMERA.replace("9)", "900)")
    usda(tmp_path, text, METRES.replace("= 1", "= 0.01"), "part.usda")
    scene = tmp_path / "scene.toml"
    scene.write_text(
        '[camera]\ntrajectory = "part.usda"\n[[objects]]\nfile = "part.usda"\nname = "it"\nscale = 3.0\n'
        "position = [0.0, 1.0, 0.0]\n"
    )
    world = load_world(scene)
    assert world.camera.motion.pose(0.0)[:3, 3] == pytest.approx((0, 0, 9))
    (instance,), (bulb,) = world.instances, world.sphere_lights
    assert points_at(world, instance, 0.0).mean(axis=0) == pytest.approx((3, 1, 0))
    assert (instance.name, bulb.name, bulb.radius_m) == ("it/square", "it/bulb", pytest.approx(0.03))


@pytest.mark.parametrize("kind", ["DistantLight", "DomeLight", "DomeLight of a picture"])
def test_a_part_leaves_light_from_afar_to_the_scene(tmp_path, kind):
    Image.new("RGB", (4, 2)).save(tmp_path / "sky.png")
    picture = "asset inputs:texture:file = @sky.png@" if "picture" in kind else ""
    usda(tmp_path, mesh() + f'def {kind.split()[0]} "sky" {{ {picture} }}', name="part.usda")
    scene = tmp_path / "scene.toml"
    scene.write_text('[camera]\nposition = [0, 1, 9]\n[[objects]]\nfile = "part.usda"\n')
    world = load_world(scene)
    assert not world.sphere_lights and world.environment_map is None
    assert any("its distant lights and domes are left out" in warning for warning in world.warnings)


def test_a_path_of_a_usd_is_followed_once(tmp_path):
    eye = placed("double3 xformOp:translate.timeSamples = { 10: (0, 0, 0), 34: (3, 2, 1) }")
    usda(tmp_path, f'def Camera "eye" {{ {eye} }}', TIMED, "path.usda")
    scene = tmp_path / "scene.toml"
    scene.write_text('[camera]\ntrajectory = "path.usda"\n[[objects]]\nshape = "box"\n')
    motion = load_world(scene).camera.motion
    for time_s, share in ((0.5, 0.5), (1.0, 1.0), (1.25, 1.0)):
        assert motion.pose(time_s)[:3, 3] == pytest.approx((3 * share, 2 * share, share))

    usda(tmp_path, mesh(), TIMED, "path.usda")
    with pytest.raises(InputError, match=r"path\.usda: has no camera"):
        load_world(scene)


@pytest.mark.parametrize(
    ("name", "most", "said"), [("MAX_PRIMS", 3, "more than 2 prims"), ("MAX_INSTANCES", 2, "more than 1 meshes")]
)
def test_a_file_may_hold_so_much_and_no_more(tmp_path, monkeypatch, name, most, said):
    path = usda(tmp_path, mesh() + mesh(name="other"))  # and the root
    monkeypatch.setattr(f"clsim.scene.usd.scene.{name}", most)
    assert len(load_world(path).instances) == 2
    monkeypatch.setattr(f"clsim.scene.usd.scene.{name}", most - 1)
    with pytest.raises(InputError, match=said):
        load_world(path)


def test_a_missing_library_is_told_with_what_to_install(tmp_path, monkeypatch):
    path = usda(tmp_path, mesh())
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install 'clsim\[usd\]'"):
        load_world(path)


def test_a_package_that_is_none_is_told(tmp_path):
    path = tmp_path / "bad.usdz"
    path.write_bytes(b"hello")
    with pytest.raises(InputError) as caught:
        load_world(path)
    assert str(caught.value).startswith(f"{path}: cannot be read as USD (")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b"#usda 1.0\ndef Mesh {", "cannot be read as USD"),
        (b"PXR-USDC\0\0\0", "cannot be read as USD"),
        (b"", "cannot be read as USD"),
        (b'#usda 1.0\n(metersPerUnit = 0)\ndef Xform "a" {}', "metersPerUnit is 0"),
        (
            b'#usda 1.0\n(timeCodesPerSecond = 0)\ndef Xform "a" {}',
            "has time codes 0 to 0, 0 per second, expected finite",
        ),
        (b'#usda 1.0\ndef Xform "a" {}', "has no triangles"),
    ],
)
def test_a_file_that_cannot_be_used_is_told_in_one_sentence(tmp_path, text, said):
    path = tmp_path / "bad.usda"
    path.write_bytes(text)
    with pytest.raises(InputError) as caught:
        load_world(path)
    assert str(caught.value).startswith(str(path)) and said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("counts", "indices", "point", "said"),
    [
        (4, [0, 1, 2], "(0, 0, 0)", "its polygons have 4 corners, and 3 are told"),
        (3, [0, 0, 0, 0], "(0, 0, 0)", "its polygons have 3 corners, and 4 are told"),
        (-3, [0, 1, 2], "(0, 0, 0)", "its polygons have -3 corners, and 3 are told"),
        (3, [0, 0, 1], "(0, 0, 0)", "a polygon names point 1, of 1"),
        (3, [0, -7, 0], "(0, 0, 0)", "a polygon names point -7, of 1"),
        (3, [0, 0, 0], "(0, 0, inf)", "it has a point that is not finite"),
    ],
)
def test_damaged_meshes_are_left_out_with_a_word(tmp_path, counts, indices, point, said):
    shape = f"int[] faceVertexCounts = [{counts}]\nint[] faceVertexIndices = {indices}\npoint3f[] points = [{point}]\n"
    world = load_world(usda(tmp_path, mesh() + mesh(name="bad", shape=shape)))
    assert [instance.name for instance in world.instances] == ["square"]
    assert any(f"bad is left out: {said}" in warning for warning in world.warnings)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (mesh(placed("double3 xformOp:translate = (inf, 0, 0)")), "/square stands at a place that is not finite"),
        (mesh() + 'def Camera "eye" { float focalLength = 0 }', "/eye has an aperture or a focal length"),
        (mesh() + 'def Camera "eye" { float verticalAperture = inf }', "/eye has an aperture or a focal length"),
        (mesh() + 'def SphereLight "bulb" { string inputs:radius = "wide" }', "/bulb has a value that cannot be used"),
        (mesh() + 'def SphereLight "bulb" { float inputs:radius = inf }', "/bulb has a radius that is not finite"),
        (mesh() + 'def SphereLight "bulb" { float inputs:color = 3 }', "/bulb has a value that cannot be used"),
        (mesh() + HOT, "/bulb has a value that cannot be used (a colour temperature of nan K)"),
        ('def Capsule "pill" { double radius = nan }', "/pill has a value that cannot be used (a radius of nan)"),
        (mesh('uniform token[] xformOpOrder = ["odd"]'), "/square has a value that cannot be used (Invalid xform op"),
        (mesh("rel material:binding = </red>") + RED, "/red has a value that cannot be used"),
        (mesh() + VANISHING, "/twice has other than its 2 copies' places at time 34"),
    ],
)
def test_prims_with_numbers_that_cannot_be_are_left_out_with_a_word(tmp_path, text, said):
    world = load_world(usda(tmp_path, mesh(name="whole") + text, TIMED))
    assert "whole" in [instance.name for instance in world.instances]
    assert sum(said in warning for warning in world.warnings) == 1
    assert all("\n" not in warning for warning in world.warnings)
    if not text.startswith(mesh()):  # and it alone is nothing, which says why
        with pytest.raises(InputError) as caught:
            load_world(usda(tmp_path, text, TIMED, "alone.usda"))
        assert said in str(caught.value) and "\n" not in str(caught.value)


def test_what_has_no_extent_is_told(tmp_path):
    with pytest.raises(InputError, match="has no extent"):
        load_world(usda(tmp_path, 'def Capsule "pill" { double radius = 0\n double height = 0 }', TIMED))


CASE = Path(__file__).resolve().parents[4] / "shared" / "cases" / "float_metres.usdc"


@pytest.mark.skipif(not CASE.is_file(), reason="the file is not beside this checkout")
def test_metres_may_be_float_for_double():
    """A file in which a number has another type than the schema's, as some exporters write it."""
    from pxr import Usd

    from clsim.scene.usd.stage import Stage

    told = Usd.Stage.Open(str(CASE)).GetMetadata("metersPerUnit")
    assert Stage(CASE, print).metres == pytest.approx(told)
    assert load_world(CASE).instances


def test_what_is_missing_or_hidden_is_not_there(tmp_path):
    text = mesh() + mesh('uniform token purpose = "guide"', "guide") + mesh('token visibility = "invisible"', "gone")
    text += mesh('uniform token purpose = "proxy"', "coarse") + mesh('uniform token purpose = "render"', "fine")
    text += f'def Xform "group" {{ token visibility = "invisible"\n{mesh()} }}\n'
    world = load_world(usda(tmp_path, text + 'def "lost" (references = @nowhere.usda@) {}'))
    assert [instance.name for instance in world.instances] == ["square", "fine"]
    assert any("nowhere.usda" in warning for warning in world.warnings)


def test_a_missing_file_is_told_once_however_many_prims_refer_to_it(tmp_path):
    prims = "".join(f'def "n{k}" (references = @nowhere.usda@) {{ }}\n' for k in range(9))
    world = load_world(usda(tmp_path, mesh() + prims + 'def "other" (references = @gone.usda@) { }\n'))
    assert [sum(name in warning for warning in world.warnings) for name in ("nowhere", "gone")] == [1, 1]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ('def Mesh "bare" {}', "bare has no faces that can be shown"),
        (mesh("int[] holeIndices = [0]"), "square has no faces that can be shown"),
        (mesh('token visibility = "invisible"'), "square is hidden, or a guide or a proxy"),
        (mesh('uniform token purpose = "guide"'), "square is hidden, or a guide or a proxy"),
        ('def BasisCurves "hair" { point3f[] points = [(0, 0, 0)] }', "BasisCurves is left out (first hair)"),
        ('def Scope "nothing" {}', "expected a mesh"),
    ],
)
def test_files_without_triangles_say_why(tmp_path, text, why):
    with pytest.raises(InputError) as caught:
        load_world(usda(tmp_path, text))
    assert "has no triangles" in str(caught.value) and why in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(("sides", "told"), [("uniform bool doubleSided = 0", True), ("", False)])
def test_faces_that_should_show_on_one_side_are_told(tmp_path, sides, told):
    world = load_world(usda(tmp_path, mesh(sides, "wall") + mesh(sides, "floor")))
    assert sum("doubleSided is false of wall" in note for note in world.notes) == told
    assert not any("doubleSided" in warning for warning in world.warnings)


@pytest.mark.parametrize("end", [13, 34])
def test_the_motion_of_an_asset_starts_over_however_short_it_is(tmp_path, end):
    """Without a camera of its own a file is an asset, whose motion repeats."""
    text = mesh(placed(f"double3 xformOp:translate.timeSamples = {{ 10: (0, 0, 0), {end}: (3, 2, 1) }}"))
    timed = f"{METRES}\n    startTimeCode = 10\n    endTimeCode = {end}\n    timeCodesPerSecond = 24"
    world = load_world(usda(tmp_path, text, timed))
    lasts_s = (end - 10) / 24
    assert world.duration_s == world.camera.motion.duration_s == ORBIT_S, "so often that the camera goes round once"
    assert world.environment == ENVIRONMENT and len(world.sphere_lights) == 1, "without lights of its own it has some"
    for time_s in (0.25 * lasts_s, 1.25 * lasts_s, 7.25 * lasts_s):
        np.testing.assert_allclose(world.instances[0].motion.pose(time_s)[:3, 3], (0.75, 0.5, 0.25), atol=1e-6)
