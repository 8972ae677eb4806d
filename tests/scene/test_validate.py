"""The checks that every world must pass; each case breaks a good world in one place."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.scene import (
    CheckerTexture,
    ImageTexture,
    Instance,
    Lens,
    Material,
    PunctualLight,
    Sensor,
    SphereLight,
    Static,
    load_world,
    validate,
)

GOOD = load_world("still")
IDENTITY = Static(np.eye(4))
BAD_VERTICES = np.array([(0, 0, 0), (1, np.nan, 0), (0, 1, 0), (1, 1, 0)], np.float32)


def with_mesh(**changes):
    """Return the good world with its first mesh, the floor of four vertices and two triangles, changed."""
    return replace(GOOD, meshes=(replace(GOOD.meshes[0], **changes), *GOOD.meshes[1:]))


def with_camera(**changes):
    return replace(GOOD, camera=replace(GOOD.camera, **changes))


def with_pose(matrix):
    return with_camera(motion=Static(np.asarray(matrix, float)))


def with_material(**changes):
    return replace(GOOD, materials=(replace(GOOD.materials[0], name="", **changes), *GOOD.materials[1:]))


def with_texture(texture):
    """Return the good world with one more texture, which nothing uses."""
    return replace(GOOD, textures=(*GOOD.textures, texture))


def with_spot(**changes):
    """Return the good world with a spot."""
    return replace(GOOD, punctual_lights=(replace(PunctualLight("spot", (1.0, 1.0, 1.0), IDENTITY), **changes),))


PIXELS = np.zeros((2, 3, 4), np.uint8)
LAST = f"texture {len(GOOD.textures)}"


def test_a_good_world_passes():
    validate(GOOD, "file.x")


@pytest.mark.parametrize(
    ("world", "parts"),
    [
        (with_spot(picture_size=(0.0, 1.0)), ["spot light 0", "picture_size is (0.0, 1.0)"]),
        (with_spot(picture_size=(1.0, np.inf)), ["spot light 0", "picture_size is (1.0, inf)"]),
        (with_spot(picture=99), ["spot light 0", "picture is 99"]),
        (with_spot(intensity=(1.0, -1.0, 1.0)), ["spot light 0", "intensity is (1.0, -1.0, 1.0)"]),
        (with_camera(lens=Lens(principal_point=(np.nan, 0.0))), ["camera", "principal_point is (nan, 0.0)"]),
        (with_mesh(vertices=BAD_VERTICES), ["mesh floor", "vertices[1]", "(1, nan, 0)"]),
        (with_mesh(vertices=np.full((4, 3), np.inf, np.float32)), ["mesh floor", "vertices[0]", "inf"]),
        (with_mesh(normals=np.full((4, 3), np.nan, np.float32)), ["mesh floor", "normals[0]"]),
        (with_mesh(uvs=np.zeros((3, 2), np.float32)), ["mesh floor", "uvs", "(3, 2)", "(4, 2)"]),
        (with_mesh(triangles=np.array([(0, 1, 2), (0, 2, 4)], np.int32)), ["mesh floor", "vertex 4", "0 to 3"]),
        (with_mesh(triangles=np.array([(0, 1, 2), (0, 2, -1)], np.int32)), ["mesh floor", "vertex -1"]),
        (with_mesh(material_ids=np.array([0, 9], np.int32)), ["mesh floor", "material"]),
        (with_mesh(triangles=np.zeros((0, 3), np.int32), material_ids=np.zeros(0, np.int32)), ["no triangles"]),
        (with_camera(width=0), ["camera", "width", "0"]),
        (with_camera(fov_deg=180.0), ["camera", "fov_deg", "180"]),
        (with_camera(fov_deg=float("nan")), ["camera", "fov_deg", "nan"]),
        (with_camera(shutter_s=-1.0), ["camera", "shutter_s", "-1"]),
        (with_pose(np.diag((1, 1, -1, 1))), ["camera", "rotation"]),
        (with_pose(np.diag((1, 2, 1, 1))), ["camera", "rotation"]),
        (with_pose(np.full((4, 4), np.nan)), ["camera", "not finite"]),
        (replace(GOOD, instances=(Instance(7, IDENTITY, "ghost"),)), ["object ghost", "mesh 7"]),
        (with_material(kind="velvet"), ["material 0", "'velvet'", "plastic"]),
        (with_material(color=(2, 0, 0)), ["material 0", "color"]),
        (with_material(emission=(-1, 0, 0)), ["material 0", "emission"]),
        (with_material(emission=(0, 1e300, 0)), ["material 0", "emission is (0, 1e+300, 0)", "from 0 to 1e+30"]),
        (replace(GOOD, environment=(1e31, 0, 0)), ["environment", "from 0 to 1e+30"]),
        (with_material(texture=5), ["material 0", "texture is 5", "-1 or one of"]),
        (with_material(emission_texture=99), ["material 0", "emission_texture is 99"]),
        (with_material(roughness_texture=-2), ["material 0", "roughness_texture is -2"]),
        (with_material(normal_texture=len(GOOD.textures)), ["material 0", f"normal_texture is {len(GOOD.textures)}"]),
        (with_material(opacity_texture=1 << 31), ["material 0", "opacity_texture is 2147483648"]),
        (with_material(alpha_mode="cutout"), ["material 0", "alpha_mode is 'cutout'", "opaque, mask, blend"]),
        (with_material(alpha_cutoff=-0.1), ["material 0", "alpha_cutoff is -0.1"]),
        (with_material(alpha_cutoff=float("nan")), ["material 0", "alpha_cutoff is nan"]),
        (with_material(opacity=1.5), ["material 0", "opacity is 1.5"]),
        (with_material(alpha=-0.5), ["material 0", "alpha is -0.5"]),
        (with_material(metallic=float("nan")), ["material 0", "metallic is nan"]),
        (with_material(transmission=2.0), ["material 0", "transmission is 2.0"]),
        (with_material(clearcoat=2.0), ["material 0", "clearcoat is 2.0"]),
        (with_material(clearcoat_alpha=2.0), ["material 0", "clearcoat_alpha is 2.0"]),
        (with_material(ior=0.0), ["material 0", "ior is 0.0", "positive"]),
        (with_material(ior=-1.5), ["material 0", "ior is -1.5"]),
        (with_material(ior=float("inf")), ["material 0", "ior is inf"]),
        (with_material(eta=(0.2, float("nan"), 1.0)), ["material 0", "eta is"]),
        (with_material(k=(-1.0, 0.0, 0.0)), ["material 0", "k is"]),
        (with_material(specular_color=(-1.0, 0.0, 0.0)), ["material 0", "specular_color is"]),
        (with_material(normal_scale=float("inf")), ["material 0", "normal_scale is inf"]),
        (replace(GOOD, materials=(Material(name="brass", ior=0.0), *GOOD.materials[1:])), ["material brass", "ior"]),
        (with_texture(CheckerTexture((0, 0, 0), (0, 2, 0))), [LAST, "color_b is (0, 2, 0)"]),
        (with_texture(CheckerTexture((0, 0, 0), (0, 0, 0), scale=np.nan)), [LAST, "scale is nan"]),
        (with_texture(ImageTexture(PIXELS[..., :3])), [LAST, "uint8 of shape (2, 3, 3)"]),
        (with_texture(ImageTexture(PIXELS[:0])), [LAST, "shape (0, 3, 4)"]),
        (with_texture(ImageTexture(PIXELS.astype(np.float32))), [LAST, "float32"]),
        (with_texture(ImageTexture(PIXELS, wrap_v="tile")), [LAST, "wrap_v is 'tile'", "repeat, clamp, mirror"]),
        (with_texture(ImageTexture(PIXELS, uv_matrix=((np.nan, 0, 0), (0, 1, 0)))), [LAST, "uv_matrix is"]),
        (replace(GOOD, sphere_lights=(SphereLight(0.0, (1, 1, 1), IDENTITY),)), ["sphere light 0", "radius"]),
        (replace(GOOD, sphere_lights=(SphereLight(1.0, (np.inf, 1, 1), IDENTITY),)), ["sphere light 0", "radiance"]),
        (replace(GOOD, sphere_lights=(SphereLight(1.0, (1e31, 1, 1), IDENTITY),)), ["sphere light 0", "to 1e+30"]),
        (replace(GOOD, environment=(0, np.nan, 0)), ["environment", "nan"]),
        (replace(GOOD, sensor=Sensor(threshold_off=0.0)), ["sensor", "threshold_off"]),
        (replace(GOOD, sensor=Sensor(floor=1e-40)), ["sensor: floor is 1e-40, expected at least 1.2e-38"]),
        (replace(GOOD, fps=0.0), ["fps"]),
        (replace(GOOD, duration_s=float("inf")), ["duration_s", "inf"]),
    ],
)
def test_each_fault_is_named_with_file_and_part(world, parts):
    with pytest.raises(InputError) as caught:
        validate(world, "file.x")
    message = str(caught.value)
    assert message.startswith("file.x: ")
    for part in parts:
        assert part in message


@pytest.mark.parametrize("wrong_s", [0.0, 1.0, 2.0])
def test_a_motion_must_have_a_pose_at_its_start_its_middle_and_its_end(wrong_s):
    """One that comes from a program may be wrong at some times and not at others."""
    motion = SimpleNamespace(duration_s=2.0, pose=lambda time_s: np.eye(4) * (np.nan if time_s == wrong_s else 1.0))
    with pytest.raises(InputError, match=f"its pose at {wrong_s:g} s has a number that is not finite"):
        validate(with_camera(motion=motion), "file.x")


def test_several_faults_are_told_together_but_not_without_end():
    meshes = tuple(replace(GOOD.meshes[0], vertices=BAD_VERTICES) for _ in range(50))
    with pytest.raises(InputError) as caught:
        validate(replace(GOOD, meshes=meshes, fps=0.0), "file.x")
    assert len(str(caught.value).splitlines()) == 10


def test_a_long_row_of_pixels_is_no_large_picture():
    validate(with_camera(width=16384, height=4), "scene")


@pytest.mark.parametrize(("model", "widest"), [("perspective", 180.0), ("fisheye", 360.0)])
def test_a_lens_sees_less_than_half_or_all_of_the_directions(model, widest):
    """A pinhole's picture ends at 180°, a fisheye's at 360°."""
    lens = Lens(model=model)
    for fov_deg in (1e-3, 179.0, widest - 1e-3):
        validate(with_camera(lens=lens, fov_deg=fov_deg), "scene")
    for fov_deg in (0.0, widest, widest + 1.0):
        with pytest.raises(InputError, match=f"expected more than 0 and less than {widest:g}"):
            validate(with_camera(lens=lens, fov_deg=fov_deg), "scene")
