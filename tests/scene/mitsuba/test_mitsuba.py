"""Mitsuba's XML: what its scenes, shapes, cameras and lights become."""

from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.mitsuba.scene import load_mitsuba
from tests.scene.mitsuba.mitsuba_files import SENSOR, TRIANGLE, load, scene, whole

ROOM = Path(__file__).resolve().parents[4] / "shared" / "assets" / "mitsuba" / "living-room"


@pytest.mark.skipif(not ROOM.is_dir(), reason="the real scenes are not beside this checkout")
@pytest.mark.parametrize(("name", "warnings"), [("scene.xml", 1), ("scene_mi3.xml", 0)])
def test_the_living_room_loads_complete(name, warnings):
    world = load_world(ROOM / name)
    assert len(world.instances) == 65
    assert sum(len(mesh.triangles) for mesh in world.meshes) == 143_163
    assert len(world.warnings) == warnings
    assert world.environment_map.radiance.shape == (1024, 2048, 3)
    kinds = {m.kind for m in world.materials}
    assert kinds == {"diffuse", "plastic", "conductor", "dielectric"}
    assert sum(m.alpha_mode == "blend" for m in world.materials) == 1
    assert len(world.textures) == 5 - 1 + 1  # three of wood and paint, the leaf as colour and as opacity
    steel = next(m for m in world.materials if m.alpha == 0.02)
    assert (steel.eta, steel.k) == ((1.65746, 0.880369, 0.521229), (9.22387, 6.26952, 4.837))
    mirror = next(m for m in world.materials if m.kind == "conductor" and m.alpha == 0)
    assert mirror.eta is None and mirror.color == (1, 1, 1)
    assert any("circles" in note for note in world.notes)


def test_still_scenes_get_a_small_closed_motion_that_keeps_looking_at_one_point(tmp_path):
    body = '<shape type="rectangle"><transform name="to_world"><translate z="5"/></transform></shape>'
    world = load_world(scene(tmp_path, SENSOR + '<emitter type="constant"/>' + body))
    start, motion = load(tmp_path, body).camera.motion.pose(0), world.camera.motion
    np.testing.assert_allclose(motion.pose(0), start, atol=1e-12)
    np.testing.assert_allclose(motion.pose(world.duration_s), start, atol=1e-12)
    for time_s in (0.3, 1.0, 1.7):
        pose = motion.pose(time_s)
        assert 0.01 < np.linalg.norm(pose[:3, 3] - start[:3, 3]) <= 0.3 + 1e-9  # 3 % of 5 m, there and back
        x, y, z, _ = np.linalg.inv(pose) @ (0, 0, 5, 1)
        assert (x, y) == pytest.approx((0, 0), abs=1e-9) and z < -4.9
    assert "5 m ahead" in world.notes[0]
    assert not world.warnings


def test_transforms_apply_in_order(tmp_path):
    steps = '<scale value="2"/><rotate z="1" angle="90"/><translate x="10" y="1"/>'
    world = load(tmp_path, f'<shape type="cube"><transform name="to_world">{steps}</transform></shape>')
    pose = world.instances[0].motion.pose(0)
    np.testing.assert_allclose(pose @ (1, 0.5, 0, 1), (10 - 1, 1 + 2, 0, 1), atol=1e-12)


def test_version_0_6_spells_its_parameters_its_own_way(tmp_path):
    bsdf = '<bsdf type="plastic"><float name="intIOR" value="1.8"/><float name="extIOR" value="1.2"/></bsdf>'
    place = '<transform name="toWorld"><lookAt origin="0,0,3" target="0,0,9"/></transform>'
    body = f'<shape type="cube">{bsdf}{place}</shape>'
    world = load(tmp_path, body, "0.6.0")
    assert world.materials[0].ior == pytest.approx(1.5)
    np.testing.assert_allclose(world.instances[0].motion.pose(0)[:3, 3], (0, 0, 3))


def test_parameters_references_and_includes(tmp_path):
    (tmp_path / "part.xml").write_text(
        whole('<bsdf type="diffuse" id="red"><rgb name="reflectance" value="$red, 0, 0"/></bsdf>')
    )
    body = (
        '<default name="red" value="0.25"/><include filename="part.xml"/>'
        '<shape type="cube"><ref id="red"/></shape><shape type="disk"><ref id="red"/></shape>'
    )
    world = load(tmp_path, body)
    assert [m.color for m in world.materials] == [(0.25, 0, 0)]


def test_a_file_that_an_included_file_names_lies_beside_the_scene(tmp_path):
    """As in Mitsuba, whatever the folder of the included file."""
    (tmp_path / "parts").mkdir()
    grey = '<bsdf type="diffuse"><spectrum name="reflectance" filename="grey.spd"/></bsdf>'
    (tmp_path / "parts" / "part.xml").write_text(whole(f'<shape type="cube">{grey}</shape>'))
    (tmp_path / "grey.spd").write_text("300 0.3\n900 0.3\n")
    assert load(tmp_path, '<include filename="parts/part.xml"/>').materials[0].color == pytest.approx((0.3, 0.3, 0.3))


def test_lights(tmp_path):
    body = """
        <emitter type="point"><point name="position" x="1" y="2" z="3"/><rgb name="intensity" value="4"/></emitter>
        <emitter type="spot"><transform name="to_world"><lookat origin="0,5,0" target="0,0,0" up="1,0,0"/></transform>
          <float name="cutoff_angle" value="40"/></emitter>
        <emitter type="directional"><vector name="direction" x="1" y="-1" z="0"/></emitter>
        <shape type="sphere"><point name="center" x="1" y="0" z="0"/><float name="radius" value="0.5"/>
          <transform name="to_world"><scale value="2"/></transform>
          <emitter type="area"><rgb name="radiance" value="1,2,3"/></emitter></shape>
        <shape type="rectangle"><bsdf type="twosided"><bsdf type="diffuse"/></bsdf>
          <emitter type="area"><float name="radiance" value="7"/></emitter></shape>
    """
    world = load(tmp_path, body)
    point, spot, sun = world.punctual_lights
    assert point.intensity == (4, 4, 4)
    np.testing.assert_allclose(point.motion.pose(0)[:3, 3], (1, 2, 3))
    np.testing.assert_allclose(-spot.motion.pose(0)[:3, 2], (0, -1, 0), atol=1e-12)
    assert (spot.inner_deg, spot.outer_deg, spot.falloff) == (30, 40, "linear")
    np.testing.assert_allclose(-sun.motion.pose(0)[:3, 2], np.array((1, -1, 0)) / np.sqrt(2), atol=1e-12)
    (ball,) = world.sphere_lights
    assert (ball.radius_m, ball.radiance) == (1.0, (1, 2, 3))
    np.testing.assert_allclose(ball.motion.pose(0)[:3, 3], (2, 0, 0))
    (lamp,) = (m for m in world.materials if any(m.emission))
    assert (lamp.emission, lamp.emits_behind, lamp.back) == ((7, 7, 7), False, "same")


def test_stretched_shapes_and_instances_stand_where_they_should(tmp_path):
    body = """
        <shape type="shapegroup" id="g"><shape type="cube"/></shape>
        <shape type="instance"><ref id="g"/><transform name="to_world"><translate x="9"/></transform></shape>
        <shape type="instance"><ref id="g"/><transform name="to_world"><scale x="3"/></transform></shape>
        <shape type="cube"><transform name="to_world"><scale x="-1" y="2"/></transform></shape>
    """
    world = load(tmp_path, body)
    assert len(world.instances) == 3
    boxes = []
    for instance in world.instances:
        mesh, pose = world.meshes[instance.mesh], instance.motion.pose(0)
        points = mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
        boxes.append((points.min(axis=0).tolist(), points.max(axis=0).tolist()))
        a, b, c = (points[mesh.triangles[:, k]] for k in range(3))
        outwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), (a + b + c) / 3 - pose[:3, 3])
        assert (outwards > 0).all()
    assert boxes == [([8, -1, -1], [10, 1, 1]), ([-3, -1, -1], [3, 1, 1]), ([-1, -2, -1], [1, 2, 1])]


def test_animated_cameras_follow_their_transforms(tmp_path):
    sensor = """<sensor type="perspective"><float name="fov" value="60"/><animation name="toWorld">
        <transform time="0"><translate x="0"/></transform><transform time="2"><translate x="4"/></transform>
        </animation></sensor><shape type="cube"/>"""
    world = load_world(scene(tmp_path, sensor, "0.6.0"))
    pose = world.camera.motion.pose(0.5)
    np.testing.assert_allclose(pose[:3, 3], (1, 0, 0), atol=1e-12)
    np.testing.assert_allclose(-pose[:3, 2], (0, 0, 1), atol=1e-12)
    assert world.duration_s == 2
    assert not world.notes


def camera(tmp_path, properties):
    film = '<film type="hdrfilm"><integer name="width" value="200"/><integer name="height" value="100"/></film>'
    sensor = f'<sensor type="perspective">{properties}{film}</sensor>'
    path = scene(tmp_path, sensor + '<emitter type="constant"/><shape type="cube"/>')
    return load_mitsuba(path).camera


@pytest.mark.parametrize(
    ("axis", "side"), [("x", 200), ("y", 100), ("larger", 200), ("smaller", 100), ("diagonal", np.hypot(200, 100))]
)
def test_the_field_of_view_spans_the_side_that_the_file_names(tmp_path, axis, side):
    """Of pixels 1 wide at distance d: tan(fov / 2) = side / 2 / d, and likewise for the width."""
    found = camera(tmp_path, f'<float name="fov" value="40"/><string name="fov_axis" value="{axis}"/>')
    distance = side / 2 / np.tan(np.radians(20))
    assert np.tan(np.radians(found.fov_deg / 2)) == pytest.approx(100 / distance)


def test_a_focal_length_belongs_to_the_diagonal_of_full_frame_film(tmp_path):
    found = camera(tmp_path, '<string name="focal_length" value="43.2666mm"/>')
    distance = np.hypot(200, 100)  # 43.2666 mm is that diagonal
    assert np.tan(np.radians(found.fov_deg / 2)) == pytest.approx(100 / distance, rel=1e-5)


def test_the_principal_point_is_the_film_shift_turned_round(tmp_path):
    """Mitsuba counts x in widths and y in heights, clsim both in widths."""
    found = camera(
        tmp_path,
        '<float name="fov" value="40"/><float name="principal_point_offset_x" value="0.1"/>'
        '<float name="principal_point_offset_y" value="-0.2"/>',
    )
    assert found.lens.principal_point == pytest.approx((-0.1, 0.1))


def test_glass_absorbs_as_its_medium_and_other_media_are_left_out_with_a_word(tmp_path):
    medium = '<medium type="homogeneous" name="interior" id="ink"><float name="scale" value="2"/>{}</medium>'
    clear = '<float name="albedo" value="0"/><rgb name="sigma_t" value="0.1, 0.2, 0.3"/>'
    old = '<rgb name="sigmaA" value="0.1, 0.2, 0.3"/>'
    shape = '<shape type="cube"><bsdf type="{}"/>{}</shape>'
    for text, version in ((clear, "3.0.0"), (old, "0.6.0")):
        world = load(tmp_path, shape.format("dielectric", medium.format(text)), version)
        assert world.materials[0].absorption == pytest.approx((0.2, 0.4, 0.6)) and not world.warnings
    for kind, text in (("dielectric", ""), ("diffuse", clear)):
        world = load(tmp_path, shape.format(kind, medium.format(text)))
        assert world.materials[0].absorption == (0, 0, 0)
        assert any("ink" in warning and "left out" in warning for warning in world.warnings)
    outside = medium.format(clear).replace("interior", "exterior")
    assert any("fog" in warning for warning in load(tmp_path, shape.format("diffuse", outside)).warnings)
    assert not load(tmp_path, '<shape type="cube"><bsdf type="dielectric"/></shape>').warnings


def test_shapes_refer_to_emitters_and_to_what_stands_further_down(tmp_path):
    body = (
        '<emitter type="area" id="glow"><rgb name="radiance" value="3"/></emitter>'
        '<shape type="disk"><ref id="glow"/><ref id="red"/></shape>'
        '<bsdf type="diffuse" id="red"><rgb name="reflectance" value="0.5, 0, 0"/></bsdf>'
    )
    world = load(tmp_path, body)
    assert [(m.emission, m.color) for m in world.materials] == [((3, 3, 3), (0.5, 0, 0))]
    assert not world.warnings


def test_files_are_searched_where_path_says(tmp_path):
    (tmp_path / "common").mkdir()
    (tmp_path / "common" / "a.obj").write_text(TRIANGLE)
    inner = tmp_path / "inner"
    inner.mkdir()
    world = load(inner, '<path value="../common"/><shape type="obj"><string name="filename" value="a.obj"/></shape>')
    assert len(world.meshes[0].triangles) == 1


def test_path_also_counts_where_the_scene_is_named_by_a_relative_path_and_for_includes(tmp_path, monkeypatch):
    (tmp_path / "common").mkdir()
    (tmp_path / "common" / "a.obj").write_text(TRIANGLE)
    (tmp_path / "common" / "part.xml").write_text(
        '<scene version="3.0.0"><shape type="obj"><string name="filename" value="a.obj"/></shape></scene>'
    )
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "scene.xml").write_text(
        '<scene version="3.0.0"><path value="../common"/><include filename="part.xml"/></scene>'
    )
    monkeypatch.chdir(tmp_path)
    assert len(load_world("inner/scene.xml").meshes[0].triangles) == 1


def test_parameters_of_samplers_need_no_value(tmp_path):
    sampler = '<sampler type="independent"><integer name="sample_count" value="$spp"/></sampler>'
    world = load(tmp_path, f'<integrator type="$which"/>{sampler}<shape type="cube"/>')
    assert not world.warnings


def test_the_first_default_of_a_parameter_counts(tmp_path):
    """So that a file's own wins over that of a file which it includes."""
    body = '<default name="r" value="0.25"/><default name="r" value="0.75"/>'
    shape = '<shape type="cube"><bsdf type="diffuse"><rgb name="reflectance" value="$r"/></bsdf></shape>'
    assert load(tmp_path, body + shape).materials[0].color == (0.25, 0.25, 0.25)


PARAMETERS = """<scene version="3.0.0"><default name="size" value="2"/><default name="up" value="0"/>
    <shape type="rectangle"><transform name="to_world"><scale value="$size"/><translate y="$up"/></transform></shape>
    <sensor type="perspective"><float name="fov" value="$fov"/>
        <transform name="to_world"><lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform></sensor>
    <integrator type="path"><integer name="max_depth" value="$depth"/></integrator></scene>"""


def test_parameters_are_given_after_the_files_name(tmp_path):
    path = tmp_path / "parameters.xml"
    path.write_text(PARAMETERS)
    world = load_world(f"{path}#fov=70&size=5&up=3")
    assert world.camera.fov_deg == pytest.approx(70.0)
    pose = world.instances[0].motion.pose(0.0)
    assert (pose[0, 0], pose[1, 3]) == (5.0, 3.0), "what is given goes before what the file has"
    assert load_world(f"{path}#fov=70").instances[0].motion.pose(0.0)[0, 0] == 2.0
    for given, expected in (
        ("", "give it after the file's name, as parameters.xml#fov=VALUE"),
        ("#fov=70&sise=5", "has no parameter 'sise', expected one of fov, size, up"),
        ("#fov", "got 'fov' after #, expected parameters such as spp=64&width=320"),
    ):
        with pytest.raises(InputError) as error:
            load_world(f"{path}{given}")
        assert expected in str(error.value)


def test_spots_and_projectors_keep_their_pictures(tmp_path):
    PIL.Image.new("RGB", (8, 4)).save(tmp_path / "slide.png")
    bitmap = '<texture name="{}" type="bitmap"><string name="filename" value="slide.png"/></texture>'
    spot = f'<emitter type="spot"><float name="cutoff_angle" value="45"/>{bitmap.format("texture")}</emitter>'
    beamer = f'<emitter type="projector"><float name="fov" value="90"/>{bitmap.format("irradiance")}</emitter>'
    world = load(tmp_path, '<shape type="rectangle"/>' + spot + beamer)
    assert not world.warnings
    slide, frame = world.punctual_lights
    assert (slide.picture, slide.picture_size) == (0, pytest.approx((-1, -1)))
    # A picture of 2:1 over a field of view of 90° across; the light of Mitsuba's is π times its scale.
    assert (frame.falloff, frame.picture_size) == ("frame", pytest.approx((1, 0.5)))
    assert frame.intensity == pytest.approx((np.pi,) * 3)
    assert frame.outer_deg == pytest.approx(np.degrees(np.arctan(np.hypot(1, 0.5))))


@pytest.mark.parametrize(("opens", "closes", "exposes"), [(None, None, 0), (None, 0.02, 0.02), (0.5, 0.53, 0.03)])
def test_a_shutter_is_open_from_when_it_opens_until_it_closes(tmp_path, opens, closes, exposes):
    told = {"shutter_open": opens, "shutter_close": closes}
    properties = "".join(f'<float name="{name}" value="{value}"/>' for name, value in told.items() if value is not None)
    assert camera(tmp_path, properties).shutter_s == pytest.approx(exposes)


@pytest.mark.parametrize(("axis", "size"), [("x", (1, 0.5)), ("larger", (1, 0.5)), ("y", (2, 1)), ("smaller", (2, 1))])
def test_a_projector_s_field_of_view_is_that_of_the_axis_it_names(tmp_path, axis, size):
    """A picture of 2:1 that covers 90° along one of its sides."""
    PIL.Image.new("RGB", (8, 4)).save(tmp_path / "slide.png")
    slide = '<texture name="irradiance" type="bitmap"><string name="filename" value="slide.png"/></texture>'
    told = f'<float name="fov" value="90"/><string name="fov_axis" value="{axis}"/>'
    world = load(tmp_path, f'<shape type="rectangle"/><emitter type="projector">{told}{slide}</emitter>')
    assert world.punctual_lights[0].picture_size == pytest.approx(size)


@pytest.mark.parametrize("scale", [None, 0.25, 3.0])
def test_an_environment_is_as_bright_as_its_picture_times_its_scale(tmp_path, scale):
    PIL.Image.new("RGB", (8, 4), "white").save(tmp_path / "sky.png")
    told = "" if scale is None else f'<float name="scale" value="{scale}"/>'
    sky = f'<emitter type="envmap"><string name="filename" value="sky.png"/>{told}</emitter>'
    world = load_world(scene(tmp_path, SENSOR + '<shape type="cube"/>' + sky))
    np.testing.assert_allclose(world.environment_map.radiance, scale or 1.0, rtol=1e-5)


def test_a_mirrored_sky_stays_mirrored(tmp_path):
    PIL.Image.new("RGB", (8, 4), "white").save(tmp_path / "sky.png")
    place = '<transform name="to_world"><scale x="-2" y="2" z="2"/></transform>'
    sky = f'<emitter type="envmap"><string name="filename" value="sky.png"/>{place}</emitter>'
    world = load_world(scene(tmp_path, SENSOR + '<shape type="cube"/>' + sky))
    np.testing.assert_allclose(world.environment_map.to_world, np.diag((-1.0, 1.0, 1.0)), atol=1e-9)
