"""Blends of materials, and bumps, in worlds whose pictures are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.render.features.scene_features import scene_features
from clsim.scene import ImageTexture, Material, PunctualLight, Static, validate
from tests.render import hand_worlds as hw

WHITE = (1.0, 1.0, 1.0)


def panel(*materials, **more):
    """A square before the camera, of the first material, under an even sky."""
    pose = hw.look_from((0.0, 0.0, 2.0), (0.0, 0.0, 0.0))
    square = hw.quad((-2, -2, 0), (4, 0, 0), (0, 4, 0))
    return hw.world(square, materials=materials, view=hw.camera(pose), environment=WHITE, **more)


def picture(world, **options):
    """Red and green of the light and of the albedo, 16×16 each."""
    frame = hw.render(world, spp=256, **options)
    rows = {"Radiance.R": 0, "Radiance.G": 1} | {f"Albedo.{c}": frame.names.index(f"Albedo.{c}") for c in "RG"}
    return {name: frame.planes[row].astype(np.float64) for name, row in rows.items()}


def test_what_a_blend_is_made_of_is_built_in():
    world = panel(Material(blend_with=1), Material(kind="conductor", blend_with=2), Material(kind="plastic"))
    found = scene_features(world, 0.0)
    assert found.blends and found.kinds == ("diffuse", "conductor", "plastic")
    assert not scene_features(panel(Material()), 0.0).blends
    with pytest.raises(InputError, match="blends with 5, of 1 materials"):
        validate(panel(Material(blend_with=5)), "made")


@pytest.mark.slow
def test_a_chain_of_blends_is_the_mean_of_all():
    """Three matt colours: .6 of the first, .4·.75 of the second and .4·.25 of the third, in light and in albedo."""
    world = panel(
        Material(color=(1.0, 0.0, 0.5), blend_with=1, blend_share=0.4),
        Material(color=(0.0, 1.0, 0.5), blend_with=2, blend_share=0.25),
        Material(color=(0.5, 0.5, 0.5)),
    )
    found = picture(world)
    for channel, expected in (("R", 0.6 + 0.1 * 0.5), ("G", 0.3 + 0.1 * 0.5)):
        assert found[f"Albedo.{channel}"] == pytest.approx(expected, abs=1e-6), "the same in every pixel"
        assert found[f"Radiance.{channel}"].mean() == pytest.approx(expected, rel=0.01)


@pytest.mark.slow
def test_a_mirrors_share_is_seen_whole():
    """A mirror of a share of .26 over black or a rough coat, under an even sky, shows .26 of it and of the coat .74.

    What a mirror reflects has no rival that also finds it. Mitsuba 3.9 sets its chance against the other's density, as
    if both were of a kind, and shows .14 over black.
    """
    mirror = Material(kind="conductor", color=WHITE, alpha=0.0)
    coat = Material(kind="plastic", color=(0.0, 0.0, 0.0), alpha=0.3)
    alone = picture(panel(coat))["Radiance.R"].mean()
    for other, light in ((Material(color=(0.0, 0.0, 0.0)), 0.0), (coat, alone)):
        found = picture(panel(replace(other, blend_with=1, blend_share=0.26), mirror))["Radiance.R"].mean()
        assert found == pytest.approx(0.26 + 0.74 * light, rel=0.01)


@pytest.mark.slow
def test_a_texture_says_where_which_is_seen():
    """The left half has all of the other, the right half a quarter: a byte of 137 is .25 of the light in sRGB."""
    pixels = np.full((1, 2, 4), 255, np.uint8)
    pixels[0, 1, :3] = 137
    halves = ImageTexture(pixels, nearest=True)
    first = Material(color=(1.0, 0.0, 0.0), blend_with=1, blend_share=1.0, blend_texture=0)
    found = picture(panel(first, Material(color=(0.0, 1.0, 0.0)), textures=(halves,)))
    assert found["Albedo.G"][:, :7] == pytest.approx(1.0)
    assert found["Albedo.G"][:, 9:] == pytest.approx(0.25, abs=2e-3)
    assert found["Radiance.R"][:, 9:].mean() == pytest.approx(0.75, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("side", ["u", "v"])
def test_bumps_shade_as_a_slope_does(side):
    """A ramp of heights: 1 m over the 4 m of the texture, so a slope of .25, under a lamp from each side."""
    ramp = np.repeat(np.linspace(0, 255, 256)[None, :], 256, axis=0)
    heights = ramp if side == "u" else ramp[:, ::-1].T
    pixels = np.dstack([np.rint(heights).astype(np.uint8)] * 3 + [np.full((256, 256), 255, np.uint8)])
    texture = ImageTexture(pixels, srgb=False, wrap_u="clamp", wrap_v="clamp")
    material = Material(color=WHITE, bump_texture=0, bump_scale=1.0)

    normal = np.array([-0.25, 0.0, 1.0] if side == "u" else [0.0, -0.25, 1.0]) / np.sqrt(1 + 0.25**2)
    for x, y in ((0.6, 0.0), (-0.6, 0.0), (0.0, 0.6), (0.0, -0.6)):
        towards = np.array([x, y, 0.8])
        pose = hw.look_from(towards, (0.0, 0.0, 0.0), up=(0.3, 0.5, 0.1))
        sun = PunctualLight("directional", (np.pi,) * 3, Static(pose))

        world = replace(panel(material, textures=(texture,)), environment=(0.0, 0.0, 0.0), punctual_lights=(sun,))
        found = picture(world, max_depth=2)["Radiance.R"][4:12, 4:12]
        assert found.mean() == pytest.approx(normal @ towards, rel=0.01), (x, y)
