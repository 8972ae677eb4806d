"""USD value by value: shapes, primvars, lamps and textures against usd-core and the schemas' own sentences."""

import math

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdLux

from clsim.errors import InputError
from clsim.scene import load_world
from tests.scene.usd.usd_files import CAMERA, METRES, SQUARE, TIMED, mesh, placed, usda


def world_of(tmp_path, text, meta=METRES):
    return load_world(usda(tmp_path, f"{text}\n{CAMERA}", meta))


def outward(tmp_path, text):
    """Return the sum of the triangles' normals, as long as twice their area."""
    found = world_of(tmp_path, text).meshes[0]
    a, b, c = found.vertices[found.triangles].astype(np.float64).transpose(1, 0, 2)
    return np.cross(b - a, c - a).sum(axis=0)


@pytest.mark.parametrize(
    "extra", ["", 'float2[] primvars:st = [(0,0), (1,0), (1,1), (0,1)] (interpolation = "faceVarying")']
)
def test_left_handed_faces_look_the_other_way(tmp_path, extra):
    """UsdGeom: orientation says by which hand the normal of a face's points is told."""
    told = ("", '\nuniform token orientation = "leftHanded"')
    right, left = (outward(tmp_path, mesh(extra + hand)) for hand in told)
    assert right == pytest.approx((0, 8, 0)) and left == pytest.approx(-right)


@pytest.mark.parametrize(
    ("scheme", "told"), [("none", True), ("bilinear", True), ("catmullClark", False), ("loop", False)]
)
def test_normals_of_what_shall_be_subdivided_do_not_count(tmp_path, scheme, told):
    """UsdGeomMesh: normals that are told are not used while a mesh is subdivided; what is bilinear bends nowhere."""
    shape = SQUARE.replace('"none"', f'"{scheme}"')
    tilted = "normal3f[] normals = [(0.6, 0.8, 0), (0.6, 0.8, 0), (0.6, 0.8, 0), (0.6, 0.8, 0)]"
    world = world_of(tmp_path, mesh(tilted, shape=shape))
    np.testing.assert_allclose(world.meshes[0].normals, [(0.6, 0.8, 0) if told else (0, 1, 0)] * 4, atol=1e-6)
    assert any("subdivided" in warning for warning in world.warnings) is not told


def test_what_shall_be_subdivided_is_smooth_at_all_times_though_coordinates_split_its_corners(tmp_path):
    """A sheet that is folded into a roof: at its ridge the normal is the mean of both sides', else a side's."""
    shape = """
    int[] faceVertexCounts = [4, 4]
    int[] faceVertexIndices = [0, 1, 4, 5, 1, 2, 3, 4]
    point3f[] points.timeSamples = { 10: [(-1,0,0), (0,0,0), (1,0,0), (1,1,0), (0,1,0), (-1,1,0)],
        34: [(-1,0,-1), (0,0,0), (1,0,-1), (1,1,-1), (0,1,0), (-1,1,-1)] }
    texCoord2f[] primvars:st = [(0,0), (1,0), (1,1), (0,1), (0,0), (1,0), (1,1), (0,1)] (interpolation = "faceVarying")
    """
    world = world_of(tmp_path, mesh(shape=shape), TIMED)
    (found,) = world.meshes
    np.testing.assert_allclose(found.normals, [(0, 0, 1)] * len(found.normals), atol=1e-6)
    vertices, normals = found.deformation.vertices_at(1.0)
    np.testing.assert_allclose(normals[:, 0], vertices[:, 0] * math.sqrt(0.5), atol=1e-6)
    assert (normals[:, 2] > 0.7).all()


@pytest.mark.parametrize("name", ["normals", "primvars:normals"])
@pytest.mark.parametrize("interpolation", ["vertex", "faceVarying"])
def test_normals_that_move_with_the_points_are_those_of_the_time(tmp_path, name, interpolation):
    away = [(0, 1, 0), (0.6, 0.8, 0)]
    samples = ", ".join(
        f"{code}: [{', '.join([str(normal)] * 4)}]" for code, normal in zip((10, 34), away, strict=True)
    )
    points = (
        "10: [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], 34: [(-1, 1, 1), (1, 0, 1), (1, 0, -1), (-1, 1, -1)]"
    )
    told = f'normal3f[] {name} (interpolation = "{interpolation}")\nnormal3f[] {name}.timeSamples = {{ {samples} }}\n'
    if name == "primvars:normals":  # which count before those without the word
        told += "normal3f[] normals = [(1, 0, 0), (1, 0, 0), (1, 0, 0), (1, 0, 0)]\n"
    moving = mesh(f"{told}point3f[] points.timeSamples = {{ {points} }}")
    (found,) = world_of(tmp_path, moving, TIMED).meshes
    np.testing.assert_allclose(found.normals, [away[0]] * len(found.normals))
    for time_s, expected in ((0.0, away[0]), (0.5, (0.3, 0.9, 0)), (1.0, away[1])):
        _, normals = found.deformation.vertices_at(time_s)
        np.testing.assert_allclose(normals, [np.divide(expected, np.linalg.norm(expected))] * len(normals), atol=1e-6)


def test_holes_are_faces_by_their_number_and_the_rest_stays(tmp_path):
    """Of a quad, a triangle and a quad, of which each is a hole in turn, or two are."""
    points = "[(0,0,0), (1,0,0), (1,1,0), (0,1,0), (2,0,0), (3,0,0), (2,1,0), (4,0,0), (7,0,0), (7,1,0), (4,1,0)]"
    areas = {0: 1.0, 1: 0.5, 2: 3.0}
    for holes in ([0], [1], [2], [0, 2]):
        shape = f"""
        int[] faceVertexCounts = [4, 3, 4]
        int[] faceVertexIndices = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10]
        int[] holeIndices = {holes}
        point3f[] points = {points}
        uniform token subdivisionScheme = "none"
        """
        found = outward(tmp_path, mesh(shape=shape))
        assert found[2] / 2 == pytest.approx(sum(area for face, area in areas.items() if face not in holes))


def test_a_file_that_was_changed_is_read_again(tmp_path):
    """In a session that goes on: the file itself, and one that it refers to."""
    scene = 'def "whole" (references = @part.usda@</square>) {}\n' + CAMERA
    for size in (1.0, 3.0):
        sized = mesh(placed(f"float3 xformOp:scale = ({size}, 1, 1)"))
        usda(tmp_path, sized, name="part.usda")
        for name, text in (("alone.usda", sized + CAMERA), ("scene.usda", scene)):
            world = load_world(usda(tmp_path, text, name=name))
            vertices, pose = world.meshes[world.instances[0].mesh].vertices, world.instances[0].motion.pose(0.0)
            assert np.ptp(vertices @ pose[:3, :3].T, axis=0)[0] == pytest.approx(2 * size), name
    (tmp_path / "alone.usda").write_text("#usda 1.0\n(")
    with pytest.raises(InputError, match=r"alone\.usda: cannot be read as USD"):
        load_world(tmp_path / "alone.usda")


@pytest.mark.parametrize("indexed", [False, True])
@pytest.mark.parametrize("interpolation", ["constant", "uniform", "vertex", "faceVarying"])
def test_primvars_reach_the_corners_that_usd_gives_them(tmp_path, interpolation, indexed):
    """Of two faces; usd-core spreads values of all interpolations but these, which its documentation defines."""
    count = {"constant": 1, "uniform": 2, "vertex": 6, "faceVarying": 7}[interpolation]
    values = [(k / 10, 1 - k / 10) for k in range(count)]
    indices = f"int[] primvars:st:indices = {list(range(count))[::-1]}" if indexed else ""
    shape = f"""
    int[] faceVertexCounts = [4, 3]
    int[] faceVertexIndices = [0, 1, 2, 3, 1, 4, 5]
    point3f[] points = [(0,0,0), (1,0,0), (1,1,0), (0,1,0), (2,0,0), (2,1,0)]
    uniform token subdivisionScheme = "none"
    texCoord2f[] primvars:st = {values[::-1] if indexed else values} (interpolation = "{interpolation}")
    {indices}
    """
    found = world_of(tmp_path, mesh(shape=shape)).meshes[0]
    corners = [(0, 0), (0, 1), (0, 2), (0, 3), (1, 1), (1, 4), (1, 5)]  # face and point
    places = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (2, 0), (2, 1)])
    expected = set()
    for k, (face, point) in enumerate(corners):
        at = {"constant": 0, "uniform": face, "vertex": point, "faceVarying": k}[interpolation]
        expected.add((*map(float, places[point]), *values[at]))
    rows = np.column_stack([found.vertices[:, :2], found.uvs]).astype(np.float64)
    seen = {tuple(np.round(rows[at], 5).tolist()) for at in found.triangles.ravel()}
    assert seen == {tuple(round(v, 5) for v in each) for each in expected}


@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
@pytest.mark.parametrize(
    ("kind", "sizes"),
    [
        ("Cube", {"size": 3.0}),
        ("Sphere", {"radius": 0.7}),
        ("Cylinder", {"radius": 0.5, "height": 3.0}),
        ("Cone", {"radius": 0.5, "height": 3.0}),
        ("Capsule", {"radius": 0.5, "height": 3.0}),
        ("Plane", {"width": 3.0, "length": 1.0}),
    ],
)
def test_bodies_reach_as_far_as_usd_says(tmp_path, kind, sizes, axis):
    """By usd-core's own extents, along each axis; a cone's tip is at the positive end."""
    told = "\n".join(f"double {name} = {value}" for name, value in sizes.items())
    told += "" if kind in ("Cube", "Sphere") else f'\nuniform token axis = "{axis}"'
    path = usda(tmp_path, f'def {kind} "body" {{ {told}\ncolor3f[] primvars:displayColor = [(1, 2, 0)] }}\n' + CAMERA)
    world = load_world(path)
    found = world.meshes[0]
    assert world.materials[found.material_ids[0]].color == (1, 1, 0), "and it has its own colour"
    stage = Usd.Stage.Open(str(path))
    body = UsdGeom.Boundable(stage.GetPrimAtPath("/body"))
    extent = np.array(UsdGeom.Boundable.ComputeExtentFromPlugins(body, Usd.TimeCode.Default()))
    reach = np.array([found.vertices.min(axis=0), found.vertices.max(axis=0)])
    np.testing.assert_allclose(reach, extent, atol=0.003)
    if kind == "Cone":
        tip = "XYZ".index(axis)
        assert np.delete(found.vertices[found.vertices[:, tip] > 1.49], tip, axis=1) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(("exposure", "intensity"), [(0, 1.0), (3, 0.5), (-2, 8.0), (20, 1e-5), (0, -2.0)])
def test_exposure_counts_in_stops(tmp_path, exposure, intensity):
    """UsdLux: intensity · 2^exposure · colour; none takes light away."""
    told = (
        f"float inputs:exposure = {exposure}\nfloat inputs:intensity = {intensity}\ncolor3f inputs:color = (1, .5, 0)"
    )
    (lamp,) = world_of(tmp_path, mesh() + f'def SphereLight "lamp" {{ {told} }}\n').sphere_lights
    assert lamp.radiance == pytest.approx(tuple(max(intensity, 0) * 2.0**exposure * c for c in (1, 0.5, 0)))


@pytest.mark.parametrize("kelvin", [None, 3000.0, 9000.0])
def test_temperatures_are_usd_cores_and_6500_kelvin_where_none_is_told(tmp_path, kelvin):
    told = "bool inputs:enableColorTemperature = 1" + (
        "" if kelvin is None else f"\nfloat inputs:colorTemperature = {kelvin}"
    )
    (lamp,) = world_of(tmp_path, mesh() + f'def SphereLight "lamp" {{ {told} }}\n').sphere_lights
    expected = UsdLux.BlackbodyTemperatureAsRgb(6500.0 if kelvin is None else kelvin)
    assert lamp.radiance == pytest.approx(tuple(expected))


@pytest.mark.parametrize("degrees", [0.53, 4.0, 80.0])
def test_a_distant_light_fills_its_angle(tmp_path, degrees):
    """UsdLux: the angular diameter; seen from the middle of what it lights, its sphere is half of it about its axis."""
    sun = f'def DistantLight "sun" {{ float inputs:angle = {degrees} }}\n'
    (lamp,) = world_of(tmp_path, mesh() + sun).sphere_lights
    place = lamp.motion.pose(0.0)[:3, 3]
    assert math.degrees(math.asin(lamp.radius_m / np.linalg.norm(place))) == pytest.approx(degrees / 2, rel=1e-6)
    assert place / np.linalg.norm(place) == pytest.approx((0, 0, 1), abs=1e-6), "it shines along −z"
    assert np.linalg.norm(place) > 1e3, "from so far that its direction is the same all over the square"


def test_light_of_which_two_things_change_is_their_product(tmp_path):
    """A line times a line: half of the way, half of a half."""
    lamp = """def SphereLight "bulb" { float inputs:intensity.timeSamples = { 10: 0, 34: 4 }
        color3f inputs:color.timeSamples = { 10: (0, 1, 1), 34: (1, 1, 0) } }"""
    (bulb,) = world_of(tmp_path, mesh() + lamp, TIMED).sphere_lights
    for time_s in (0.0, 0.25, 0.5, 1.0):
        seen = np.multiply(bulb.radiance, bulb.modulation.mean(time_s, time_s))
        np.testing.assert_allclose(seen, 4 * time_s * np.array((time_s, 1, 1 - time_s)), atol=0.02)


def test_a_lamp_that_is_scaled_has_the_area_of_its_scaled_sphere(tmp_path):
    told = "float inputs:radius = 0.5\nfloat inputs:intensity = 6\nbool inputs:normalize = 1\n"
    lamp = f'def SphereLight "bulb" {{ {told}{placed("float3 xformOp:scale = (3, 3, -3)")} }}'
    (bulb,) = world_of(tmp_path, mesh() + lamp).sphere_lights
    assert bulb.radius_m == pytest.approx(1.5)
    assert bulb.radiance == pytest.approx((6 / (4 * math.pi * 1.5**2),) * 3)


def test_what_resets_the_transforms_above_it_stands_still_below_what_moves(tmp_path):
    """UsdGeomXformable: ``!resetXformStack!`` leaves out all that comes from its parents."""
    own = placed("double3 xformOp:translate = (1, 2, 3)")
    reset = own.replace("[", '["!resetXformStack!", ', 2).replace('token["!resetXformStack!", ]', "token[]", 1)
    moving = placed("double3 xformOp:translate.timeSamples = { 10: (0, 0, 0), 34: (5, 0, 0) }")
    bodies = f'def Xform "cart" {{ {moving} {mesh(own, "follows")} {mesh(reset, "stays")} }}'
    world = world_of(tmp_path, bodies, TIMED)
    follows, stays = (next(i for i in world.instances if i.name.endswith(name)) for name in ("follows", "stays"))
    assert follows.motion.duration_s == 1 and stays.motion.duration_s == 0
    assert stays.motion.pose(0.5)[:3, 3] == pytest.approx((1, 2, 3))


def test_points_beside_one_that_is_nowhere_keep_their_own_widths_and_colours(tmp_path):
    points = """def Points "dust" {
        point3f[] points = [(0, 0, 0), (nan, 0, 0), (5, 0, 0)]
        float[] widths = [0.5, 7, 1.5]
        color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1)] (interpolation = "vertex") }"""
    world = world_of(tmp_path, points)
    (dust,) = world.meshes
    first, second = np.split(dust.vertices, 2)
    assert (first[:, 0].min(), first[:, 0].max()) == pytest.approx((-0.25, 0.25))
    assert (second[:, 0].min(), second[:, 0].max()) == pytest.approx((4.25, 5.75))
    one = points.replace("[0.5, 7, 1.5]", "[0.5]")
    assert np.ptp(np.split(world_of(tmp_path, one).meshes[0].vertices, 2)[1][:, 0]) == pytest.approx(0.5), "one for all"
    np.testing.assert_array_equal(dust.colors[:: len(first)], [(1, 0, 0), (0, 0, 1)])
    assert not world.warnings


def test_points_of_which_some_are_shown_have_their_own_widths_and_colours(tmp_path, monkeypatch):
    points = """def Points "dust" { point3f[] points = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (5, 0, 0), (9, 0, 0)]
        float[] widths = [0.5, 7, 7, 1.5, 7]
        color3f[] primvars:displayColor = [(1, 0, 0), (1, 1, 1), (0, 0, 1), (0, 1, 0), (1, 1, 1)] (
            interpolation = "vertex") }"""
    monkeypatch.setattr("clsim.scene.usd.points.MOST_POINTS", 5)
    assert not world_of(tmp_path, points).warnings
    monkeypatch.setattr("clsim.scene.usd.points.MOST_POINTS", 2)
    world = world_of(tmp_path, points)
    (dust,) = world.meshes
    assert world.warnings == ("scene.usda: of the points of dust one in 3 is shown: they are 5",)
    first, second = np.split(dust.vertices[:, 0], 2)
    np.testing.assert_array_equal(dust.colors[:: len(first)], [(1, 0, 0), (0, 1, 0)])
    assert (first.min(), first.max(), second.min(), second.max()) == pytest.approx((-0.25, 0.25, 4.25, 5.75))


def test_points_are_small_spheres(tmp_path):
    """With their widths and colours; where they tell no width, apart from each other."""
    body = """def Points "dots" {
        point3f[] points = [(0, 0, 0), (3, 0, 0), (0, 3, 0)]
        float[] widths = [0.2, 0.4, 1.0]
        color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1)] (interpolation = "vertex") }
    """
    world = load_world(usda(tmp_path, body))
    (made,) = world.meshes
    thirds = np.split(made.vertices, 3)
    for vertices, centre, width in zip(thirds, [(0, 0, 0), (3, 0, 0), (0, 3, 0)], (0.2, 0.4, 1.0), strict=True):
        np.testing.assert_allclose(np.linalg.norm(vertices - centre, axis=1), width / 2, rtol=1e-5)
    np.testing.assert_array_equal(made.colors[:: len(thirds[0])], np.eye(3))
    assert world.materials[made.material_ids[0]].color == (1, 1, 1) and not world.warnings
    bare = load_world(usda(tmp_path, body.replace("float[] widths = [0.2, 0.4, 1.0]", ""), name="bare.usda"))
    # Spread evenly, three points in a box of 3 m would be 3 / ³√3 m apart.
    np.testing.assert_allclose(np.ptp(np.split(bare.meshes[0].vertices, 3)[0][:, 0]), 0.3 * 3 / 3 ** (1 / 3), rtol=1e-5)
    assert bare.warnings == ("bare.usda: points of dots tell no widths: they are 0.624 wide",)
