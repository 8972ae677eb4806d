"""Mitsuba's XML: what it becomes, and what a hostile file is told."""

import struct
import zlib
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.images import decode_srgb
from clsim.scene.mitsuba_scene import load_mitsuba
from clsim.scene.mitsuba_shapes import read_serialized

ROOM = Path(__file__).resolve().parents[3] / "shared" / "assets" / "mitsuba" / "living-room"
SENSOR = '<sensor type="perspective"><float name="fov" value="60"/></sensor>'
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def scene(tmp_path, body, version="3.0.0"):
    path = tmp_path / "scene.xml"
    path.write_text(f'<scene version="{version}">\n{body}\n</scene>')
    return path


def load(tmp_path, body, version="3.0.0"):
    return load_mitsuba(scene(tmp_path, SENSOR + '<emitter type="constant"/>' + body, version))


def material(tmp_path, bsdf, version="3.0.0"):
    world = load(tmp_path, f'<shape type="cube">{bsdf}</shape>', version)
    return world.materials[world.meshes[0].material_ids[0]], world


def complaint(path):
    with pytest.raises(InputError) as caught:
        load_world(path)
    assert path.name in str(caught.value) and "\n" not in str(caught.value)
    return str(caught.value)


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


def test_materials(tmp_path):
    gold, _ = material(
        tmp_path,
        '<bsdf type="twosided"><bsdf type="roughconductor"><string name="material" value="Au"/>'
        '<float name="alpha" value="0.3"/><string name="distribution" value="ggx"/></bsdf></bsdf>',
    )
    assert (gold.kind, gold.alpha, gold.back, gold.eta[2]) == ("conductor", 0.3, "same", 1.442)
    copper, _ = material(tmp_path, '<bsdf type="conductor"/>', "0.6.0")
    assert copper.eta[0] == 0.201
    ideal, _ = material(tmp_path, '<bsdf type="conductor"/>')
    assert ideal.eta is None
    glass, _ = material(tmp_path, '<bsdf type="dielectric"><string name="int_ior" value="diamond"/></bsdf>')
    assert (glass.kind, glass.back) == ("dielectric", "same")
    assert glass.ior == pytest.approx(2.419 / 1.000277)
    pane, _ = material(tmp_path, '<bsdf type="thindielectric"/>')
    assert pane.kind == "thin-dielectric"
    hole, _ = material(tmp_path, '<bsdf type="mask"><float name="opacity" value="0.3"/><bsdf type="diffuse"/></bsdf>')
    assert (hole.alpha_mode, hole.opacity) == ("blend", pytest.approx(0.3))
    back, _ = material(tmp_path, '<bsdf type="diffuse"/>')
    assert back.back == "black"
    srgb, _ = material(tmp_path, '<bsdf type="diffuse"><rgb name="reflectance" value="#ff8000"/></bsdf>')
    assert srgb.color == pytest.approx((1, float(decode_srgb(128 / 255)), 0))
    flat, _ = material(tmp_path, '<bsdf type="diffuse"><spectrum name="reflectance" value="400:0.5, 700:0.5"/></bsdf>')
    assert flat.color == pytest.approx((0.5, 0.5, 0.5), rel=0.01)
    _, world = material(tmp_path, '<bsdf type="hk"/>')
    assert any("hk" in warning for warning in world.warnings)
    _, world = material(tmp_path, '<bsdf type="roughplastic"/>')
    assert any("Beckmann" in warning for warning in world.warnings)
    with pytest.raises(InputError, match="hk"):
        load_world(scene(tmp_path, SENSOR + '<shape type="cube"><bsdf type="hk"/></shape>'), strict=True)


def test_bitmaps_keep_their_wrap_transform_and_opacity(tmp_path):
    pixels = np.zeros((2, 2, 4), np.uint8)
    pixels[0, 0] = (255, 255, 255, 0)
    PIL.Image.fromarray(pixels).save(tmp_path / "a.png")
    bitmap = (
        '<texture type="bitmap" name="{}"><string name="filename" value="a.png"/>'
        '<string name="wrap_mode" value="mirror"/><transform name="to_uv"><scale x="2" y="4"/></transform></texture>'
    )
    masked, world = material(
        tmp_path,
        f'<bsdf type="mask">{bitmap.format("opacity")}'
        f'<bsdf type="diffuse">{bitmap.format("reflectance")}</bsdf></bsdf>',
    )
    color, opacity = world.textures[masked.texture], world.textures[masked.opacity_texture]
    assert (color.wrap_u, color.srgb) == ("mirror", True)
    np.testing.assert_allclose(np.array(color.uv_matrix) @ (0.3, 1, 1), (0.6, 1))  # v runs down from the top
    np.testing.assert_array_equal(opacity.pixels[..., 3], [[255, 0], [0, 0]])  # white is opaque, whatever its alpha


@pytest.mark.parametrize("kind", ["conductor", "plastic", "dielectric"])
def test_textures_of_roughness_keep_their_alpha(tmp_path, kind):
    """Ours are the root of α in green, and blue multiplies metalness."""
    gray = np.array([[0, 64], [128, 255]], np.uint8)
    PIL.Image.fromarray(gray).save(tmp_path / "a.png")
    bitmap = (
        '<texture type="bitmap" name="alpha"><string name="filename" value="a.png"/><boolean name="raw" value="{}"/>'
        '<string name="filter_type" value="nearest"/></texture>'
    )
    ggx = '<string name="distribution" value="ggx"/>'
    for raw in (True, False):
        text = f'<bsdf type="rough{kind}">{bitmap.format(str(raw).lower())}{ggx}</bsdf>'
        found, world = material(tmp_path, text)
        image = world.textures[found.roughness_texture]
        expected = gray / 255 if raw else decode_srgb(gray / 255)
        assert (found.kind, found.alpha, image.srgb, image.nearest) == (kind, 1.0, False, True)
        np.testing.assert_allclose((image.pixels[..., 1] / 255) ** 2, expected, atol=0.005)
        assert (image.pixels[..., 2] == 255).all() and not world.warnings


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


def serialized(vertices, faces, flags=0x1000, version=4):
    body = struct.pack("<I", flags) + b"name\0" + struct.pack("<QQ", len(vertices), len(faces))
    body += np.asarray(vertices, "<f8" if flags & 0x2000 else "<f4").tobytes() + np.asarray(faces, "<u4").tobytes()
    return struct.pack("<HH", 0x041C, version) + zlib.compress(body)


def test_serialized_meshes(tmp_path):
    first = serialized([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    second = serialized([(0, 0, 0), (2, 0, 0), (0, 2, 0), (2, 2, 0)], [(0, 1, 2), (1, 3, 2)], 0x2000)
    path = tmp_path / "a.serialized"
    path.write_bytes(first + second + struct.pack("<QQI", 0, len(first), 2))
    assert read_serialized(path, 0).triangles.tolist() == [[0, 1, 2]]
    mesh = read_serialized(path, 1)
    assert mesh.vertices[3].tolist() == [2, 2, 0]
    assert mesh.triangles.tolist() == [[0, 1, 2], [1, 3, 2]]
    for index in (2, 9):
        with pytest.raises(InputError, match="has 2 meshes"):
            read_serialized(path, index)
    for cut in (0, 3, 10, 60, len(first) + 30):
        path.write_bytes((first + second)[:cut] + struct.pack("<QQI", 0, len(first), 2))
        with pytest.raises(InputError, match=r"a\.serialized"):
            read_serialized(path, 1)


PLACED = '<shape type="cube"><transform name="to_world">{}</transform></shape>'


def whole(body):
    return f'<scene version="3.0.0">{body}</scene>'


BOMB = "".join(f'<default name="a{k}" value="$a{k - 1}$a{k - 1}"/>' for k in range(1, 60))


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "scene.xml:1: is not well-formed XML"),
        ("<scene", "not well-formed"),
        ("\0\1\2", "not well-formed"),
        ("<other/>", "expected <scene>"),
        ("<scene/>", "no version"),
        ('<!DOCTYPE scene [<!ENTITY a "aaaa">]><scene version="3.0.0">&a;</scene>', "document type"),
        ('<!DOCTYPE scene SYSTEM "http://example.com/x.dtd"><scene version="3.0.0"/>', "document type"),
        (whole("&undefined;"), "not well-formed"),
        ('<scene version="3.0.0">' + "<shape type='cube'>" * 100, "nested deeper"),
        (whole('<default name="a0" value="x"/>' + BOMB), "longer than"),
        (whole('<shape type="$what"/>'), "of which no <default>"),
        (whole('<include filename="scene.xml"/>'), "include each other"),
        (whole('<include filename="../up.xml"/>'), "missing"),
        (
            whole('<shape type="obj"><string name="filename" value="/dev/null"/></shape>'),
            "no ordinary file",
        ),
        (
            whole('<shape type="obj"><string name="filename" value="no.obj"/></shape>'),
            "missing",
        ),
        (whole('\n\n<shape type="cube"><ref id="x"/></shape>'), "scene.xml:3: refers to 'x'"),
        (whole("<what/>"), "neither a property nor an object"),
        (whole('<shape type="cube"><float name="a" value="x"/></shape>'), "got 'x'"),
        (whole('<shape type="sphere"><float name="radius" value="nan"/></shape>'), "got 'nan'"),
        (
            whole('<shape type="sphere"><string name="radius" value="1"/></shape>'),
            "expected a float",
        ),
        (
            whole('<shape type="sphere"><float name="radius" value="-1"/></shape>'),
            "radius is -1",
        ),
        (whole('<shape type="cube"><boolean name="a" value="2"/></shape>'), "true or false"),
        (
            whole('<sensor type="perspective"><float name="fov" value="190"/></sensor>'),
            "fov is 190",
        ),
        (whole('<sensor type="perspective"/>'), "no extent"),
        (
            whole(PLACED.format("<skew/>")),
            "skew",
        ),
        (
            whole(PLACED.format('<rotate angle="3"/>')),
            "no axis",
        ),
        (
            whole(PLACED.format('<scale value="0"/>')),
            "no extent",
        ),
        (whole('<shape type="instance"/>'), "no shapegroup"),
        (
            whole('<emitter type="envmap"><string name="filename" value="scene.xml"/></emitter>'),
            "image",
        ),
    ],
)
def test_broken_scenes_get_one_sentence(tmp_path, text, part):
    path = tmp_path / "scene.xml"
    path.write_text(text)
    assert part in complaint(path)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_text_never_raises_anything_but_an_input_error(tmp_path, data):
    text = (
        '<scene version="0.6.0"><default name="r" value="0.5"/>' + SENSOR + '<bsdf type="twosided" id="b">'
        '<bsdf type="roughplastic"><rgb name="diffuseReflectance" value="$r, 0, 1"/>'
        '<float name="alpha" value="0.1"/></bsdf></bsdf>'
        '<shape type="cube"><ref id="b"/><transform name="toWorld"><rotate x="1" angle="20"/>'
        '<matrix value="1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1"/></transform></shape>'
        '<shape type="sphere"><emitter type="area"><rgb name="radiance" value="3"/></emitter></shape>'
        '<emitter type="spot"><float name="cutoffAngle" value="30"/></emitter></scene>'
    )
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(text) - 1))
        piece = data.draw(st.sampled_from(["", "0", "-", "9", '"', "x", "<", "/>", "$", "e9", "nan", " "]))
        text = text[:at] + piece + text[at + data.draw(st.integers(0, 12)) :]
    path = tmp_path / "scene.xml"
    path.write_text(text)
    try:
        load_world(path)
    except InputError as error:
        assert "scene.xml" in str(error)


def test_lamps_without_a_bsdf_are_black_and_other_shapes_grey(tmp_path):
    light = '<emitter type="area"><rgb name="radiance" value="1, 2, 3"/></emitter>'
    world = load(tmp_path, f'<shape type="disk">{light}</shape><shape type="cube"/>')
    assert [m.color for m in world.materials] == [(0, 0, 0), (0.5, 0.5, 0.5)]


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


def test_one_image_as_colour_and_as_normals_is_two_textures(tmp_path):
    PIL.Image.fromarray(np.full((2, 2, 3), 128, np.uint8)).save(tmp_path / "a.png")
    image = '<texture type="bitmap" name="{}"><string name="filename" value="a.png"/>{}</texture>'
    diffuse = '<bsdf type="diffuse">' + image.format("reflectance", "") + "</bsdf>"
    bsdf = '<bsdf type="normalmap">' + image.format("normalmap", '<boolean name="raw" value="true"/>') + diffuse
    found, world = material(tmp_path, bsdf + "</bsdf>")
    assert found.texture != found.normal_texture
    assert [world.textures[k].srgb for k in (found.texture, found.normal_texture)] == [True, False]


@pytest.mark.parametrize(
    ("spectrum", "light", "reflectance"),
    [  # what Mitsuba 3.9 makes of them in its rgb variants
        ('value="0.5"', (0.6024, 0.4741, 0.4545), (0.5, 0.5, 0.5)),
        ('value="400:0.5, 700:0.5"', (0.5998, 0.4748, 0.4517), (0.4977, 0.4999, 0.4975)),
        ('value="500:0.2, 600:0.7"', (0.2717, 0.4174, 0.0), (0.2393, 0.4269, 0.0)),
        (
            'value="400:0.2, 500:0.4, 550:0.6, 600:0.1, 700:0.9"',
            (0.2675, 0.4578, 0.2614),
            (0.1986, 0.4844, 0.2917),
        ),
        ('type="d65"', (1, 1, 1), (1, 1, 1)),
        ('filename="a.spd"', (0.5998, 0.4748, 0.4517), (0.4977, 0.4999, 0.4975)),
    ],
)
def test_spectra_of_light_keep_their_tint_and_reflectances_are_white_by_daylight(
    tmp_path, spectrum, light, reflectance
):
    (tmp_path / "a.spd").write_text("# nm, share\n400 0.5\n700 0.5\n")
    lamp = f'<shape type="disk"><emitter type="area"><spectrum name="radiance" {spectrum}/></emitter></shape>'
    (emitter,) = load(tmp_path, lamp).materials
    assert emitter.emission == pytest.approx(light, rel=0.025, abs=1e-4)
    bsdf = f'<bsdf type="diffuse"><spectrum name="reflectance" {spectrum}/></bsdf>'
    assert material(tmp_path, bsdf)[0].color == pytest.approx(reflectance, rel=0.025, abs=1e-4)


def test_constant_spectra_of_old_files_are_white(tmp_path):
    lamp = '<shape type="disk"><emitter type="area"><spectrum name="radiance" value="9"/></emitter></shape>'
    assert load(tmp_path, lamp, "0.6.0").materials[0].emission == (9, 9, 9)
    pairs = lamp.replace('"9"', '"400:9, 700:9"')
    assert load(tmp_path, pairs, "0.6.0").materials[0].emission[0] > 10


def test_black_bodies_have_the_radiance_of_plancks_law(tmp_path):
    """At 2856 K and 5000 K as Mitsuba 3.9's spectral variant renders them."""
    for temperature, expected in ((2856, (499.9, 223.7, 63.0)), (5000, (15277, 12095, 9574))):
        spectrum = f'<spectrum name="radiance" type="blackbody"><float name="temperature" value="{temperature}"/>'
        lamp = f'<shape type="disk"><emitter type="area">{spectrum}</spectrum></emitter></shape>'
        assert load(tmp_path, lamp).materials[0].emission == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(
    ("spectrum", "part"),
    [
        ('value="700:1, 400:1"', "increasing wavelengths"),
        ('value="400:1:2"', "wavelength:value pairs"),
        ('type="what"', "expected d65, uniform, blackbody"),
        ('type="blackbody"', "expected 1 numbers"),
        ('filename="none.spd"', "missing"),
        ('filename="scene.xml"', "no table"),
    ],
)
def test_wrong_spectra_get_one_sentence(tmp_path, spectrum, part):
    bsdf = f'<bsdf type="diffuse"><spectrum name="reflectance" {spectrum}/></bsdf>'
    assert part in complaint(scene(tmp_path, SENSOR + f'<shape type="cube">{bsdf}</shape>'))


def test_glass_keeps_what_it_lets_pass(tmp_path):
    bsdf = '<bsdf type="dielectric"><rgb name="specular_transmittance" value="0.5, 0.05, 0"/></bsdf>'
    found, world = material(tmp_path, bsdf)
    assert (found.color, found.specular_color) == ((0.5, 0.05, 0), (1, 1, 1)) and not world.warnings


def test_media_are_left_out_with_a_word(tmp_path):
    fog = '<medium type="homogeneous" name="interior"><float name="scale" value="2"/></medium>'
    world = load(tmp_path, f'<shape type="cube"><bsdf type="dielectric"/>{fog}</shape>')
    assert any("media are left out" in warning for warning in world.warnings)
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


def test_two_that_refer_to_each_other_get_one_sentence(tmp_path):
    body = '<bsdf type="twosided" id="a"><ref id="b"/></bsdf><bsdf type="twosided" id="b"><ref id="a"/></bsdf>'
    assert "refers to" in complaint(scene(tmp_path, SENSOR + body))


def test_files_are_searched_where_path_says(tmp_path):
    (tmp_path / "common").mkdir()
    (tmp_path / "common" / "a.obj").write_text(TRIANGLE)
    inner = tmp_path / "inner"
    inner.mkdir()
    world = load(inner, '<path value="../common"/><shape type="obj"><string name="filename" value="a.obj"/></shape>')
    assert len(world.meshes[0].triangles) == 1


def test_parameters_of_samplers_need_no_value(tmp_path):
    sampler = '<sampler type="independent"><integer name="sample_count" value="$spp"/></sampler>'
    world = load(tmp_path, f'<integrator type="$which"/>{sampler}<shape type="cube"/>')
    assert not world.warnings


def test_negative_indices_of_metals_are_mended_with_a_word(tmp_path):
    bsdf = '<bsdf type="conductor"><rgb name="eta" value="-0.01, 0.5, 1"/><rgb name="k" value="3, 2, 1"/></bsdf>'
    found, world = material(tmp_path, bsdf)
    assert (found.eta, found.k) == ((0, 0.5, 1), (3, 2, 1))
    assert any("negative index" in warning for warning in world.warnings)
    with pytest.raises(InputError, match="strict"):
        load_world(tmp_path / "scene.xml", strict=True)


def test_both_indices_of_a_metal_are_relative_to_what_is_around(tmp_path):
    bsdf = (
        '<bsdf type="conductor"><rgb name="eta" value="2, 1, 0.5"/><rgb name="k" value="3, 2, 1"/>'
        '<float name="ext_eta" value="2"/></bsdf>'
    )
    found, _ = material(tmp_path, bsdf)
    assert (found.eta, found.k) == ((1, 0.5, 0.25), (1.5, 1, 0.5))


def test_old_texture_scales_come_before_the_transform(tmp_path):
    PIL.Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(tmp_path / "a.png")
    texture = (
        '<texture type="bitmap" name="reflectance"><string name="filename" value="a.png"/>'
        '<float name="uscale" value="2"/><transform name="to_uv"><translate x="0.25"/></transform></texture>'
    )
    _, world = material(tmp_path, f'<bsdf type="diffuse">{texture}</bsdf>')
    np.testing.assert_allclose(np.array(world.textures[0].uv_matrix) @ (0.5, 0, 1), (1.25, 0))


def test_the_first_default_of_a_parameter_counts(tmp_path):
    """So that a file's own wins over that of a file which it includes."""
    body = '<default name="r" value="0.25"/><default name="r" value="0.75"/>'
    shape = '<shape type="cube"><bsdf type="diffuse"><rgb name="reflectance" value="$r"/></bsdf></shape>'
    assert load(tmp_path, body + shape).materials[0].color == (0.25, 0.25, 0.25)
