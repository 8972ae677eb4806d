"""Textures and normal maps: texels against numpy, and as they show in pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from clsim.render import RenderOptions
from clsim.render.device.devices import start_warp
from clsim.render.surfaces.materials import Materials
from clsim.render.surfaces.plastic_tables import STACK_SIZE, coat, coats
from clsim.render.surfaces.upload_materials import decoding, upload_materials
from clsim.render.textures.textures import make_textures
from clsim.scene import CheckerTexture, ImageTexture, Material, SphereLight, Static
from tests.render import hand_worlds as hw

pytestmark = pytest.mark.usefixtures("anything")
# Those that render compile kernels of their own.
slow = pytest.mark.slow

WRAPS = ("repeat", "clamp", "mirror")


def picture(height, width, seed=0):
    return np.random.default_rng(seed).integers(0, 256, (height, width, 4), dtype=np.uint8)


def textured(*textures):
    """A world whose one material uses the first texture, and others the rest."""
    materials = [Material(texture=i) for i in range(len(textures))]
    squares = [hw.quad((0, 0, -i), (1, 0, 0), (0, 1, 0), material=i) for i in range(len(textures))]
    return hw.world(*squares, materials=materials, textures=textures)


def look_up(world, index, uv):
    """RGBA ``[n, 4]`` as the tracer reads it."""
    start_warp()
    lookup, *_ = make_textures(RenderOptions().features_of(world))

    @wp.kernel(module="unique", enable_backward=False)
    def read(materials: Materials, index: int, uv: wp.array(dtype=wp.vec2), out_rgba: wp.array(dtype=wp.vec4)):
        i = wp.tid()
        out_rgba[i] = lookup(materials.textures, index, uv[i])

    out = wp.empty(len(uv), dtype=wp.vec4, device="cpu")
    points = wp.array(np.asarray(uv, np.float32), dtype=wp.vec2, device="cpu")
    wp.launch(read, len(uv), inputs=[upload_materials(world, "cpu"), index, points], outputs=[out], device="cpu")
    return out.numpy().astype(float)


def linear(texture):
    """Texels as linear numbers, float64 ``[h, w, 4]``, by the standard's formula."""
    x = texture.pixels / 255.0
    if texture.srgb:
        x[..., :3] = np.where(x[..., :3] <= 0.04045, x[..., :3] / 12.92, ((x[..., :3] + 0.055) / 1.055) ** 2.4)
    return x


def wrapped(i, n, wrap):
    if wrap == "repeat":
        return i % n
    if wrap == "clamp":
        return np.clip(i, 0, n - 1)
    return np.where(i % (2 * n) < n, i % (2 * n), 2 * n - 1 - i % (2 * n))


@pytest.mark.parametrize("wrap", WRAPS)
def test_places_beyond_all_numbers_are_some_texel(wrap):
    """Coordinates and transforms of a file may be finite, and their product is not."""
    far = ((3e38, 0.0, 0.0), (0.0, 3e38, 0.0))
    texture = ImageTexture(np.full((2, 2, 4), 255, np.uint8), wrap_u=wrap, wrap_v=wrap, nearest=True, uv_matrix=far)
    np.testing.assert_array_equal(look_up(textured(texture), 0, [(3e38, 3e38), (-3e38, 1.0)]), 1.0)


def reference(texture, uv):
    """Bilinear or nearest filtering of an unbounded grid of texels, in float64."""
    texels = linear(texture)
    h, w = texels.shape[:2]
    u, v = np.asarray(texture.uv_matrix) @ np.column_stack([uv, np.ones(len(uv))]).T
    x, y = u * w, (1 - v) * h
    if texture.nearest:
        rows = wrapped(np.floor(y).astype(int), h, texture.wrap_v)
        return texels[rows, wrapped(np.floor(x).astype(int), w, texture.wrap_u)]
    x0, y0 = np.floor(x - 0.5), np.floor(y - 0.5)
    result = np.zeros((len(uv), 4))
    for dx in (0, 1):
        for dy in (0, 1):
            weight = (1 - np.abs(x - 0.5 - x0 - dx)) * (1 - np.abs(y - 0.5 - y0 - dy))
            rows = wrapped((y0 + dy).astype(int), h, texture.wrap_v)
            columns = wrapped((x0 + dx).astype(int), w, texture.wrap_u)
            result += weight[:, None] * texels[rows, columns]
    return result


@pytest.mark.parametrize("nearest", [False, True])
@pytest.mark.parametrize("wrap_v", WRAPS)
@pytest.mark.parametrize("wrap_u", WRAPS)
def test_filters_and_wraps_as_numpy_does(wrap_u, wrap_v, nearest):
    turned = ((0.8, -0.6, 0.3), (0.9, 1.2, -0.2))
    uv = np.random.default_rng(1).uniform(-3, 3, (2000, 2))
    # All in one world: images of one texel, of odd sizes, and one packed behind others.
    textures = (
        ImageTexture(picture(1, 1), wrap_u=wrap_u, wrap_v=wrap_v, nearest=nearest),
        ImageTexture(picture(5, 3, 1), False, wrap_u, wrap_v, nearest),
        ImageTexture(picture(4, 7, 2), True, wrap_u, wrap_v, nearest, turned),
    )
    for i, texture in enumerate(textures):
        got = look_up(textured(*textures), i, uv)
        expected = reference(texture, uv.astype(np.float32).astype(float))
        if nearest:  # roundings of uv may fall over an edge between texels
            assert (np.abs(got - expected).max(axis=1) < 1e-5).mean() > 0.999
        else:
            np.testing.assert_allclose(got, expected, atol=2e-5)


def test_srgb_is_decoded_exactly_and_alpha_never():
    ramp = np.repeat(np.arange(256, dtype=np.uint8)[None, :, None], 4, axis=2)
    uv = np.column_stack([(np.arange(256) + 0.5) / 256, np.full(256, 0.5)])
    for srgb in (True, False):
        texture = ImageTexture(ramp, srgb=srgb, nearest=True)
        got = look_up(textured(texture), 0, uv)
        np.testing.assert_array_equal(got, linear(texture)[0].astype(np.float32))
        np.testing.assert_array_equal(got[:, 3], (np.arange(256) / 255).astype(np.float32))
    # Values of IEC 61966-2-1 that are published: 0, the middle grey of 188 (a half), 255.
    assert decoding()[256 + np.array([0, 188, 255])] == pytest.approx([0, 0.5028864580325687, 1])


def test_filtering_is_of_light_and_not_of_codes():
    """Between black and white lies half the light, not what the middle code means."""
    stripes = np.array([[[0, 0, 0, 255], [255, 255, 255, 255]]], np.uint8)
    np.testing.assert_allclose(look_up(textured(ImageTexture(stripes)), 0, [(0.5, 0.5)])[0], (0.5, 0.5, 0.5, 1.0))


def test_edges_of_repeated_images_are_exact():
    """u = 1 is u = 0, however it is reached, and nothing outside of the image is read."""
    texture = ImageTexture(picture(3, 3), nearest=False)
    other = ImageTexture(np.full((3, 3, 4), 255, np.uint8))
    edge = [0.0, 1.0, -1e-9, 1 - 1e-7, 1e6, -1e6, 3.0000002]
    uv = np.array([(u, v) for u in edge for v in edge])
    got = look_up(textured(other, texture, other), 1, uv)
    np.testing.assert_allclose(got, reference(texture, uv.astype(np.float32).astype(float)), atol=1e-4)


def facing(material, *textures, **rest):
    """A unit square that fills the view from in front: pixel (0, 0) is u = 0, v = 1."""
    square = hw.quad((-0.5, -0.5, 0), (1, 0, 0), (0, 1, 0))
    view = hw.camera(hw.look_from((0, 0, 100), (0, 0, 0)), 4, 4, fov_deg=np.degrees(2 * np.arctan(0.5 / 100)))
    return hw.world(square, materials=(material,), textures=textures, view=view, **rest)


@slow
def test_the_top_row_of_an_image_is_at_the_top():
    image = ImageTexture(picture(4, 4), nearest=True)
    frame = hw.render(facing(Material(color=(1, 0.5, 1), texture=0), image), spp=4, max_depth=1)
    albedo = np.stack([frame.plane(f"Albedo.{c}") for c in "RGB"], axis=-1)
    np.testing.assert_allclose(albedo, linear(image)[..., :3] * (1, 0.5, 1), rtol=1e-5)


@slow
def test_emission_is_textured_and_lights_as_it_shows():
    """The radiance of the picture, and the same light found by both strategies."""
    image = ImageTexture(picture(4, 4), nearest=True)
    glow = Material(color=(0, 0, 0), emission=(2.0, 3.0, 4.0), emission_texture=0)
    frame = hw.render(facing(glow, image), spp=4, max_depth=1)
    np.testing.assert_allclose(hw.radiance(frame), np.moveaxis(linear(image)[..., :3] * (2, 3, 4), 2, 0), rtol=1e-5)
    floor = hw.quad((-1, 0, 1), (2, 0, 0), (0, 0, -2), material=1)
    lamp = hw.quad((-0.5, 1, -0.5), (1, 0, 0), (0, 0, 1))
    view = hw.camera(hw.look_from((0, 3, 4), (0, 0, 0)), 8, 8, fov_deg=10)
    room = hw.world(lamp, floor, materials=(glow, hw.GREY), textures=(image,), view=view)
    by_light, scattered = (hw.mean_and_error(hw.render(room, spp=512, strategy=s)) for s in ("light", "scatter"))
    assert np.all(np.abs(by_light[0] - scattered[0]) < 4 * np.hypot(by_light[1], scattered[1]))
    assert np.all(by_light[0] > 20 * by_light[1])


@slow
def test_roughness_and_metal_are_textured():
    """Green is perceptual roughness, blue metal; a mirror where green is 0 shows the sky as it is."""
    image = ImageTexture(np.array([[[0, 0, 255, 255], [0, 255, 0, 255]]], np.uint8), srgb=False, nearest=True)
    metal = Material(kind="principled", color=(0.9, 0.6, 0.3), alpha=1.0, metallic=1.0, roughness_texture=0)
    frame = hw.render(facing(metal, image, environment=(1.0, 1.0, 1.0)), spp=64)
    np.testing.assert_allclose(hw.radiance(frame)[:, :, 0], np.transpose([metal.color] * 4), rtol=1e-3)
    assert np.all(hw.radiance(frame)[0, :, 3] < 0.9)


@slow
@pytest.mark.parametrize("nonlinear", [False, True])
def test_plastic_of_textured_roughness_is_plastic_of_that_roughness(nonlinear):
    """Three roughnesses in one picture against a picture of each; smooth, between two tables, and the roughest.

    Seen at 75°, lit from above: what the coat lets through depends on its roughness, and its lobe is elsewhere.
    """
    greens = (0, 140, 255)
    pixels = np.array([[[0, green, 255, 255] for green in (*greens, 255)]], np.uint8)
    image = ImageTexture(pixels, srgb=False, nearest=True)
    plain = Material(kind="plastic", color=(0.9, 0.5, 0.2), nonlinear=nonlinear)
    lamp = SphereLight(0.5, (8.0, 8.0, 8.0), Static(hw.translation(0, 0, 3.5)))
    view = hw.camera(hw.look_from((0, -96.6, 25.9), (0, 0, 0)), 4, 1, fov_deg=np.degrees(2 * np.arctan(0.5 / 100)))

    def seen(material):
        scene = facing(material, image, sphere_lights=(lamp,))
        return hw.radiance(hw.render(hw.with_camera(scene, view), spp=1024))

    several = seen(replace(plain, alpha=0.5, roughness_texture=0))
    shown = []
    for column, green in enumerate(greens):
        alone = replace(plain, alpha=0.5 * (green / 255) ** 2)
        one = seen(alone)
        np.testing.assert_allclose(several[:, :, column], one[:, :, column], rtol=0.01)
        shown.append(one[:, :, column].mean())
    assert np.ptp(shown) > 0.05 * max(shown)


@slow
def test_tables_between_two_roughnesses_are_those_of_the_roughness_between():
    """So that sixteen are enough, from smooth to the roughest coat; only grazing light needs more of the smoothest."""
    passing, inner = coats(1.0, 1.5)
    for step in np.arange(STACK_SIZE - 1):
        expected, expected_inner = coat(max(((step + 0.5) / (STACK_SIZE - 1)) ** 2, 1e-3), 1.5)
        found = (passing[step] + passing[step + 1]) / 2
        np.testing.assert_allclose(found[3:], expected[3:], atol=0.01)
        np.testing.assert_allclose(found[:3], expected[:3], atol=0.035)
        assert (inner[step] + inner[step + 1]) / 2 == pytest.approx(expected_inner, abs=0.006)


@slow
def test_checkers_and_images_live_together():
    checker = CheckerTexture((0.9, 0.8, 0.7), (0.1, 0.2, 0.3), scale=2)
    image = ImageTexture(picture(2, 2), nearest=True)
    world = textured(image, checker)
    uv = [(0.25, 0.25), (0.75, 0.25)]
    np.testing.assert_allclose(look_up(world, 1, uv)[:, :3], (checker.color_a, checker.color_b), rtol=1e-6)
    np.testing.assert_allclose(look_up(world, 0, uv), reference(image, np.array(uv)), rtol=1e-6)


def normal_texture(*normals):
    """An image of one row whose texels are normals."""
    codes = np.round((np.array(normals, float) + 1) / 2 * 255)
    return ImageTexture(np.column_stack([codes, np.full(len(codes), 255)])[None].astype(np.uint8), False, nearest=True)


def shown_normals(frame):
    return np.stack([frame.plane(f"N{c}") for c in "xyz"], axis=-1)


@slow
def test_normal_maps_tilt_to_u_and_v():
    """Red leans to +u, green to +v, in the frame of uv wherever that points."""
    lean = normal_texture((0.6, 0, 0.8), (0, 0.6, 0.8))
    material = Material(normal_texture=0)
    normals = shown_normals(hw.render(facing(material, lean), spp=4))
    np.testing.assert_allclose(normals[:, 0], np.tile((0.6, 0, 0.8), (4, 1)), atol=0.01)
    np.testing.assert_allclose(normals[:, 3], np.tile((0, 0.6, 0.8), (4, 1)), atol=0.01)
    mirrored = facing(replace(material, normal_scale=0.5), lean)
    flipped = replace(mirrored.meshes[0], uvs=mirrored.meshes[0].uvs * np.float32([-1, 1]))
    normals = shown_normals(hw.render(replace(mirrored, meshes=(flipped,)), spp=4))
    expected = np.array((-0.3, 0, 0.8)) / np.hypot(0.3, 0.8)
    np.testing.assert_allclose(normals[:, 3], np.tile(expected, (4, 1)), atol=0.01)
    # Mirrored u turns the frame left-handed; v still points up.
    np.testing.assert_allclose(normals[:, 0], np.tile(expected[[1, 0, 2]] * (1, -1, 1), (4, 1)), atol=0.01)


@slow
def test_a_bump_is_a_dent_from_behind():
    lean = normal_texture((0.6, 0, 0.8))
    scene = facing(Material(normal_texture=0), lean)
    behind = hw.with_camera(scene, hw.camera(hw.look_from((0, 0, -100), (0, 0, 0)), 4, 4, fov_deg=0.4))
    np.testing.assert_allclose(shown_normals(hw.render(behind, spp=4))[1, 1], (-0.6, 0, -0.8), atol=0.01)


@slow
def test_heights_bend_normals_behind_a_surface_as_they_do_before_it():
    """What rises to the right seen from the front is the same slope from behind, and so its other side."""
    ramp = np.repeat(np.linspace(0, 255, 64)[None, :, None], 3, axis=2)
    rising = ImageTexture(np.dstack([ramp, np.full((1, 64, 1), 255)]).astype(np.uint8), False, "clamp", "clamp")
    scene = facing(Material(bump_texture=0, bump_scale=0.3), rising)
    front = shown_normals(hw.render(scene, spp=4))[1, 1]
    behind = hw.with_camera(scene, hw.camera(hw.look_from((0, 0, -100), (0, 0, 0)), 4, 4, fov_deg=0.4))
    assert front[0] < -0.1 and abs(front[1]) < 1e-3 and front[2] > 0.5
    np.testing.assert_allclose(shown_normals(hw.render(behind, spp=4))[1, 1], -front, atol=0.01)


@slow
@pytest.mark.parametrize("uvs", ["none", "point", "line"])
def test_degenerate_tangents_leave_the_normal_alone(uvs):
    scene = facing(Material(normal_texture=0), normal_texture((0.6, 0, 0.8)), environment=(1.0, 1.0, 1.0))
    mesh = scene.meshes[0]
    flat = {"none": None, "point": np.full((4, 2), 0.3, np.float32), "line": mesh.uvs * np.float32([1, 0])}[uvs]
    frame = hw.render(replace(scene, meshes=(replace(mesh, uvs=flat),)), spp=4)
    np.testing.assert_allclose(shown_normals(frame), np.broadcast_to((0, 0, 1.0), (4, 4, 3)), atol=1e-6)
    assert np.all(frame.plane("Samples") == 4)


GLOSSY = ("conductor", "principled", "plastic")


@slow
@pytest.mark.parametrize("kind", ["diffuse", *GLOSSY, "dielectric"])
def test_normal_maps_neither_gain_light_nor_leak_it(kind):
    """White surfaces with wild normals in a white sky; and a lamp behind the plane lights nothing in front."""
    rng = np.random.default_rng(5)
    wild = rng.normal(size=(64, 3)) * (1, 1, 0.5)
    wild = normal_texture(*(wild / np.linalg.norm(wild, axis=1, keepdims=True)))
    white, *others = (
        Material(kind=each, color=(1, 1, 1), alpha=0.3, normal_texture=0, metallic=0.5, ior=1.3)
        for each in (kind, *(GLOSSY if kind in GLOSSY else ()))
    )
    square = hw.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4))
    # With every glossy kind in each of their scenes, out of sight, they share their kernels.
    crumbs = [hw.quad((0, 9, i), (0.01, 0, 0), (0, 0, 0.01), material=1 + i) for i in range(len(others))]
    materials = (white, *others)
    view = hw.camera(hw.look_from((0, 0.7, 2), (0, 0, 0)), 8, 8, fov_deg=20)
    lit = hw.world(square, *crumbs, materials=materials, textures=(wild,), view=view, environment=(1.0, 1.0, 1.0))
    frame = hw.render(lit, spp=256)
    mean, error = hw.mean_and_error(frame)
    assert np.all(mean < 1 + 4 * error) and np.all(mean > 0.05)
    assert np.all(frame.plane("Samples") == 256)
    if kind != "dielectric":
        lamp = hw.quad((-1, -0.5, -1), (2, 0, 0), (0, 0, 2), material=len(materials))
        glow = Material(color=(0, 0, 0), emission=(9, 9, 9))
        behind = hw.world(square, *crumbs, lamp, materials=(*materials, glow), textures=(wild,), view=view)
        assert np.all(hw.radiance(hw.render(behind, spp=64)) == 0)
