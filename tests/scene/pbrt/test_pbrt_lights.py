"""How bright pbrt's lights are, and where round shapes lie: pbrt-v4's file format and book."""

import math

import numpy as np
import PIL.Image
import pytest

from clsim.errors import InputError
from clsim.scene.pbrt.shapes import latitude_longitude
from tests.scene.pbrt.test_pbrt import TRIANGLE, load

SPOT = 2 * math.pi * (1 - (math.cos(math.radians(40)) + math.cos(math.radians(50))) / 2)


@pytest.mark.parametrize(
    ("light", "strength"),
    [
        ('"point" "float power" 100', 100 / (4 * math.pi)),
        ('"point" "float power" 100 "float scale" 2 "rgb I" [3 3 3]', 600 / (4 * math.pi)),
        ('"spot" "float coneangle" 50 "float conedeltaangle" 10 "float power" 8', 8 / SPOT),
        ('"distant" "float illuminance" 7 "rgb L" [2 2 2]', 14.0),
        ('"point" "float power" -1', 1.0),
    ],
)
def test_lights_may_tell_their_power_or_illuminance(tmp_path, light, strength):
    world = load(tmp_path, f"LightSource {light} {TRIANGLE}")
    assert world.punctual_lights[0].intensity == pytest.approx((strength,) * 3)
    assert world.warnings == ()


def test_even_skies_add_up_and_may_tell_their_illuminance(tmp_path):
    """An even sky of radiance L gives an illuminance of πL; ``load`` has one of radiance 1 already."""
    world = load(tmp_path, f'LightSource "infinite" "float illuminance" {5 * math.pi} {TRIANGLE}')
    assert world.environment == pytest.approx((6, 6, 6))
    assert world.warnings == ()


def test_of_images_of_the_sky_one_is_used(tmp_path):
    PIL.Image.fromarray(np.full((8, 8, 3), 255, np.uint8)).save(tmp_path / "sky.png")
    sky = 'LightSource "infinite" "string filename" "sky.png" '
    assert load(tmp_path, sky + TRIANGLE).warnings == ()
    for height, width in ((8, 8), (4, 8)):  # a square tells all directions, too
        PIL.Image.fromarray(np.full((height, width, 3), 255, np.uint8)).save(tmp_path / "sky.png")
        assert load(tmp_path, sky + TRIANGLE).environment_map.radiance.shape == (4, 8, 3)
    (warning,) = load(tmp_path, sky + sky + TRIANGLE).warnings
    assert warning.endswith("of several infinite lights with images the last is used")
    (warning,) = load(tmp_path, sky + '"float illuminance" 3 ' + TRIANGLE).warnings
    assert warning.endswith("the illuminance of infinite lights with images is left out")


def test_skies_by_latitude_go_round_z_from_x_over_y():
    """As pbrt-v3 has them: of sixteen columns the fourth and fifth meet at +y, which is above us."""
    columns = np.tile(np.arange(16, dtype=np.float32)[None, :, None], (8, 1, 3))
    sky = latitude_longitude(columns, np.eye(3))
    assert set(sky[0].ravel().tolist()) == {3, 4} and set(sky[-1].ravel().tolist()) == {11, 12}


@pytest.mark.parametrize("factor", [1, 30])
def test_spectra_of_lights_tell_the_colour_alone(tmp_path, factor):
    """pbrt-v4 divides a light by its spectrum's luminance, so ``scale`` alone says how bright it is."""
    told = f'"spectrum I" [400 {factor} 600 {2 * factor} 800 {factor}] "float scale" 3'
    r, g, b = load(tmp_path, f'LightSource "point" {told} {TRIANGLE}').punctual_lights[0].intensity
    assert 0.2126 * r + 0.7152 * g + 0.0722 * b == pytest.approx(3)
    assert load(tmp_path, f'LightSource "point" "spectrum I" [400 0 800 0] {TRIANGLE}').punctual_lights[
        0
    ].intensity == (0, 0, 0)


def test_a_lamp_whose_alpha_is_0_shines_as_in_pbrt(tmp_path):
    world = load(tmp_path, 'AreaLightSource "diffuse" "rgb L" [4 4 4] Shape "sphere" "float alpha" 0')
    lamp = world.materials[world.meshes[0].material_ids[0]]
    assert (lamp.emission, lamp.opacity) == ((4, 4, 4), 1.0)
    assert world.warnings == ("scene.pbrt: lamps whose alpha is 0 are seen",)


def test_what_colours_and_textures_lack_is_told(tmp_path):
    PIL.Image.fromarray(np.full((2, 2, 3), 99, np.uint8)).save(tmp_path / "a.png")
    image = 'Texture "t" "spectrum" "imagemap" "string filename" "a.png" '
    for told, part in (
        ('ColorSpace "rec2020" ', "colours are taken as sRGB's primaries, not rec2020's"),
        (image + '"string encoding" "gamma 2.2" ', "textures with encoding gamma 2.2 are taken as sRGB"),
        (image + '"string wrap" "black" ', "textures with wrap black are clamped"),
        ('Texture "c" "spectrum" "checkerboard" "integer dimension" 3 ', "checkerboards of three dimensions"),
    ):
        (warning,) = load(tmp_path, told + TRIANGLE).warnings
        assert part in warning
    assert load(tmp_path, 'ColorSpace "srgb" ' + image + '"string encoding" "sRGB" ' + TRIANGLE).warnings == ()
    world = load(
        tmp_path, image + '"string encoding" "gamma 2.2" Material "diffuse" "texture reflectance" "t" ' + TRIANGLE
    )
    assert world.textures[0].srgb, "a curve of 2.2 is nearly sRGB's, and far from none"


def placed(tmp_path, shape):
    """Return corners, normals, area and facing of what a shape becomes, in pbrt's own axes."""
    world = load(tmp_path, shape)
    (one,) = world.instances
    mesh, pose = world.meshes[one.mesh], one.motion.pose(0.0)
    back = np.array((1, 1, -1))  # pbrt's z is the other way
    points = (mesh.vertices.astype(float) @ pose[:3, :3].T + pose[:3, 3]) * back
    normals = (mesh.normals.astype(float) @ pose[:3, :3].T) * back
    a, b, c = (points[mesh.triangles[:, k]] for k in range(3))
    cross = -np.cross(b - a, c - a)  # counted in a mirrored space
    return points, normals, np.linalg.norm(cross, axis=1).sum() / 2, cross, (a + b + c) / 3


@pytest.mark.parametrize(
    ("shape", "area"),
    [
        ('"cylinder" "float radius" 2 "float zmin" -1 "float zmax" 4', 2 * math.pi * 2 * 5),
        ('"cylinder" "float radius" 2 "float zmin" 4 "float zmax" -1', 2 * math.pi * 2 * 5),
        ('"cylinder" "float phimax" 90', math.pi / 2 * 2),
        ('"sphere" "float radius" 2 "float zmin" 0', 2 * math.pi * 2 * 2),
        ('"sphere" "float zmin" -0.5 "float zmax" 0.5 "float phimax" 180', math.pi),
        ('"disk" "float radius" 2 "float innerradius" 1 "float height" 3', math.pi * 3),
        ('"disk" "float phimax" 90', math.pi / 4),
    ],
)
def test_parts_of_round_shapes_have_their_area_and_face_outwards(tmp_path, shape, area):
    points, normals, found, cross, middles = placed(tmp_path, f"Shape {shape}")
    assert found == pytest.approx(area, rel=5e-3)
    outwards = np.tile((0.0, 0.0, 1.0), (len(cross), 1)) if "disk" in shape else middles * (1, 1, "sphere" in shape)
    assert (np.einsum("ij,ij->i", cross, outwards) > 0).all()
    expected = np.tile((0.0, 0.0, 1.0), (len(points), 1)) if "disk" in shape else points * (1, 1, "sphere" in shape)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(normals, expected, atol=1e-6)


def test_a_quarter_begins_at_x_and_turns_towards_y(tmp_path):
    points, *_ = placed(tmp_path, 'Shape "cylinder" "float phimax" 90 "float radius" 3')
    assert points[:, :2].min() == pytest.approx(0, abs=1e-6) and points[:, :2].max() == pytest.approx(3)


@pytest.mark.parametrize("told", ['"cylinder" "float radius" 0', '"disk" "float phimax" -5'])
def test_round_shapes_without_size_are_refused(tmp_path, told):
    with pytest.raises(InputError, match="expected more than 0"):
        load(tmp_path, f"Shape {told}")


def test_a_loopsubdiv_is_its_cage_with_smooth_normals(tmp_path):
    cage = '"integer indices" [0 2 1 0 1 3 0 3 2 1 2 3] "point3 P" [0 0 0  1 0 0  0 1 0  0 0 1] "integer levels" 3'
    world = load(tmp_path, f'Shape "loopsubdiv" {cage}')
    mesh = world.meshes[0]
    assert len(mesh.triangles) == 4 and mesh.normals is not None
    assert world.warnings == ("scene.pbrt: a loopsubdiv is not subdivided: it gets smooth normals instead",)


@pytest.mark.parametrize(
    ("told", "warning"),
    [
        ('Shape "sphere" "float raduis" 3', "the raduis of a sphere is left out"),
        ('LightSource "point" "rgb L" [1 2 3]', "the L of a light point is left out"),
        ('AreaLightSource "diffuse" "integer samples" 4', "the samples of a diffuse area light is left out"),
        ('Material "diffuse" "float roughness" 0.1', "the roughness of a material diffuse is left out"),
        ('Material "coateddiffuse" "float g" 0.5', "the g of a material coateddiffuse is left out"),
        ('Texture "t" "spectrum" "constant" "rgb color" [1 1 1]', "the color of a texture constant is left out"),
    ],
)
def test_parameters_that_are_not_known_are_told(tmp_path, told, warning):
    assert load(tmp_path, f"{told} {TRIANGLE}").warnings == (f"scene.pbrt: {warning}",)


def test_what_usual_scenes_tell_is_no_cause_for_warnings(tmp_path):
    head = """LookAt 0 0 -5  0 0 0  0 1 0
Camera "perspective" "float fov" 84 "float focaldistance" 1e6 "float lensradius" 0 "float shutteropen" 0
Film "rgb" "string filename" "a.exr" "integer xresolution" 64 "integer yresolution" 48 "float iso" 250
Sampler "halton" "integer pixelsamples" 64
Integrator "volpath" "integer maxdepth" 15
"""
    body = """Material "coateddiffuse" "rgb reflectance" [.4 .2 .2] "float uroughness" .01 "float vroughness" .01
  "float thickness" .01 "bool remaproughness" true
MakeNamedMaterial "m" "string type" "conductor" "spectrum eta" "metal-Al-eta" "spectrum k" "metal-Al-k"
MakeNamedMaterial "g" "string type" "dielectric" "float eta" 1.33
LightSource "spot" "blackbody I" 5000 "float scale" 3 "point3 from" [0 1 0] "point3 to" [0 0 0] "float coneangle" 20
AttributeBegin AreaLightSource "diffuse" "blackbody L" 6500 "float scale" 50 "bool twosided" true
Shape "sphere" "float radius" 3 AttributeEnd
NamedMaterial "m" Shape "disk" "float radius" 2 "float height" 1
"""
    assert load(tmp_path, body + TRIANGLE, head).warnings == ()


def mixed(tmp_path, told, before=""):
    texture = f'{before} Texture "t" "spectrum" "mix" {told}\n'
    world = load(tmp_path, texture + 'Material "diffuse" "texture reflectance" "t" ' + TRIANGLE)
    return world, world.materials[world.meshes[0].material_ids[0]]


@pytest.mark.parametrize(
    ("told", "color"),
    [
        ('"rgb tex1" [.8 .4 0] "rgb tex2" [0 .4 .4] "float amount" .25', (0.6, 0.4, 0.1)),
        ("", (0.5, 0.5, 0.5)),
        ('"float tex2" .5', (0.25, 0.25, 0.25)),
    ],
)
def test_a_mix_of_colours_is_between_them(tmp_path, told, color):
    world, found = mixed(tmp_path, told)
    assert found.color == pytest.approx(color) and found.texture == -1 and world.warnings == ()


def test_an_image_may_be_the_amount_of_a_mix_or_a_part_of_it(tmp_path):
    PIL.Image.fromarray(np.array([[(0, 0, 0), (255, 255, 255)]], np.uint8)).save(tmp_path / "a.png")
    image = 'Texture "i" "float" "imagemap" "string filename" "a.png"\n'
    _, found = mixed(tmp_path, '"rgb tex1" [1 0 0] "rgb tex2" [0 0 1] "texture amount" "i"', image)
    world, part = mixed(tmp_path, '"texture tex1" "i" "rgb tex2" [0 0 1] "float amount" 1', image)
    assert world.textures[part.texture].pixels[0, :, :3].tolist() == [[0, 0, 255]] * 2
    world, _ = mixed(tmp_path, '"rgb tex1" [1 0 0] "rgb tex2" [0 0 1] "texture amount" "i"', image)
    assert world.textures[found.texture].pixels[0, :, :3].tolist() == [[255, 0, 0], [0, 0, 255]]
    world, _ = mixed(
        tmp_path,
        '"texture tex1" "i" "texture tex2" "j"',
        image + image.replace('"i"', '"j"').replace('"string', '"float scale" 1 "bool invert" true "string'),
    )
    assert world.warnings == ("scene.pbrt: a mix of several images is left out; grey stands in",)
