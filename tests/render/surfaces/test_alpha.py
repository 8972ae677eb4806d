"""Cut-out and translucent surfaces: what is seen through them, what light passes, and repeatability."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.scene import ImageTexture, Material, PunctualLight, SphereLight, Static
from tests.render import hand_worlds as hw

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("anything")]  # kernels of their own are compiled

HALVES = ImageTexture(np.array([[[255, 255, 255, 255], [255, 255, 255, 64]]], np.uint8), nearest=True)
"""Opaque where u < 1/2, a quarter opaque elsewhere."""
GLOW = Material(color=(0, 0, 0), emission=(4.0, 5.0, 6.0))
LEAF = Material(color=(0.5, 0.4, 0.3))


def screen(material, count=1, **rest):
    """Screens one behind the other, a glowing wall behind them all."""
    screens = [hw.quad((-1, -1, -0.1 * i), (2, 0, 0), (0, 2, 0)) for i in range(count)]
    wall = hw.quad((-5, -5, -3), (10, 0, 0), (0, 10, 0), material=1)
    view = hw.camera(hw.look_from((0, 0, 4), (0, 0, 0)), 8, 8, fov_deg=25)
    return hw.world(*screens, wall, materials=(material, GLOW), view=view, textures=(HALVES,), **rest)


@pytest.mark.parametrize(("cutoff", "seen"), [(0.5, True), (0.2, False)])
def test_a_mask_is_all_or_nothing(cutoff, seen):
    cut = replace(LEAF, alpha_mode="mask", alpha_cutoff=cutoff, opacity_texture=0)
    frame = hw.render(screen(cut), spp=8, max_depth=1)
    right = hw.radiance(frame)[:, :, 5:]
    np.testing.assert_allclose(right.mean(axis=(1, 2)), GLOW.emission if seen else (0, 0, 0))
    assert np.all(hw.radiance(frame)[:, :, :3] == 0)
    np.testing.assert_allclose(frame.plane("Depth")[:, 5:].mean(), 7 if seen else 4, rtol=0.02)
    assert np.all(frame.plane("Coverage") == 1)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_blending_shows_each_its_share(count):
    half = replace(LEAF, color=(0, 0, 0), alpha_mode="blend", opacity=0.4)
    mean, error = hw.mean_and_error(hw.render(screen(half, count), spp=1024, max_depth=1))
    expected = 0.6**count * np.array(GLOW.emission)
    assert np.all(np.abs(mean - expected) < 4 * error) and np.all(error < 0.05 * expected)


def test_opacity_is_factor_times_texture():
    both = replace(LEAF, color=(0, 0, 0), alpha_mode="blend", opacity=0.8, opacity_texture=0)
    frame = hw.render(screen(both), spp=4096, max_depth=1)
    for part, opacity in ((slice(0, 3), 0.8), (slice(5, 8), 0.8 * 64 / 255)):
        got = hw.radiance(frame)[0, :, part].mean()
        assert got == pytest.approx(4 * (1 - opacity), abs=4 * 4 * 0.5 / np.sqrt(4096 * 24))


def test_opacity_means_nothing_where_it_is_opaque():
    frame = hw.render(screen(replace(LEAF, opacity=0.1, opacity_texture=0)), spp=8, max_depth=1)
    assert np.all(hw.radiance(frame) == 0)


def shaded_floor(material, **rest):
    """A floor that a screen shades wholly; the radiance of the picture is the floor's."""
    floor = hw.quad((-4, 0, 4), (8, 0, 0), (0, 0, -8), material=1)
    roof = hw.quad((-50, 1.0, -50), (0, 0, 100), (100, 0, 0))
    view = hw.camera(hw.look_from((0, 0.5, 0), (0, 0, 0), up=(0, 0, -1)), 8, 8, fov_deg=0.2)
    return hw.world(floor, roof, materials=(material, replace(LEAF, color=(0.5, 0.5, 0.5))), view=view, **rest)


LIGHTS = {
    "sphere": {"sphere_lights": (SphereLight(0.3, (9, 9, 9), Static(hw.translation(0.3, 3, 0))),)},
    "point": {"punctual_lights": (PunctualLight("point", (9, 9, 9), Static(hw.translation(0.3, 3, 0))),)},
    "sky": {"environment": (1.0, 1.0, 1.0)},
}


@pytest.mark.parametrize("light", LIGHTS)
def test_shadows_let_their_share_of_light_through(light):
    """Direct light through a black screen is exactly what it is without, times 1 − opacity."""
    clear, half = (replace(LEAF, color=(0, 0, 0), alpha_mode="blend", opacity=opacity) for opacity in (0.0, 0.75))
    means = [
        hw.mean_and_error(hw.render(shaded_floor(m, **LIGHTS[light]), spp=512, max_depth=2)) for m in (clear, half)
    ]
    (bright, bright_error), (dim, dim_error) = means
    assert np.all(np.abs(dim - bright * 0.25) < 4 * np.hypot(dim_error, bright_error * 0.25) + 1e-6)
    assert np.all(bright > 0.01)
    shut = replace(half, opacity=1.0)
    # The sky shines in at the edge of the screen, fifty times as far away as it is high.
    edge = 1e-3 if light == "sky" else 0.0
    assert np.all(hw.radiance(hw.render(shaded_floor(shut, **LIGHTS[light]), spp=64, max_depth=2)).mean() <= edge)


@pytest.mark.parametrize("mode", ["mask", "blend"])
def test_every_way_of_finding_light_agrees_behind_leaves(mode):
    """A lamp with holes of its own behind a screen with holes."""
    leaf = replace(LEAF, alpha_mode=mode, opacity_texture=0)
    lamp = replace(GLOW, alpha_mode=mode, opacity_texture=0)
    scene = hw.world(
        hw.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4), material=1),
        hw.quad((-1, 1.0, -1), (2, 0, 0), (0, 0, 2)),
        hw.quad((-0.7, 1.6, -0.7), (1.4, 0, 0), (0, 0, 1.4), material=2),
        materials=(leaf, LEAF, lamp),
        textures=(HALVES,),
        view=hw.camera(hw.look_from((0, 0.8, 3), (0, 0.2, 0)), 12, 12, fov_deg=40),
    )
    results = [
        hw.mean_and_error(hw.render(scene, spp=256, seed=i, strategy=s, threads=2))
        for i, s in enumerate(("mis", "light", "scatter"))
    ]
    for other, error in results[1:]:
        assert np.all(np.abs(other - results[0][0]) < 4 * np.hypot(error, results[0][1]))
    assert np.all(results[0][1] < 0.05 * results[0][0])


def test_still_leaves_stay_still():
    half = replace(LEAF, alpha_mode="blend", opacity=0.4)
    scene = screen(half, 3, environment=(0.2, 0.2, 0.2))
    first, later = (hw.render(scene, index, spp=4).planes for index in (0, 9))
    np.testing.assert_array_equal(first, later)
    np.testing.assert_array_equal(first, hw.render(scene, spp=4, threads=2, tile_pixels=5).planes)


def test_a_ray_ends_among_endless_layers():
    """Clear screens, more than any ray looks through: the picture is finite, and so is the time."""
    clear = replace(LEAF, alpha_mode="blend", opacity=0.0)
    screens = hw.join([hw.quad((-1, -1, -0.001 * i), (2, 0, 0), (0, 2, 0)) for i in range(400)])
    view = hw.camera(hw.look_from((0, 0, 4), (0, 0, 0)), 4, 4, fov_deg=10)
    frame = hw.render(hw.world(screens, materials=(clear,), view=view, environment=(1.0, 1.0, 1.0)), spp=2)
    assert np.isfinite(frame.planes[:12]).all()


@pytest.mark.parametrize("strategy", ["light", "scatter"])
def test_shadow_rays_end_after_as_many_layers_as_others(strategy):
    """A glowing ceiling above clear panes, found one way or the other: 250 panes change nothing, 300 shut it off."""

    def lit(count):
        panes = [hw.quad((-2, 0.5 + 1e-3 * i, -2), (0, 0, 4), (4, 0, 0)) for i in range(count)]
        ceiling = hw.quad((-1, 0.9, -1), (2, 0, 0), (0, 0, 2), material=2)
        floor = hw.quad((-0.1, 0, 0.1), (0.2, 0, 0), (0, 0, -0.2), material=1)
        view = hw.camera(hw.look_from((0, 0.4, 0), (0, 0, 0), up=(0, 0, -1)), 2, 2, fov_deg=0.2)
        clear = replace(LEAF, alpha_mode="blend", opacity=0.0)
        scene = hw.world(floor, ceiling, hw.join([floor, *panes]), materials=(clear, LEAF, GLOW), view=view)
        return hw.radiance(hw.render(scene, spp=64, max_depth=2, strategy=strategy))

    none = lit(0)
    assert np.all(none > 0.1)
    np.testing.assert_allclose(lit(250), none, rtol=1e-3)
    assert np.all(lit(300) == 0)


def test_first_hits_do_not_see_the_colour_of_what_is_cut_out():
    """Squares of leaf between squares of black air, many a pixel: what is hit is leaf and nothing else."""
    pixels = np.zeros((64, 64, 4), np.uint8)
    pixels[np.kron(np.indices((16, 16)).sum(axis=0) % 2, np.ones((4, 4))) == 1] = (200, 100, 50, 255)
    leaves = ImageTexture(pixels, srgb=False, nearest=True, uv_matrix=((8.0, 0.0, 0.0), (0.0, 8.0, 0.0)))
    cut = replace(LEAF, color=(1.0, 1.0, 1.0), texture=0, alpha_mode="mask", opacity_texture=0)
    wall = hw.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    view = hw.camera(hw.translation(0, 0, 5), 6, 6, fov_deg=10.0)
    frame = hw.render(
        hw.world(wall, materials=(cut,), view=view, textures=(leaves,)), spp=1, first_hit_rays=64, variances=False
    )
    assert frame.plane("Coverage").mean() == pytest.approx(0.5, abs=0.1)
    for name, value in zip(("Albedo.R", "Albedo.G", "Albedo.B"), (200, 100, 50), strict=True):
        np.testing.assert_allclose(frame.plane(name), value / 255, rtol=1e-3)
