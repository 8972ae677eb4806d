"""pbrt value by value: defaults and formulas of pbrt-v4's file format and book."""

import gzip
import math

import numpy as np
import PIL.Image
import pytest

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.pictures.images import decode_srgb
from tests.scene.pbrt.test_pbrt import HEAD, TRIANGLE, corners, load, scene


def surface(tmp_path, material, before=""):
    world = load(tmp_path, before + f"Material {material} " + TRIANGLE)
    return world, world.materials[world.meshes[0].material_ids[0]]


@pytest.mark.parametrize("kind", ["spot", "distant"])
@pytest.mark.parametrize("start", [(0, 0, 0), (3, 0, 1), (0, 2, 5)])
def test_lights_shine_to_one_ahead_of_the_origin_unless_told(tmp_path, kind, start):
    """``to`` is (0, 0, 1) wherever ``from`` is (file format, "Lights")."""
    x, y, z = start
    (light,) = load(tmp_path, f'LightSource "{kind}" "point3 from" [{x} {y} {z}] ' + TRIANGLE).punctual_lights
    away = np.array((-x, -y, z - 1)) / math.hypot(x, y, z - 1)  # pbrt's z is the other way
    np.testing.assert_allclose(-light.motion.pose(0.0)[:3, 2], away, atol=1e-6)


@pytest.mark.parametrize(("told", "inner", "outer"), [("", 25, 30), ('"float coneangle" 50', 45, 50)])
def test_spots_fall_off_over_five_degrees_unless_told(tmp_path, told, inner, outer):
    (spot,) = load(tmp_path, f'LightSource "spot" {told} ' + TRIANGLE).punctual_lights
    assert (spot.inner_deg, spot.outer_deg) == (pytest.approx(inner), pytest.approx(outer))


@pytest.mark.parametrize(("width", "height"), [(400, 200), (200, 400), (300, 300)])
def test_the_field_of_view_is_that_of_the_shorter_side(tmp_path, width, height):
    """File format, "Cameras": ``fov`` is "the spread angle of the viewing frustum along the narrower" axis."""
    film = f'Film "rgb" "integer xresolution" {width} "integer yresolution" {height}\n'
    camera = load(
        tmp_path, TRIANGLE, 'LookAt 0 0 -5  0 0 0  0 1 0\nCamera "perspective" "float fov" 40\n' + film
    ).camera
    half_width = math.tan(math.radians(camera.fov_deg / 2))
    assert half_width * min(1, height / width) == pytest.approx(math.tan(math.radians(20)))


def test_images_are_mapped_by_scale_and_delta(tmp_path):
    """UVMapping: (su·u + du, sv·v + dv)."""
    PIL.Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(tmp_path / "a.png")
    told = '"float uscale" 3 "float vscale" -2 "float udelta" 0.25 "float vdelta" 0.7'
    before = f'Texture "t" "spectrum" "imagemap" "string filename" "a.png" {told}\n'
    world, found = surface(tmp_path, '"diffuse" "texture reflectance" "t"', before)
    matrix = np.array(world.textures[found.texture].uv_matrix)
    for u, v in ((0.0, 0.0), (0.3, 0.8), (1.0, 0.5)):
        assert matrix @ (u, v, 1) == pytest.approx((3 * u + 0.25, -2 * v + 0.7))


def facing(tmp_path, before, times):
    """Return on which side of z = 0 the triangle's front is, in pbrt's world."""
    a, b, c = corners(load(tmp_path, before + "ReverseOrientation " * times + TRIANGLE))
    return float(np.sign(np.cross(b - a, c - a)[2]))


def test_each_reversal_turns_the_other_one_back(tmp_path):
    plain, once, twice, thrice = (facing(tmp_path, "", times) for times in range(4))
    assert plain == twice == -once == -thrice != 0
    inside = "AttributeBegin ReverseOrientation " + TRIANGLE + " AttributeEnd "
    a, b, c = corners(load(tmp_path, inside + TRIANGLE), 1)
    assert np.sign(np.cross(b - a, c - a)[2]) == plain, "a block's end takes it back"


@pytest.mark.parametrize(
    ("told", "behind"), [("", False), ('"bool twosided" true', True), ('"bool twosided" false', False)]
)
def test_area_lights_shine_to_both_sides_where_they_are_told_to(tmp_path, told, behind):
    world = load(tmp_path, f'AreaLightSource "diffuse" {told} ' + TRIANGLE)
    assert world.materials[world.meshes[0].material_ids[0]].emits_behind is behind


@pytest.mark.parametrize("radius", [0.5, 3.0])
def test_spheres_are_parametrised_by_their_angles(tmp_path, radius):
    """u = φ / 2π from +x towards +y, v from 0 at −z to 1 at +z (Physically Based Rendering, 6.2.1)."""
    world = load(tmp_path, f'Shape "sphere" "float radius" {radius}')
    (ball,) = world.instances
    mesh, pose = world.meshes[ball.mesh], ball.motion.pose(0.0)
    x, y, z = (mesh.vertices @ pose[:3, :3].T).T * np.array([[1], [1], [-1]]) / radius  # pbrt's z is the other way
    v = 1 - np.arccos(np.clip(z, -1, 1)) / np.pi
    np.testing.assert_allclose(mesh.uvs[:, 1], v, atol=2e-3)
    away = np.hypot(x, y) > 0.05
    turned = mesh.uvs[away, 0] - np.arctan2(y[away], x[away]) / (2 * np.pi)
    np.testing.assert_allclose(turned, np.round(turned), atol=1e-3)
    assert mesh.uvs.min() >= 0 and mesh.uvs.max() <= 1 + 1e-6 and np.ptp(mesh.uvs[:, 0]) == pytest.approx(1, abs=0.02)


@pytest.mark.parametrize("scale", [1.0, 2.5])
def test_the_sky_is_as_bright_as_its_picture_times_its_scale(tmp_path, scale):
    PIL.Image.fromarray(np.full((8, 8, 3), 255, np.uint8)).save(tmp_path / "sky.png")
    body = f'LightSource "infinite" "string filename" "sky.png" "float scale" {scale}\n' + TRIANGLE
    world = load_world(scene(tmp_path, body))
    np.testing.assert_allclose(world.environment_map.radiance, scale, rtol=1e-3)


def test_the_end_of_a_block_of_transforms_takes_back_which_of_them_are_meant(tmp_path):
    """ActiveTransform is part of what TransformBegin and TransformEnd save (file format, "Transformations")."""
    head = 'TransformTimes 0 1\nLookAt 0 0 -5  0 0 0  0 1 0\nCamera "perspective"\n'
    body = "TransformBegin ActiveTransform EndTime TransformEnd Translate 2 0 0 " + TRIANGLE
    world = load_world(scene(tmp_path, 'LightSource "infinite"\n' + body, head))
    start, end = (corners(world, time_s=time_s) for time_s in (0.0, 1.0))
    np.testing.assert_allclose(start, end, atol=1e-6)
    assert start[:, 0].min() == pytest.approx(2)


def test_spectra_are_pairs_of_a_wavelength_and_a_value(tmp_path):
    """A reflectance that is the same at all wavelengths is grey; one of long waves alone is red."""
    _, grey = surface(tmp_path, '"diffuse" "spectrum reflectance" [300 0.25 800 0.25]')
    assert grey.color == pytest.approx((0.25,) * 3, rel=2e-2)
    _, red = surface(tmp_path, '"diffuse" "spectrum reflectance" [300 0 590 0 600 0.8 830 0.8]')
    assert red.color[0] > 0.5 > 0.1 > red.color[2] and math.isfinite(sum(red.color))


@pytest.mark.parametrize("name", ["uv", "st"])
def test_a_mesh_has_its_texture_coordinates_by_either_name(tmp_path, name):
    told = TRIANGLE.rstrip() + f' "point2 {name}" [0 0.25  1 0.5  0.75 1]\n'
    np.testing.assert_allclose(load(tmp_path, told).meshes[0].uvs, [(0, 0.25), (1, 0.5), (0.75, 1)])


@pytest.mark.parametrize(("u", "v"), [(0.0, 0.25), (0.25, 0.0)])
def test_what_is_smooth_along_one_tangent_alone_is_nearly_so(tmp_path, u, v):
    told = f'"conductor" "float uroughness" {u} "float vroughness" {v}'
    _, found = surface(tmp_path, told)
    along = found.alpha * found.stretch, found.alpha / found.stretch
    assert along == pytest.approx([math.sqrt(each) or 0.001 for each in (u, v)])


def test_light_of_day_is_white(tmp_path):
    world = load(tmp_path, 'LightSource "point" "spectrum I" "stdillum-D65" "float scale" 3 ' + TRIANGLE)
    assert world.punctual_lights[0].intensity == (3, 3, 3) and world.warnings == ()


def test_beyond_the_wavelengths_that_a_spectrum_tells_it_is_dark(tmp_path):
    """As pbrt-v4's PiecewiseLinearSpectrum: 0 outside of its range, not its ends."""
    band, whole = "500 1 600 1", "360 0 499 0 500 1 600 1 601 0 830 0"
    for told in ('"diffuse" "spectrum reflectance" [%s]', '"dielectric" "spectrum eta" [%s]'):
        alone, explicit = (surface(tmp_path, told % pairs)[1] for pairs in (band, whole))
        assert (*alone.color, alone.ior) == pytest.approx((*explicit.color, explicit.ior), abs=2e-3)


def test_a_reversal_turns_the_normals_that_a_mesh_tells(tmp_path):
    """ReverseOrientation turns a mesh's N too (pbrt-v4, TriangleMesh), so that it is shaded from the same side."""
    told = TRIANGLE.rstrip() + ' "normal N" [0 0.6 0.8  0 0 1  0.6 0 0.8]\n'
    plain, turned = (load(tmp_path, before + told).meshes[0].normals for before in ("", "ReverseOrientation "))
    np.testing.assert_allclose(turned, -plain)


@pytest.mark.parametrize(("told", "focus_m"), [("", 1e6), ('"float focaldistance" 2.5', 2.5)])
def test_a_lens_is_sharp_far_away_unless_told(tmp_path, told, focus_m):
    head = f'LookAt 0 0 -5  0 0 0  0 1 0\nCamera "perspective" "float lensradius" 0.1 {told}\n'
    lens = load(tmp_path, TRIANGLE, head).camera.lens
    assert (lens.aperture_radius_m, lens.focus_distance_m) == (0.1, focus_m)


def test_what_is_placed_by_the_camera_s_coordinates_is_before_it(tmp_path):
    """CoordSysTransform "camera": +z is ahead of the camera, +y up in its picture."""
    head = 'LookAt 3 4 -5  1 2 3  0 1 0\nCamera "perspective" "float fov" 40\n'
    world = load(tmp_path, 'CoordSysTransform "camera" Translate 0 0 7 ' + TRIANGLE, head)
    seen = np.linalg.inv(world.camera.motion.pose(0.0))
    points = corners(world) @ seen[:3, :3].T + seen[:3, 3]
    expected = [(0, 0, -7), (0, 1, -7), (1, 0, -7)]
    np.testing.assert_allclose(points[np.lexsort(points.round(3).T[::-1])], expected, atol=1e-5)


@pytest.mark.parametrize(("told", "opacity"), [(0.25, 0.25), (0.75, 0.75), (3, 1.0), (-1, 0.0)])
def test_a_shapes_alpha_lets_that_share_of_light_pass(tmp_path, told, opacity):
    world = load(tmp_path, f'Shape "disk" "float alpha" {told}')
    found = world.materials[world.meshes[0].material_ids[0]]
    assert (found.alpha_mode, found.opacity) == ("blend", opacity)


@pytest.mark.parametrize("encoding", ["sRGB", "linear"])
@pytest.mark.parametrize("scale", [1.0, 0.5])
@pytest.mark.parametrize("invert", [False, True])
def test_a_picture_is_inverted_as_light_after_its_scale(tmp_path, encoding, scale, invert):
    """ImageTexture of pbrt-v4: 1 less the decoded texel times its scale, and not less than 0; opacity stays."""
    pixels = np.array([[(255, 128, 0, 255), (60, 200, 90, 255)]], np.uint8)
    PIL.Image.fromarray(pixels[..., :3]).save(tmp_path / "a.png")
    told = f'"float scale" {scale} "bool invert" {str(invert).lower()} "string encoding" "{encoding}"'
    before = f'Texture "t" "spectrum" "imagemap" "string filename" "a.png" {told}\n'
    world, found = surface(tmp_path, '"diffuse" "texture reflectance" "t"', before)
    image = world.textures[found.texture]
    told_light, shown = (
        decode_srgb(p[..., :3] / 255) if encoding == "sRGB" else p[..., :3] / 255 for p in (pixels, image.pixels)
    )
    expected = 1 - scale * told_light if invert else scale * told_light
    np.testing.assert_allclose(shown * found.color, expected, atol=0.005)
    assert (image.pixels[..., 3] == 255).all()


@pytest.mark.parametrize("scale", [1.0, 0.4])
@pytest.mark.parametrize("encoding", ["sRGB", "linear"])
def test_a_picture_of_alpha_counts_by_the_mean_of_its_colours_as_light(tmp_path, encoding, scale):
    pixels = np.array([[(255, 255, 255), (128, 128, 128), (200, 100, 0)]], np.uint8)
    PIL.Image.fromarray(pixels).save(tmp_path / "a.png")
    picture = f'Texture "t" "float" "imagemap" "string filename" "a.png" "string encoding" "{encoding}"'
    picture += f' "float scale" {scale}\n'
    world = load(tmp_path, picture + 'Shape "disk" "texture alpha" "t"')
    found = world.materials[world.meshes[0].material_ids[0]]
    light = decode_srgb(pixels / 255) if encoding == "sRGB" else pixels / 255
    opacity = world.textures[found.opacity_texture].pixels[..., 3] / 255
    np.testing.assert_allclose(opacity, scale * light.mean(axis=2), atol=0.5 / 255)


@pytest.mark.parametrize("encoding", ["sRGB", "linear"])
def test_a_number_is_the_alpha_of_a_picture_that_has_one(tmp_path, encoding):
    """MIPMap of pbrt-v4: a number out of four channels is the last, unless that is 1 everywhere; leaves have it so."""
    pixels = np.array([[(255, 255, 255, 0), (40, 90, 10, 255), (200, 100, 0, 128)]], np.uint8)
    PIL.Image.fromarray(pixels).save(tmp_path / "a.png")
    told = f'"string filename" "a.png" "string encoding" "{encoding}"'
    picture = f'Texture "t" "float" "imagemap" {told} Texture "c" "spectrum" "imagemap" {told}\n'
    world = load(tmp_path, picture + 'Material "diffuse" "texture reflectance" "c" Shape "disk" "texture alpha" "t"')
    found = world.materials[world.meshes[0].material_ids[0]]
    alpha = np.array((0.0, 1.0, 128 / 255))
    opacity = world.textures[found.opacity_texture].pixels[0, :, 3] / 255
    np.testing.assert_allclose(opacity, decode_srgb(alpha) if encoding == "sRGB" else alpha, atol=0.5 / 255)
    assert np.array_equal(world.textures[found.texture].pixels[..., :3], pixels[..., :3]), "colours stay"


@pytest.mark.parametrize("table", ["400 1 2\n700 1 2\n", "400\n700\n", "400 nan\n700 1\n", "400 one\n"])
def test_a_file_that_is_no_table_of_a_spectrum_is_refused(tmp_path, table):
    (tmp_path / "a.spd").write_text(table)
    with pytest.raises(InputError, match=r"a\.spd: is no table of wavelengths and values"):
        load(tmp_path, 'Material "diffuse" "spectrum reflectance" "a.spd" ' + TRIANGLE)


def test_light_goes_to_and_fro_below_a_coat(tmp_path):
    """CoatedDiffuseBxDF is of layers, between which light is reflected as often as it is."""
    _, found = surface(tmp_path, '"coateddiffuse" "rgb reflectance" [0.2 0.4 0.6]')
    assert (found.kind, found.nonlinear, found.color) == ("plastic", True, (0.2, 0.4, 0.6))


@pytest.mark.parametrize("name", ["reflectance", "conductor.reflectance"])
def test_a_coated_conductor_has_its_reflectance_by_either_name(tmp_path, name):
    _, found = surface(tmp_path, f'"coatedconductor" "rgb {name}" [0.2 0.4 0.6]')
    assert (found.kind, found.color, found.eta) == ("conductor", (0.2, 0.4, 0.6), None)


@pytest.mark.parametrize("told", ['"string rendercoordsys" "world"', '"bool disablepixeljitter" true', '"seed" 7'])
def test_options_have_a_value_and_no_name_of_their_own(tmp_path, told):
    """An option is its type and name in one string, and one value (file format, "Options")."""
    assert len(load(tmp_path, TRIANGLE, HEAD + f"Option {told}\n").instances) == 1


PLY = b"""ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 2
"""


def test_meshes_and_included_files_may_be_packed(tmp_path):
    """pbrt-v4 reads any file of its own and any PLY through gzip if the name ends in .gz."""
    (tmp_path / "mesh.ply.gz").write_bytes(gzip.compress(PLY))
    (tmp_path / "part.pbrt.gz").write_bytes(gzip.compress(b'Shape "plymesh" "string filename" "mesh.ply.gz"\n'))
    np.testing.assert_array_equal(
        corners(load(tmp_path, 'Include "part.pbrt.gz"\n')), corners(load(tmp_path, TRIANGLE))
    )


@pytest.mark.parametrize("data", [gzip.compress(PLY)[:-20], b"\x1f\x8b\x08\x00" + bytes(6) + b"\xff" * 9, PLY])
@pytest.mark.parametrize("told", ['Include "a.gz"', 'Shape "plymesh" "string filename" "a.ply.gz"'])
def test_damaged_packed_files_are_named(tmp_path, told, data):
    for name in ("a.gz", "a.ply.gz"):
        (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=r"a(\.ply)?\.gz: is damaged"):
        load(tmp_path, told + "\n" + TRIANGLE)


def test_displacement_is_left_out_with_a_warning(tmp_path):
    (tmp_path / "mesh.ply").write_bytes(PLY)
    world = load(tmp_path, 'Shape "plymesh" "string filename" "mesh.ply" "texture displacement" "bumps"\n')
    assert "scene.pbrt: the displacement of a plymesh is left out" in world.warnings


TWO = """MakeNamedMaterial "a" "string type" "diffuse" "rgb reflectance" [.1 .1 .1]
MakeNamedMaterial "b" "string type" "conductor"
"""


@pytest.mark.parametrize(("amount", "share"), [("", 0.5), ('"float amount" 0.2', 0.2), ('"float amount" 3', 1.0)])
def test_a_mix_has_that_amount_of_the_second(tmp_path, amount, share):
    """MixMaterial of pbrt-v4: the first where the amount is below a random number."""
    told = f'MakeNamedMaterial "m" "string type" "mix" "string materials" ["a" "b"] {amount}\n'
    world = load(tmp_path, TWO + told + 'NamedMaterial "m" ' + TRIANGLE)
    found = world.materials[world.meshes[0].material_ids[0]]
    assert (found.color, world.materials[found.blend_with].kind) == ((0.1, 0.1, 0.1), "conductor")
    assert found.blend_share == pytest.approx(share) and world.warnings == ()


def test_a_texture_may_tell_the_amount(tmp_path):
    PIL.Image.fromarray(np.array([[0, 255]], np.uint8)).save(tmp_path / "a.png")
    texture = 'Texture "t" "float" "imagemap" "string filename" "a.png" "float scale" 0.5\n'
    told = 'Material "mix" "string materials" ["b" "a"] "texture amount" "t"\n'
    world = load(tmp_path, TWO + texture + told + TRIANGLE)
    found = world.materials[world.meshes[0].material_ids[0]]
    assert found.kind == "conductor" and found.blend_share == 0.5
    assert world.textures[found.blend_texture].pixels[0, :, 0].tolist() == [0, 255]


@pytest.mark.parametrize(
    ("told", "part"),
    [('"string materials" ["a"]', "a mix has no two materials"), ('"string materials" ["a" "c"]', "no material 'c'")],
)
def test_a_mix_of_nothing_is_refused(tmp_path, told, part):
    with pytest.raises(InputError, match=part):
        load(tmp_path, TWO + f'Material "mix" {told} {TRIANGLE}')


@pytest.mark.parametrize("seed", range(4))
def test_both_halves_of_a_flat_patch_face_as_it_does_and_cover_it(tmp_path, seed):
    """A bilinear patch has its corners row by row, and faces along du × dv (pbrt's book, "Bilinear patches")."""
    rng = np.random.default_rng(seed)
    corner, u, v = rng.uniform(-1, 1, (3, 3))
    points = np.array([corner, corner + u, corner + v, corner + u + v])
    told = " ".join(f"{each:.9f}" for each in points.ravel())
    uvs = "0 0  1 0  0 1  1 1"
    world = load(tmp_path, f'Shape "bilinearmesh" "point3 P" [{told}] "point2 uv" [{uvs}]')
    mesh = world.meshes[0]
    area = np.zeros(3)
    for a, b, c in mesh.vertices[mesh.triangles].astype(float):
        np.testing.assert_allclose(np.cross(b - a, c - a), np.cross(u, v), atol=1e-5)
        area += np.cross(b - a, c - a) / 2
    np.testing.assert_allclose(area, np.cross(u, v), atol=1e-5)
    np.testing.assert_allclose(corner + mesh.uvs @ np.array([u, v]), mesh.vertices, atol=1e-5)
