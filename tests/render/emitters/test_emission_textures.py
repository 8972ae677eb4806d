"""How brightly textured surfaces emit on average, triangle by triangle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.render.emitters.emission_textures import mean_emission
from clsim.scene import CheckerTexture, ImageTexture, Material
from tests.render import hand_worlds as hw


def screen(texture, emission=(2.0, 2.0, 2.0)):
    glow = Material(emission=emission, emission_texture=0)
    return hw.world(hw.quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), materials=(glow,), textures=(texture,))


def test_a_checkerboard_emits_half_of_both_colours():
    world = screen(CheckerTexture((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), 8.0))
    np.testing.assert_allclose(mean_emission(world, world.meshes[0]), [1.0, 1.0], rtol=0.08)


@pytest.mark.parametrize("srgb", [True, False])
def test_a_gradient_emits_its_integral_over_each_triangle(srgb):
    """The lower right triangle of 0 … 1 along u has the mean 2/3, the upper left one 1/3; of sRGB the curve's."""
    ramp = np.arange(256) / 255
    pixels = np.zeros((4, 256, 4), np.uint8)
    pixels[..., :3] = np.arange(256)[None, :, None]
    world = screen(ImageTexture(pixels, srgb=srgb))
    light = np.where(ramp <= 0.04045, ramp / 12.92, ((ramp + 0.055) / 1.055) ** 2.4) if srgb else ramp
    expected = 2 * 2 * np.array([(light * ramp).mean(), (light * (1 - ramp)).mean()])
    np.testing.assert_allclose(mean_emission(world, world.meshes[0]), expected, rtol=0.02)


@pytest.mark.parametrize(("wrap_u", "wrap_v", "whole"), [("repeat", "clamp", 0.75), ("clamp", "repeat", 0.5)])
def test_each_axis_of_an_image_goes_on_in_its_own_way(wrap_u, wrap_v, whole):
    """Its upper half shines, and it is half as high as the screen."""
    pixels = np.full((2, 2, 4), 255, np.uint8)
    pixels[1] = 0
    world = screen(ImageTexture(pixels, wrap_u=wrap_u, wrap_v=wrap_v, uv_matrix=((1.0, 0.0, 0.0), (0.0, 2.0, 0.0))))
    assert mean_emission(world, world.meshes[0]).mean() == pytest.approx(2.0 * whole, rel=0.05)


@pytest.mark.parametrize("wrap", ["repeat", "mirror", "clamp"])
@pytest.mark.filterwarnings("error")
def test_places_beyond_all_numbers_are_some_place(wrap):
    pixels = np.full((2, 2, 4), 255, np.uint8)
    far = ImageTexture(pixels, wrap_u=wrap, wrap_v=wrap, uv_matrix=((1e308, 1e308, 0.0), (0.0, 1e308, 1e308)))
    for texture in (far, CheckerTexture((1.0,) * 3, (1.0,) * 3, 1e308)):
        world = screen(texture)
        huge = replace(world.meshes[0], uvs=world.meshes[0].uvs * np.float32(1e38))
        np.testing.assert_allclose(mean_emission(world, huge), 2.0)


def test_a_dark_part_of_a_screen_keeps_a_little_and_what_does_not_emit_none():
    world = screen(CheckerTexture((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    dark = mean_emission(world, world.meshes[0])
    assert np.all((dark > 0) & (dark < 0.1))
    still = screen(CheckerTexture((1.0,) * 3, (1.0,) * 3), emission=(0.0, 0.0, 0.0))
    np.testing.assert_array_equal(mean_emission(still, still.meshes[0]), 0.0)


@pytest.mark.slow  # kernels of their own are compiled; those that tests share take no lamp for whole
def test_a_lamp_with_holes_lights_as_what_is_left_of_it():
    half = ImageTexture(np.array([[[255, 255, 255, 255], [255, 255, 255, 0]]], np.uint8), nearest=True)
    whole, left = (hw.quad((-1, 1.5, -1), (wide, 0, 0), (0, 0, 2), material=1) for wide in (2, 1))
    glow = Material(color=(0, 0, 0), emission=(4.0, 5.0, 6.0))
    found = []
    for lamp, material in ((whole, replace(glow, alpha_mode="mask", opacity_texture=0)), (left, glow)):
        floor = hw.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4))
        view = hw.camera(hw.look_from((0, 0.5, 0), (0, 0, 0), up=(0, 0, -1)), 8, 8, fov_deg=20)
        world = hw.world(floor, lamp, materials=(Material(), material), textures=(half,), view=view)
        found.append(hw.mean_and_error(hw.render(world, spp=256, max_depth=2)))
    (holed, holed_error), (cut, cut_error) = found
    assert np.all(np.abs(holed - cut) < 4 * np.hypot(holed_error, cut_error)) and np.all(cut > 20 * cut_error)
