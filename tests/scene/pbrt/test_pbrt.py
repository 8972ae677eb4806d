"""pbrt-v4 scenes: what they become, and what a hostile file is told."""

import numpy as np
import PIL.Image
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.light.spectra import METALS
from clsim.scene.pbrt.scene import load_pbrt
from clsim.scene.pbrt.shapes import latitude_longitude

HEAD = (
    'LookAt 0 0 -5  0 0 0  0 1 0\nCamera "perspective" "float fov" 40\n'
    'Film "rgb" "integer xresolution" 400 "integer yresolution" [200]\n'
)
TRIANGLE = 'Shape "trianglemesh" "integer indices" [0 1 2] "point3 P" [0 0 0  1 0 0  0 1 0]\n'


def scene(tmp_path, body, head=HEAD):
    path = tmp_path / "scene.pbrt"
    path.write_text(head + "WorldBegin\n" + body)
    return path


def load(tmp_path, body, head=HEAD):
    return load_pbrt(scene(tmp_path, 'LightSource "infinite"\n' + body, head))


def on_film(world, point):
    """Return where a point appears, in image widths to the right and up from the middle."""
    camera = world.camera
    x, y, z, _ = np.linalg.inv(camera.motion.pose(0.0)) @ (*point, 1)
    assert z < 0
    half = np.tan(np.radians(camera.fov_deg) / 2)
    return x / -z / half / 2, y / -z / half / 2


def corners(world, k=0, time_s=0.0):
    instance = world.instances[k]
    mesh, pose = world.meshes[instance.mesh], instance.motion.pose(time_s)
    return mesh.vertices[mesh.triangles[0]] @ pose[:3, :3].T + pose[:3, 3]


def test_the_left_handed_world_appears_unmirrored(tmp_path):
    """pbrt looks along +z with x to the right and y up: what has x > 0 appears on the right."""
    world = load(tmp_path, TRIANGLE)
    origin, right, up = (on_film(world, point) for point in ((0, 0, 0), (1, 0, 0), (0, 1, 0)))
    assert origin == pytest.approx((0, 0), abs=1e-9)
    half = np.tan(np.radians(20)) * 2  # 40° belong to the shorter side
    assert right == pytest.approx((1 / 5 / half / 2, 0), abs=1e-6)
    assert up == pytest.approx((0, 1 / 5 / half / 2), abs=1e-6)
    found = {tuple(np.round(p, 6)) for p in corners(world)}
    assert found == {(0, 0, 0), (1, 0, 0), (0, 1, 0)}
    # its front, where it runs counter-clockwise in pbrt's numbers, points to +z there, away from the camera
    a, b, c = corners(world)
    assert np.cross(b - a, c - a) @ -world.camera.motion.pose(0)[:3, 2] > 0
    assert (world.camera.width, world.camera.height) == (400, 200)


def test_a_camera_that_mirrors_leaves_the_world_as_it_is(tmp_path):
    world = load(tmp_path, "Translate 0 0 3\n" + TRIANGLE, "Scale -1 1 1\n" + HEAD)
    assert {tuple(p) for p in corners(world).tolist()} == {(0, 0, 3), (1, 0, 3), (0, 1, 3)}
    assert on_film(world, (1, 0, 0))[0] < 0  # mirrored, as asked
    assert np.linalg.det(world.camera.motion.pose(0)[:3, :3]) == pytest.approx(1)


def test_transforms_and_blocks(tmp_path):
    body = (
        "Translate 1 2 3 AttributeBegin Rotate 90 0 0 1 Scale 2 2 2 " + TRIANGLE + "AttributeEnd\n"
        "TransformBegin ConcatTransform [1 0 0 0  0 1 0 0  0 0 1 0  5 0 0 1] " + TRIANGLE + "TransformEnd\n"
        'CoordSysTransform "world" Transform [1 0 0 0 0 1 0 0 0 0 1 0 7 8 9 1] ' + TRIANGLE
    )
    world = load(tmp_path, body)
    mirrored = np.array((1, 1, -1))
    expected = [
        [(1, 2, 3), (1, 4, 3), (-1, 2, 3)],
        [(6, 2, 3), (7, 2, 3), (6, 3, 3)],
        [(7, 8, 9), (8, 8, 9), (7, 9, 9)],
    ]
    for k, points in enumerate(expected):
        ours = {tuple(np.round(p * mirrored, 6)) for p in corners(world, k)}
        assert ours == {tuple(float(x) for x in p) for p in points}


def test_instances_includes_and_named_materials(tmp_path):
    (tmp_path / "part.pbrt").write_text('MakeNamedMaterial "gold" "string type" "conductor" "float roughness" 0.25\n')
    body = (
        'Include "part.pbrt" NamedMaterial "gold" ObjectBegin "o" Translate 0 0 1 ' + TRIANGLE + "ObjectEnd\n"
        'Translate 2 0 0 ObjectInstance "o" Scale 1 3 2 ObjectInstance "o"'
    )
    world = load(tmp_path, body)
    assert len(world.instances) == 2
    assert {tuple(p) for p in corners(world, 0).tolist()} == {(2, 0, -1), (3, 0, -1), (2, 1, -1)}
    assert {tuple(p) for p in corners(world, 1).tolist()} == {(2, 0, -2), (3, 0, -2), (2, 3, -2)}
    material = world.materials[world.meshes[0].material_ids[0]]
    assert material.kind == "conductor" and material.alpha == 0.5  # remapped by the square root
    assert material.eta == METALS["Cu"][0]


def test_animated_transforms_become_motion(tmp_path):
    head = "TransformTimes 0 2\n" + HEAD
    body = "ActiveTransform EndTime Translate 4 0 0 Rotate 90 0 0 1 ActiveTransform All\n" + TRIANGLE
    world = load(tmp_path, body, head)
    start, middle, end = (corners(world, time_s=t) for t in (0.0, 1.0, 2.0))
    assert {tuple(np.round(p, 6)) for p in start} == {(0, 0, 0), (1, 0, 0), (0, 1, 0)}
    assert {tuple(np.round(p, 6)) for p in end} == {(4, 0, 0), (4, 1, 0), (3, 0, 0)}
    root = np.sqrt(0.5)
    halfway = {(2, 0, 0), (2 + root, root, 0), (2 - root, root, 0)}
    assert {tuple(np.round(p, 4)) for p in middle} == {tuple(np.round(p, 4)) for p in halfway}
    assert world.duration_s == 2


@pytest.mark.parametrize("scale", [(1, 1, 1), (2, 1, 3), (2, -1, 3)])
def test_what_turns_out_of_the_plane_turns_the_same_way_and_keeps_its_stretch(tmp_path, scale):
    head = "TransformTimes 0 1\n" + HEAD
    turn = "Translate 0 0 2 ActiveTransform EndTime Rotate 60 0 1 0 ActiveTransform All Scale {} {} {}\n"
    world = load(tmp_path, turn.format(*scale) + TRIANGLE, head)
    for time_s, degrees in ((0.0, 0), (0.5, 30), (1.0, 60)):
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        expected = {(0, 0, -2), (scale[0] * c, 0, -(2 - scale[0] * s)), (0, scale[1], -2)}
        found = {tuple(np.round(p, 5)) for p in corners(world, time_s=time_s)}
        assert found == {tuple(np.round(p, 5)) for p in expected}
    assert not world.warnings


def material(tmp_path, text, before=""):
    world = load(tmp_path, f"{before} Material {text}\n" + TRIANGLE)
    return world.materials[world.meshes[0].material_ids[0]], world


def test_materials_and_spectra(tmp_path):
    m, _ = material(tmp_path, '"diffuse" "rgb reflectance" [.1 .2 .3]')
    assert (m.kind, m.color) == ("diffuse", (0.1, 0.2, 0.3))
    gold = '"spectrum eta" "metal-Au-eta" "spectrum k" "metal-Au-k"'
    m, _ = material(tmp_path, f'"conductor" {gold} "bool remaproughness" false "float roughness" 0.2')
    assert (m.eta, m.k, m.alpha) == (*METALS["Au"], 0.2)
    m, _ = material(tmp_path, '"conductor" "rgb reflectance" [.9 .8 .7]')
    assert m.eta is None and m.color == (0.9, 0.8, 0.7)
    m, _ = material(tmp_path, '"dielectric" "spectrum eta" "glass-BK7"')
    assert m.kind == "dielectric" and m.ior == pytest.approx(1.5168)
    m, _ = material(tmp_path, '"thindielectric" "float eta" 1.33')
    assert (m.kind, m.ior) == ("thin-dielectric", 1.33)
    m, _ = material(tmp_path, '"coateddiffuse" "spectrum reflectance" [400 0.5 700 0.5]')
    assert m.kind == "plastic" and m.color[1] == pytest.approx(0.5, rel=0.1)
    m, world = material(tmp_path, '"hair"')
    assert m.kind == "diffuse" and any("hair" in w for w in world.warnings)
    with pytest.raises(InputError, match="hair"):
        load_world(scene(tmp_path, 'Material "hair"\n' + TRIANGLE), strict=True)


def test_roughness_may_differ_along_u_and_v(tmp_path):
    both = '"float uroughness" 0.16 "float vroughness" 0.01'
    m, world = material(tmp_path, f'"conductor" {both}')
    assert (m.alpha, m.stretch) == pytest.approx((0.2, 2.0)) and not world.warnings
    m, _ = material(tmp_path, f'"dielectric" "bool remaproughness" false {both}')
    assert (m.alpha, m.stretch) == pytest.approx((0.04, 4.0))


def test_textures_of_roughness_keep_their_alpha(tmp_path):
    pixels = np.array([[(0, 0, 0), (60, 90, 120)], [(200, 200, 200), (255, 255, 255)]], np.uint8)
    PIL.Image.fromarray(pixels).save(tmp_path / "a.png")
    before = (
        'Texture "image" "float" "imagemap" "string filename" "a.png" "string encoding" "linear" "float scale" 0.5\n'
        'Texture "even" "float" "constant" "float value" 0.25\n'
    )
    roughness = 0.5 * pixels.mean(axis=2) / 255
    for kind, model in (("conductor", "conductor"), ("coateddiffuse", "plastic"), ("dielectric", "dielectric")):
        for remapped in (True, False):
            flag = f'"bool remaproughness" {str(remapped).lower()}'
            m, world = material(tmp_path, f'"{kind}" "texture roughness" "image" {flag}', before)
            image = world.textures[m.roughness_texture]
            alpha = np.sqrt(roughness) if remapped else roughness
            assert (m.kind, m.alpha, image.srgb) == (model, 1.0, False)
            np.testing.assert_allclose((image.pixels[..., 1] / 255) ** 2, alpha, atol=0.005)
            assert (image.pixels[..., 2] == 255).all() and not world.warnings
    m, _ = material(tmp_path, '"conductor" "texture roughness" "even"', before)
    assert (m.alpha, m.roughness_texture) == (0.5, -1)


def test_textures(tmp_path):
    pixels = np.arange(16, dtype=np.uint8).reshape(2, 2, 4)
    PIL.Image.fromarray(pixels).save(tmp_path / "a.png")
    before = (
        'Texture "image" "spectrum" "imagemap" "string filename" "a.png" "float uscale" 3 "string wrap" "clamp"\n'
        'Texture "half" "spectrum" "scale" "texture tex" "image" "float scale" 0.5\n'
        'Texture "check" "spectrum" "checkerboard" "rgb tex1" [1 0 0] "rgb tex2" [0 1 0]'
        ' "float uscale" 4 "float vscale" 6\n'
    )
    m, world = material(tmp_path, '"diffuse" "texture reflectance" "half"', before)
    image = world.textures[m.texture]
    np.testing.assert_array_equal(image.pixels, pixels)
    assert m.color == (0.5, 0.5, 0.5) and image.wrap_u == "clamp"
    np.testing.assert_allclose(np.array(image.uv_matrix) @ (1, 1, 1), (3, 1))
    m, world = material(tmp_path, '"diffuse" "texture reflectance" "check"', before)
    check = world.textures[m.texture]
    for u, v in ((0.1, 0.1), (0.3, 0.1), (0.1, 0.2), (0.3, 0.2), (0.6, 0.9)):
        s, t = np.array(check.uv_matrix) @ (u, v, 1)
        texel = check.pixels[int((1 - t % 1) * 2), int(s % 1 * 2)]
        first = (int(np.floor(u * 4)) + int(np.floor(v * 6))) % 2 == 0
        assert texel[:2].tolist() == ([255, 0] if first else [0, 255])


def test_lights(tmp_path):
    body = (
        'Translate 1 0 0 LightSource "point" "point3 from" [0 2 3] "rgb I" [1 2 3] "float scale" 2\n'
        'LightSource "distant" "point3 from" [0 5 0] "point3 to" [0 0 0] "blackbody L" 6500\n'
        'LightSource "spot" "point3 from" [0 0 0] "point3 to" [0 0 2] "float coneangle" 30 "float conedeltaangle" 10\n'
        'AreaLightSource "diffuse" "rgb L" [4 5 6] ReverseOrientation ' + TRIANGLE
    )
    world = load(tmp_path, body)
    point, sun, spot = world.punctual_lights
    assert point.intensity == (2, 4, 6)
    np.testing.assert_allclose(point.motion.pose(0)[:3, 3], (1, 2, -3))
    np.testing.assert_allclose(-sun.motion.pose(0)[:3, 2], (0, -1, 0), atol=1e-12)
    assert np.dot(sun.intensity, (0.2126, 0.7152, 0.0722)) == pytest.approx(1, rel=1e-3)
    np.testing.assert_allclose(-spot.motion.pose(0)[:3, 2], (0, 0, -1), atol=1e-12)
    assert (spot.inner_deg, spot.outer_deg, spot.falloff) == (20, 30, "smooth")
    lamp = world.materials[world.meshes[0].material_ids[0]]
    assert (lamp.emission, lamp.emits_behind, lamp.back) == ((4, 5, 6), False, "same")
    a, b, c = corners(world)
    assert np.cross(b - a, c - a) @ world.camera.motion.pose(0)[:3, 2] > 0  # turned round, its front faces the camera


def test_round_shapes_and_files(tmp_path):
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n2 0 0\n0 1 0\n3 0 1 2\n"
    )
    body = (
        'Shape "sphere" "float radius" 2 Shape "disk" "float radius" 3 "float height" 1'
        ' Shape "plymesh" "string filename" "a.ply"\n'
        'Shape "bilinearmesh" "point3 P" [0 0 0  1 0 0  0 1 0  1 1 0] Shape "curve"'
    )
    world = load(tmp_path, body)
    sphere, disk, ply, patch = world.meshes[:4]
    np.testing.assert_allclose(np.linalg.norm(sphere.vertices, axis=1), 2, rtol=1e-5)
    top = sphere.uvs[np.argmax(sphere.vertices[:, 2] * np.sign(sphere.vertices[:, 2].max()))]
    assert top[1] in (pytest.approx(0), pytest.approx(1))
    assert set(np.round(np.abs(disk.vertices[:, 2]), 6)) == {1}
    assert ply.normals is None and len(patch.triangles) == 2
    assert any("curve" in w for w in world.warnings)


def to_sphere(x, y):
    """Return the direction of a point of the equal-area square: the way there, as the loader goes the way back."""
    u, v = 2 * x - 1, 2 * y - 1
    distance = 1 - (abs(u) + abs(v))
    r = 1 - abs(distance)
    phi = (1 if r == 0 else (abs(v) - abs(u)) / r + 1) * np.pi / 4
    ring = r * np.sqrt(2 - r * r)
    z = np.copysign(1 - r * r, distance)
    return np.copysign(np.cos(phi), u) * ring, np.copysign(np.sin(phi), v) * ring, z


def test_environment_images_are_equal_area_squares_and_turn_with_their_transform():
    n = 256
    row, column = np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) / n, indexing="ij")
    image = np.stack([column, row, row], axis=-1).astype(np.float32)
    turn = Rotation.random(random_state=4).as_matrix()
    found = latitude_longitude(image, turn)
    h, w = found.shape[:2]
    for x, y in np.random.default_rng(1).uniform(0.05, 0.95, (60, 2)):
        dx, dy, dz = turn.T @ to_sphere(x, y)
        v, u = np.arccos(dy) / np.pi, (np.arctan2(dx, -dz) / (2 * np.pi)) % 1  # the layout of EnvironmentMap
        if abs(dy) < 0.98:
            color = found[int(v * h), int(u * w)]
            np.testing.assert_allclose(color[:2], (x, y), atol=0.03)


def test_equal_areas_keep_the_mean(tmp_path):
    image = np.random.default_rng(0).uniform(size=(32, 32, 3)).astype(np.float32)
    found = latitude_longitude(np.repeat(np.repeat(image, 16, 0), 16, 1), np.eye(3))
    weights = np.sin(np.pi * (np.arange(found.shape[0]) + 0.5) / found.shape[0])
    mean = (found.mean(axis=1) * weights[:, None]).sum(axis=0) / weights.sum()
    np.testing.assert_allclose(mean, image.mean(axis=(0, 1)), rtol=5e-3)


@pytest.mark.parametrize(
    ("body", "part"),
    [
        ("Nonsense", "scene.pbrt:5: got 'Nonsense'"),
        ('Shape "sphere" "float radius" [\n1\n]\nNonsense', "scene.pbrt:8: got 'Nonsense'"),
        ('"quoted"', "expected a directive"),
        ("[1 2 3]", "a list of numbers"),
        ('Shape "sphere" "float radius" [', "the file ends"),
        ('Shape "sphere" "float radius" "x"', "radius has 0 numbers"),
        ('Shape "sphere" "float radius" [1 2]', "radius has 2 numbers"),
        ('Shape "sphere" "radius" [1]', 'a parameter such as "float radius"'),
        ('Shape "sphere" "float radius" -1', "radius is -1"),
        ('Shape "sphere', "does not end on its line"),
        ("Translate 1 2", "the file ends"),
        ("Translate 1 2 x", "got 'x'"),
        ("Translate [1 2]", "got 2 numbers, expected 3"),
        ("Scale 1e999 1 1", "finite"),
        ("Rotate 1 0 0 0", "no axis"),
        ("LookAt 0 0 0 0 0 0 0 1 0", "own eye"),
        ("AttributeBegin", "ends within a block"),
        ("AttributeEnd", "nothing has begun"),
        ("ObjectEnd", "nothing has begun"),
        ('ObjectBegin "a" ObjectBegin "b"', "within another"),
        ('ObjectInstance "none"', "no object 'none'"),
        ('ObjectBegin "a" ObjectInstance "a"', "no object 'a' to place here"),
        ('NamedMaterial "none"', "no material 'none'"),
        ('Material "diffuse" "texture reflectance" "none"', "no texture 'none'"),
        ('Include "../none.pbrt"', "missing"),
        ('Include "scene.pbrt"', "include each other"),
        ('Include "http://example.com/a.pbrt"', "address"),
        ('Shape "plymesh" "string filename" "/dev/null"', "no ordinary file"),
        ('Shape "plymesh" "string filename" "no.ply"', "missing"),
        ('Shape "trianglemesh" "integer indices" [0 1 9] "point3 P" [0 0 0 1 0 0 0 1 0]', "indices has 9"),
        ('Shape "trianglemesh" "integer indices" [0 1] "point3 P" [0 0 0 1 0 0 0 1 0]', "rows of 3"),
        ('Shape "trianglemesh" "point3 P" [0 0 0 1 0 nan 0 1 0]', "nan"),
        ('Shape "trianglemesh"', "no P"),
        ('Shape "trianglemesh" "point3 P" [0 0 0 1 0 0 0 1 0] "normal N" [0 0 1]', "N has 1 rows"),
        ('LightSource "infinite" "blackbody L" 1', "expected 100 to 100000"),
        ("AttributeBegin " * 10_001, "nested deeper"),
        ('CoordSysTransform "x"', "no coordinate system"),
    ],
)
def test_broken_scenes_get_one_sentence(tmp_path, body, part):
    folder = tmp_path / "inner"
    folder.mkdir()
    with pytest.raises(InputError) as caught:
        load_world(scene(folder, body))
    message = str(caught.value)
    assert part in message and ".pbrt" in message and "\n" not in message


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_text_never_raises_anything_but_an_input_error(tmp_path, data):
    text = (
        HEAD
        + 'WorldBegin LightSource "point" "rgb I" [1 2 3]\nTexture "t" "spectrum" "checkerboard" "float uscale" 3\n'
        'MakeNamedMaterial "m" "string type" "coateddiffuse" "texture reflectance" "t"\n'
        'AttributeBegin NamedMaterial "m"\n'
        "ActiveTransform EndTime Rotate 30 0 1 0 ActiveTransform All Scale -1 2 1\n" + TRIANGLE + "AttributeEnd\n"
        'ObjectBegin "o" Shape "sphere" "float radius" 2 ObjectEnd Translate 1 0 0 ObjectInstance "o"\n'
    )
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(text) - 1))
        piece = data.draw(st.sampled_from(["", "0", "-", "9", '"', "x", "[", "]", "#", "e9", "nan", " ", "\n"]))
        text = text[:at] + piece + text[at + data.draw(st.integers(0, 12)) :]
    path = tmp_path / "scene.pbrt"
    path.write_text(text)
    try:
        load_world(path)
    except InputError as error:
        assert "scene.pbrt" in str(error)


def test_spectra_of_lights_keep_their_tint_and_reflectances_are_white_by_daylight(tmp_path):
    flat = "[400 0.5 700 0.5]"
    m, _ = material(tmp_path, f'"diffuse" "spectrum reflectance" {flat}')
    assert m.color == pytest.approx((0.5, 0.5, 0.5), rel=0.01)
    world = load_world(scene(tmp_path, f'LightSource "point" "spectrum I" {flat}\n{TRIANGLE}'))
    assert world.punctual_lights[0].intensity == pytest.approx((1.2, 0.95, 0.904), rel=0.01)


@pytest.mark.parametrize("blur", ["", "ActiveTransform EndTime Translate 1 0 0 ActiveTransform All "])
def test_slanted_cameras_look_where_the_file_says(tmp_path, blur):
    """pbrt's world is mirrored in z; from (1, 2, 3) to (4, 2, -1) with y up."""
    path = tmp_path / "scene.pbrt"
    path.write_text(f'{blur}LookAt 1 2 3 4 2 -1 0 1 0 Camera "perspective" WorldBegin {TRIANGLE}')
    pose = load_world(path).camera.motion.pose(0.0)
    np.testing.assert_allclose(pose[:3, 3], (1, 2, -3), atol=1e-9)
    np.testing.assert_allclose(-pose[:3, 2], np.array((3, 0, 4)) / 5, atol=1e-9)
    np.testing.assert_allclose(pose[:3, 1], (0, 1, 0), atol=1e-9)


def test_checkerboards_shift_by_the_files_own_offset(tmp_path):
    """Two squares each way are one image."""
    texture = 'Texture "c" "spectrum" "checkerboard" "float uscale" 3 "float udelta" 0.5 "float vdelta" 0.25\n'
    _, world = material(tmp_path, '"diffuse" "texture reflectance" "c"', before=texture)
    np.testing.assert_allclose(np.array(world.textures[0].uv_matrix) @ (0.25, 0.5, 1), (1.25 / 2, 0.75 / 2))


def test_a_file_that_cannot_be_read_is_told(tmp_path):
    with pytest.raises(InputError, match=r"none\.pbrt: cannot be read"):
        load_pbrt(tmp_path / "none.pbrt")


def test_files_of_older_versions_are_named_as_such(tmp_path):
    path = tmp_path / "old.pbrt"
    path.write_text('WorldBegin\nMaterial "glass"\nShape "sphere"\nWorldEnd\n')
    with pytest.raises(InputError, match=r"old\.pbrt: is a scene of pbrt's version 3 or before, as its WorldEnd shows"):
        load_world(path)
