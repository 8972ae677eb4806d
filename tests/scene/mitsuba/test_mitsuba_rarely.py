"""What Mitsuba 3 does where few look, in numbers that it gives itself or that follow from its documents."""

import numpy as np
import PIL.Image
import pytest

from clsim.scene.mitsuba.scene import load_mitsuba
from tests.scene.mitsuba.mitsuba_files import TRIANGLE, load, material, scene

SPHERE = '<shape type="sphere">{}<emitter type="area"/></shape>'
MIRROR = '<transform name="to_world"><scale x="-2" y="2" z="2"/></transform>'
FLIP = '<boolean name="flip_normals" value="true"/>'


def camera(tmp_path, sensor):
    return load_mitsuba(scene(tmp_path, sensor + '<shape type="cube"/>')).camera


@pytest.mark.parametrize(("told", "focus_m"), [("", 10_000), ('<float name="far_clip" value="70"/>', 70)])
def test_a_thin_lens_is_sharp_where_its_sight_ends_unless_told(tmp_path, told, focus_m):
    lens = '<float name="aperture_radius" value="0.1"/>'
    sensor = f'<sensor type="thinlens"><float name="fov" value="50"/>{lens}{told}</sensor>'
    assert camera(tmp_path, sensor).lens.focus_distance_m == focus_m


@pytest.mark.parametrize(
    ("origin", "up"),
    [("0 0 5", (1, 0, 0)), ("0 0 -5", (1, 0, 0)), ("0 5 0", (1, 0, 0)), ("1 2 5", (0.982574, -0.034852, -0.182574))],
)
def test_a_view_without_an_up_has_mitsubas(tmp_path, origin, up):
    place = f'<transform name="to_world"><lookat origin="{origin}" target="0 0 0"/></transform>'
    pose = camera(tmp_path, f'<sensor type="perspective"><float name="fov" value="50"/>{place}</sensor>').motion.pose(0)
    np.testing.assert_allclose(pose[:3, 1], up, atol=1e-4)


@pytest.mark.parametrize("flip", ["", FLIP])
@pytest.mark.parametrize("place", ["", MIRROR])
@pytest.mark.parametrize("normals", [False, True])
def test_pictures_lie_on_meshes_without_coordinates_by_their_corners(tmp_path, flip, place, normals):
    """A triangle's corners have u and v, v down, of (0, 0), (1, 0) and (0, 1)."""
    text = TRIANGLE if not normals else TRIANGLE.replace("f 1 2 3", "vn 0 0 1\nf 1//1 2//1 3//1")
    (tmp_path / "a.obj").write_text(text)
    PIL.Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(tmp_path / "a.png")
    picture = '<texture type="bitmap" name="reflectance"><string name="filename" value="a.png"/></texture>'
    shape = f'<shape type="obj"><string name="filename" value="a.obj"/>{flip}{place}{{}}</shape>'
    world = load(tmp_path, shape.format(f'<bsdf type="diffuse">{picture}</bsdf>'))
    mesh, sign = world.meshes[0], -2 if place else 1
    found = {tuple(map(float, at[:2])): tuple(map(float, uv)) for at, uv in zip(mesh.vertices, mesh.uvs, strict=True)}
    assert found == {(0, 0): (0, 1), (sign, 0): (1, 1), (0, abs(sign)): (0, 0)}
    assert load(tmp_path, shape.format('<bsdf type="diffuse"/>')).meshes[0].uvs is None


@pytest.mark.parametrize(
    ("inner", "color"),
    [
        ('<rgb name="color" value="1 .5 .25"/>', (1, 0.5, 0.25)),
        ('<rgb name="color" value="1 .5 .25"/><float name="scale" value="4"/>', (4, 2, 1)),
    ],
)
def test_daylight_may_be_coloured(tmp_path, inner, color):
    point = f'<emitter type="point"><spectrum name="intensity" type="d65">{inner}</spectrum></emitter>'
    assert load(tmp_path, point + '<shape type="cube"/>').punctual_lights[0].intensity == pytest.approx(color)


@pytest.mark.parametrize(
    ("told", "version", "outwards"),
    [(MIRROR, "3.0.0", False), (MIRROR + FLIP, "3.0.0", True), (FLIP, "3.0.0", False), (MIRROR, "0.6.0", True)],
)
def test_a_mirrored_sphere_is_inside_out_since_version_3(tmp_path, told, version, outwards):
    world = load(tmp_path, '<shape type="cube"/>' + SPHERE.format(told), version)
    assert len(world.sphere_lights) == outwards
    plain = load(tmp_path, SPHERE.format(told).replace('<emitter type="area"/>', ""), version).meshes[0]
    a, b, c = np.moveaxis(plain.vertices.astype(float)[plain.triangles], 1, 0)
    assert ((np.sum(np.cross(b - a, c - a) * (a + b + c), axis=1) > 0) == outwards).all()
    assert ((np.sum(plain.normals * plain.vertices, axis=1) > 0) == outwards).all()


def test_what_a_normal_map_says_of_itself_is_no_cause_for_a_warning(tmp_path):
    """Mitsuba asks for raw pictures of normals."""
    PIL.Image.fromarray(np.full((2, 2, 3), 128, np.uint8)).save(tmp_path / "a.png")
    raw = '<string name="filename" value="a.png"/><boolean name="raw" value="true"/>'
    picture = f'<texture type="bitmap" name="normalmap">{raw}</texture>'
    found, world = material(tmp_path, f'<bsdf type="normalmap">{picture}<bsdf type="diffuse"/></bsdf>')
    assert found.normal_texture >= 0 and world.warnings == ()


def test_what_is_defined_within_something_further_down_may_be_referred_to(tmp_path):
    red = '<bsdf type="diffuse" id="red"><rgb name="reflectance" value="1 0 0"/></bsdf>'
    world = load(tmp_path, f'<shape type="cube"><ref id="red"/></shape><shape type="sphere">{red}</shape>')
    assert [world.materials[mesh.material_ids[0]].color for mesh in world.meshes] == [(1, 0, 0)] * 2


def test_a_metal_whose_index_is_a_picture_has_its_mean(tmp_path):
    squares = '<texture type="checkerboard" name="{}"><float name="color0" value="0.2"/>'
    squares += '<float name="color1" value="0.6"/></texture>'
    found, world = material(tmp_path, f'<bsdf type="conductor">{squares.format("eta")}{squares.format("k")}</bsdf>')
    assert found.eta == pytest.approx((0.4,) * 3, abs=2e-3) and found.k == pytest.approx((0.4,) * 3, abs=2e-3)
    assert len(world.warnings) == 2


@pytest.mark.parametrize(
    ("name", "told"), [('name="diffuse_reflectance"', "diffuse_reflectance"), ("", "without a name")]
)
def test_textures_that_nothing_reads_are_told(tmp_path, name, told):
    PIL.Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(tmp_path / "a.png")
    picture = f'<texture type="bitmap" {name}><string name="filename" value="a.png"/></texture>'
    _, world = material(tmp_path, f'<bsdf type="diffuse">{picture}</bsdf>')
    assert world.warnings == (f"scene.xml: the texture {told} of a diffuse bsdf is left out",)


@pytest.mark.parametrize(("version", "name"), [("3.0.0", "hide_emitters"), ("0.6.0", "hideEmitters")])
@pytest.mark.parametrize(("value", "told"), [("true", 1), ("false", 0)])
def test_an_integrator_that_hides_what_emits_is_told(tmp_path, version, name, value, told):
    integrator = f'<integrator type="path"><boolean name="{name}" value="{value}"/></integrator>'
    warnings = load(tmp_path, integrator + '<shape type="cube"/>', version).warnings
    assert list(warnings) == ["scene.xml: what emits is seen, though the integrator hides it"] * told


@pytest.mark.parametrize(
    ("inside", "told"),
    [
        ('<shape type="instance"><ref id="a"/></shape>', "shapes of type instance are left out"),
        ('<emitter type="area"/>', "emitters within groups are left out, as Mitsuba has none"),
    ],
)
def test_what_mitsuba_does_not_permit_within_groups_is_left_out_with_a_word(tmp_path, inside, told):
    groups = '<shape type="shapegroup" id="a"><shape type="cube"/></shape>'
    if "instance" in inside:
        groups += f'<shape type="shapegroup" id="b">{inside}<shape type="disk"/></shape>'
    else:
        groups += f'<shape type="shapegroup" id="b"><shape type="disk">{inside}</shape></shape>'
    world = load(tmp_path, groups + '<shape type="instance"><ref id="b"/></shape>')
    assert len(world.instances) == 1
    assert world.warnings == (f"scene.xml: {told}",)


def test_what_lies_around_a_cylinder_begins_where_it_does_in_mitsuba(tmp_path):
    """Along −z, its frame is x, −y and −z (Duff et al., JCGT 2017): u grows from +x over −y."""
    ends = '<point name="p0" x="0" y="0" z="0"/><point name="p1" x="0" y="0" z="-2"/>'
    (mesh,) = load(tmp_path, f'<shape type="cylinder">{ends}</shape>').meshes
    x, y, z = mesh.vertices.T
    u, v = mesh.uvs.T
    np.testing.assert_allclose(np.cos(2 * np.pi * u), x, atol=1e-6)
    np.testing.assert_allclose(np.sin(2 * np.pi * u), -y, atol=1e-6)
    np.testing.assert_allclose(1 - v, -z / 2, atol=1e-6)  # Mitsuba's v points down here


@pytest.mark.parametrize("shape", ["obj", "sphere"])
def test_a_mirrored_shape_faces_the_same_way_within_a_group(tmp_path, shape):
    (tmp_path / "a.obj").write_text(TRIANGLE)
    file = '<string name="filename" value="a.obj"/>' if shape == "obj" else ""
    mirrored = f'<shape type="{shape}">{file}{MIRROR}</shape>'
    group = f'<shape type="shapegroup" id="g">{mirrored}</shape><shape type="instance"><ref id="g"/></shape>'
    facing = []
    for body in (mirrored, group):
        world = load(tmp_path, body)
        mesh, pose = world.meshes[world.instances[0].mesh], world.instances[0].motion.pose(0.0)
        a, b, c = np.moveaxis((mesh.vertices @ pose[:3, :3].T)[mesh.triangles].astype(float), 1, 0)
        facing.append(np.cross(b - a, c - a))
    np.testing.assert_allclose(*facing, atol=1e-6)


def test_that_one_of_several_bsdfs_is_used_is_told(tmp_path):
    """Version 0.6 has one for each material of an OBJ; version 3 permits one alone."""
    color = '<bsdf type="diffuse" name="m"><rgb name="reflectance" value="{}"/></bsdf>'
    found, world = material(tmp_path, color.format("1 0 0") + color.format("0 1 0"))
    assert found.color == (1, 0, 0)
    assert world.warnings == ("scene.xml: the first of several bsdfs of a shape is used",)


@pytest.mark.parametrize(("told", "stretch"), [(0.0, 1.0), (0.5, 0.55**-0.5), (1.0, 0.1**-0.5)])
def test_what_is_brushed_is_narrower_across_by_disneys_aspect(tmp_path, told, stretch):
    """√(1 − 0.9 · anisotropic): never a line."""
    found, _ = material(tmp_path, f'<bsdf type="principled"><float name="anisotropic" value="{told}"/></bsdf>')
    assert found.stretch == pytest.approx(stretch)


def test_a_picture_of_a_principled_surface_tells_the_root_of_alpha(tmp_path):
    """As ours does: what is told is kept."""
    PIL.Image.fromarray(np.array([[64, 200]], np.uint8)).save(tmp_path / "a.png")
    told = '<string name="filename" value="a.png"/><boolean name="raw" value="true"/>'
    rough = f'<texture type="bitmap" name="roughness">{told}</texture>'
    found, world = material(tmp_path, f'<bsdf type="principled">{rough}</bsdf>')
    assert found.alpha == 1.0 and world.textures[found.roughness_texture].pixels[0, :, 1].tolist() == [64, 200]
