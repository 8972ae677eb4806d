"""What pbrt-v4 does where few look: its sources say it, where the file format does not."""

import math

import numpy as np
import PIL.Image
import pytest

from tests.scene.pbrt.test_pbrt import TRIANGLE, corners, load

LAMP = 'AreaLightSource "diffuse" "rgb L" [1 2 3]\n'
PATCH = 'Shape "bilinearmesh" "point3 P" [0 0 0  1 0 0  0 1 0  1 1 {}]\n'
TWO = 'Texture "t" "float" "constant" "float value" 0.25\nTexture "t" "spectrum" "constant" "rgb value" [0.9 0.1 0.2]\n'


def material(world, k=0):
    mesh = world.meshes[world.instances[k].mesh]
    return world.materials[mesh.material_ids[0]]


@pytest.mark.parametrize(("begin", "end"), [("TransformBegin", "TransformEnd"), ("AttributeBegin", "AttributeEnd")])
def test_the_end_of_a_block_takes_back_all_that_was_set_in_it(tmp_path, begin, end):
    """Since version 4 both kinds of blocks are one (parser.cpp)."""
    inside = f'{begin}\nMaterial "conductor"\n{LAMP}ReverseOrientation\nTranslate 1 2 3\n{end}\n'
    world = load(tmp_path, inside + TRIANGLE)
    assert material(world).kind == "diffuse" and not any(material(world).emission)
    np.testing.assert_array_equal(corners(world), corners(load(tmp_path, TRIANGLE)))


@pytest.mark.parametrize(("directive", "moved", "kind"), [("Include", 5, "conductor"), ("Import", 0, "diffuse")])
def test_what_an_imported_file_sets_ends_with_it(tmp_path, directive, moved, kind):
    """Import has a copy of the state, Include the state itself (parser.cpp: CopyForImport)."""
    (tmp_path / "deeper.pbrt").write_text("Translate 0 0 0\n")
    (tmp_path / "part.pbrt").write_text(f'Translate 5 0 0\nMaterial "conductor"\n{TRIANGLE}Include "deeper.pbrt"\n')
    world = load(tmp_path, f'{directive} "part.pbrt"\n{TRIANGLE}')
    assert [corners(world, k)[0, 0] for k in (0, 1)] == [5, moved]
    assert [material(world, k).kind for k in (0, 1)] == ["conductor", kind]


def test_lenses_and_pixels_are_as_large_as_the_camera_s_transform_makes_them(tmp_path):
    """Rays are made in the camera's space, and then transformed (cameras.cpp)."""
    camera = 'Camera "perspective" "float fov" 90 "float lensradius" 0.1 "float focaldistance" 4\n'
    film = 'Film "rgb" "integer xresolution" 100 "integer yresolution" 100\n'
    seen = load(tmp_path, TRIANGLE, "Scale 0.5 0.25 0.2\nLookAt 0 0 -5  0 0 0  0 1 0\n" + camera + film).camera
    # In the world, the camera's units are 2, 4 and 5 long: its corner's ray (1, 1, 1) is (2, 4, 5).
    assert math.tan(math.radians(seen.fov_deg / 2)) == pytest.approx(2 / 5)
    fx, fy = seen.focal_px()
    assert (50 / fx, 50 / fy) == pytest.approx((2 / 5, 4 / 5))
    assert (seen.lens.aperture_radius_m, seen.lens.focus_distance_m) == pytest.approx((0.1 * 2, 4 * 5))


def shown(tmp_path, shape, x, y):
    """Return the texture coordinates that a shape has at a place of its plane."""
    PIL.Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(tmp_path / "a.png")
    image = (
        'Texture "t" "spectrum" "imagemap" "string filename" "a.png"\nMaterial "diffuse" "texture reflectance" "t"\n'
    )
    mesh = load(tmp_path, image + shape).meshes[0]
    for triangle in mesh.triangles:
        a, b, c = mesh.vertices[triangle, :2].astype(float)
        s, t = np.linalg.solve(np.stack([b - a, c - a], axis=1), (x - a[0], y - a[1]))
        if min(s, t, 1 - s - t) >= 0:
            return (1 - s - t, s, t) @ mesh.uvs[triangle]
    raise AssertionError("nothing there")


def test_pictures_lie_on_meshes_without_coordinates_as_in_pbrt(tmp_path):
    """Corners of triangles are (0, 0), (1, 0), (1, 1), and those of patches have their parameters (shapes.h)."""
    assert shown(tmp_path, TRIANGLE, 0.2, 0.3) == pytest.approx((0.5, 0.3))
    assert shown(tmp_path, PATCH.format(0), 0.2, 0.3) == pytest.approx((0.2, 0.3))
    assert shown(tmp_path, PATCH.format(0), 0.8, 0.3) == pytest.approx((0.8, 0.3))
    both = TRIANGLE.replace("[0 1 2]", "[0 1 2 2 1 3]").replace("0 1 0]", "0 1 0  1 1 0]")
    assert shown(tmp_path, both, 0.9, 0.6) == pytest.approx((1.0 - 0.1, 1.0 - 0.1 - 0.4))


def test_a_curved_patch_bulges_as_its_parameters_say(tmp_path):
    """The point of parameters u and v of corners at z = 0, 0, 0 and 1 has z = u·v."""
    mesh = load(tmp_path, PATCH.format(1)).meshes[0]
    x, y, z = mesh.vertices.T
    np.testing.assert_allclose(z, x * y, atol=1e-6)
    middles = mesh.vertices[mesh.triangles].mean(axis=1)
    np.testing.assert_allclose(middles[:, 2], middles[:, 0] * middles[:, 1], atol=0.01)
    across = np.stack([-y, -x, np.ones_like(x)], axis=1)  # of z − x·y
    np.testing.assert_allclose(mesh.normals, across / np.linalg.norm(across, axis=1, keepdims=True), atol=1e-5)
    assert len(load(tmp_path, PATCH.format(0)).meshes[0].triangles) == 2


def test_a_number_and_a_colour_may_have_the_same_name(tmp_path):
    """Textures of numbers and of colours are named apart (paramdict.h)."""
    first, second = TWO.splitlines()
    for told in (f"{first}\n{second}\n", f"{second}\n{first}\n"):
        rough = material(load(tmp_path, f'{told}Material "conductor" "texture roughness" "t"\n{TRIANGLE}'))
        assert rough.alpha == pytest.approx(0.5)
        matt = material(load(tmp_path, f'{told}Material "diffuse" "texture reflectance" "t"\n{TRIANGLE}'))
        assert matt.color == (0.9, 0.1, 0.2)
        cut = TRIANGLE.rstrip() + ' "texture alpha" "t"\n'
        assert material(load(tmp_path, told + cut)).opacity == pytest.approx(0.25)


@pytest.mark.parametrize("reverse", ["", "ReverseOrientation\n"])
@pytest.mark.parametrize("z", [1, -1])
def test_a_lamp_shines_to_where_its_normals_point(tmp_path, z, reverse):
    """Where a mesh tells normals, the order of its corners says nothing (shapes.h: FaceForward)."""
    told = TRIANGLE.rstrip() + f' "normal N" [0 0 {z}  0 0 {z}  0 0 {z}]\n'
    world = load(tmp_path, LAMP + reverse + told)
    a, b, c = corners(world)
    front = np.cross(b - a, c - a)[2]  # pbrt's z is the other way
    assert np.sign(front) == (-z if not reverse else z) and not material(world).emits_behind


def test_lamps_without_a_surface_or_within_objects_do_not_shine(tmp_path):
    """As in pbrt, which warns of both (scene.cpp)."""
    world = load(tmp_path, f'Material "interface"\n{LAMP}{TRIANGLE}')
    assert not any(material(world).emission)
    world = load(tmp_path, f'ObjectBegin "o"\n{LAMP}{TRIANGLE}ObjectEnd\nObjectInstance "o"\n')
    assert not any(material(world).emission)
    assert [w.partition(": ")[2] for w in world.warnings] == ["area lights within objects do not shine, as in pbrt"]


def test_what_nothing_reads_of_a_sky_is_told(tmp_path):
    (warning,) = load(tmp_path, 'LightSource "infinite" "string mapname" "sky.exr"\n' + TRIANGLE).warnings
    assert "the mapname of a light infinite is left out" in warning


@pytest.mark.parametrize(
    ("name", "x", "y"),
    [("stdillum-A", 0.44757, 0.40745), ("stdillum-F11", 0.38052, 0.37713), ("stdillum-D50", 0.34567, 0.3585)],
)
def test_named_illuminants_have_their_chromaticity(tmp_path, name, x, y):
    """CIE 015, back from Rec. 709 by the matrix of IEC 61966-2-1; their luminance is 1."""
    (light,) = load(tmp_path, f'LightSource "point" "spectrum I" "{name}"\n{TRIANGLE}').punctual_lights
    to_xyz = np.array([(0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505)])
    seen = to_xyz @ light.intensity
    assert seen[1] == pytest.approx(1, abs=2e-3)
    assert seen[:2] / seen.sum() == pytest.approx((x, y), abs=1e-3)
