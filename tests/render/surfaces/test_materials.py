"""Materials in pictures: every way of finding light agrees, mirrors and glass show what they should."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.scene import CheckerTexture, Material, PunctualLight, SphereLight, Static
from tests.render import hand_worlds as hw

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("anything")]  # kernels of their own are compiled

WHITE = (1.0, 1.0, 1.0)
GLOW = Material(color=(0, 0, 0), emission=(4.0, 5.0, 6.0), emits_behind=False)
ROUGH = {
    "conductor": Material(kind="conductor", color=(0.9, 0.7, 0.5), alpha=0.3),
    "dielectric": Material(kind="dielectric", color=WHITE, alpha=0.3),
    "plastic": Material(kind="plastic", color=(0.7, 0.5, 0.3), alpha=0.3),
    "plastic smooth": Material(kind="plastic", color=(0.7, 0.5, 0.3)),
    "principled": Material(kind="principled", color=(0.7, 0.5, 0.3), alpha=0.2, clearcoat=0.5, clearcoat_alpha=0.1),
    "principled pane": Material(kind="principled", color=(0.7, 0.5, 0.3), alpha=0.3, transmission=0.8),
}


def room(material, others=(), **rest):
    """A ball of the material on a grey floor under a lamp; other materials are there, but nowhere to be seen."""
    crumbs = [hw.quad((0, -0.7, 0.01 * i), (0.01, 0, 0), (0, 0, 0.01), material=3 + i) for i in range(len(others))]
    return hw.world(
        hw.quad((-2, -0.6, 2), (4, 0, 0), (0, 0, -4), material=1),
        hw.ball(0.6, rings=8),
        hw.quad((-0.7, 1.5, -0.7), (1.4, 0, 0), (0, 0, 1.4), material=2),
        *crumbs,
        materials=(material, hw.GREY, GLOW, *others),
        view=hw.camera(hw.look_from((0.3, 1, 3), (0, 0.2, 0)), 12, 12, fov_deg=35),
        **rest,
    )


@pytest.mark.parametrize("name", ROUGH)
def test_every_way_of_finding_light_agrees(name):
    """Over materials that are rough and, with smooth plastic, both rough and mirror; in front of and behind glass."""
    lamp = SphereLight(0.4, (3.0, 3.0, 3.0), Static(hw.translation(-1.2, 0.6, 0.8)))
    # With all materials in each scene, all scenes share their kernels.
    scene = room(ROUGH[name], tuple(ROUGH.values()), sphere_lights=(lamp,))
    results = {
        strategy: hw.mean_and_error(hw.render(scene, spp=400, seed=seed, strategy=strategy, threads=2))
        for seed, strategy in enumerate(("mis", "light", "scatter"))
    }
    mean, error = results["mis"]
    assert np.all(error < 0.05 * mean)
    for strategy in ("light", "scatter"):
        other, other_error = results[strategy]
        assert np.all(np.abs(other - mean) < 4 * np.hypot(error, other_error)), strategy


@pytest.mark.parametrize("kind", ["dielectric", "thin-dielectric"])
def test_white_glass_vanishes_in_a_white_sky(kind):
    """Radiance shrinks by η² on the way in and grows by it on the way out; roulette must not mind."""
    view = hw.camera(hw.look_from((1.0, 1.5, 3), (0, 0, 0)))
    # In a block, unlike a ball of facets, no ray is caught for long.
    block = hw.box((-0.5, -0.4, -0.3), (0.5, 0.4, 0.3))
    for alpha in (0.0, 0.2):
        glass = Material(kind=kind, color=WHITE, alpha=alpha)
        scene = hw.world(block, materials=(glass,), view=view, environment=WHITE)
        for start in (3, 1000):
            mean, error = hw.mean_and_error(hw.render(scene, spp=256, max_depth=100, roulette_start=start))
            assert np.all(mean < 1 + 4 * error + 1e-5)
            if alpha == 0 or kind == "thin-dielectric":
                assert np.all(mean > 1 - 4 * error - 1e-4), (alpha, start)
            assert np.all(mean > 0.9)


def test_a_pane_dims_and_mirrors_as_fresnel_says():
    """Straight through a pane of index 1.5: T = 1 − 2R / (1 + R), R = 0.04; the rest is the black room's reflection."""
    wall = hw.quad((-5, -5, -3), (10, 0, 0), (0, 10, 0), material=1)
    pane = hw.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    glow = replace(GLOW, emits_behind=True)
    for kind in ("thin-dielectric", "principled"):
        glass = Material(kind=kind, color=WHITE, transmission=1.0)
        view = hw.camera(hw.look_from((0, 0, 2), (0, 0, 0)), 8, 8, fov_deg=1.0)
        mean, error = hw.mean_and_error(hw.render(hw.world(pane, wall, materials=(glass, glow), view=view), spp=512))
        share = 1 - 0.08 / 1.04 if kind == "thin-dielectric" else 0.96
        assert np.all(np.abs(mean - share * np.array(glow.emission)) < 4 * error)


@pytest.mark.parametrize("kind", ["principled", "dielectric"])
def test_lamps_behind_rough_panes_are_found_both_ways(kind):
    pane = hw.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    lamp = hw.quad((-0.5, -0.5, -1), (1, 0, 0), (0, 1, 0), material=1)
    # Panes of both kinds, out of sight, so that the two scenes share their kernels.
    crumbs = [hw.quad((50, 0, i), (0.01, 0, 0), (0, 0.01, 0), material=2 + i) for i in range(2)]
    rough, *both = (
        Material(kind=each, color=WHITE, alpha=0.3, ior=1.2, transmission=1.0)
        for each in (kind, "principled", "dielectric")
    )
    view = hw.camera(hw.look_from((0, 0, 3), (0, 0, 0)), 8, 8, fov_deg=10)
    scene = hw.world(pane, lamp, *crumbs, materials=(rough, replace(GLOW, emits_behind=True), *both), view=view)
    by_light, scattered, mis = (
        hw.mean_and_error(hw.render(scene, spp=512, seed=i, strategy=strategy))
        for i, strategy in enumerate(("light", "scatter", "mis"))
    )
    for mean, error in (by_light, scattered):
        assert np.all(np.abs(mean - mis[0]) < 4 * np.hypot(error, mis[1]))
    assert np.all(mis[0] > 0.5) and np.all(mis[1] < 0.05 * mis[0])


def test_light_comes_back_through_single_sided_glass():
    """A one-sided material that passes light must not be black from within."""
    glass = Material(kind="principled", color=WHITE, transmission=1.0, back="black")
    view = hw.camera(hw.look_from((0, 0.5, 4), (0, 0, 0)))
    scene = hw.world(hw.ball(1.0), materials=(glass,), view=view, environment=WHITE)
    np.testing.assert_allclose(hw.radiance(hw.render(scene, spp=64, max_depth=60)).mean(), 1.0, rtol=0.01)


def test_a_point_light_shines_on_gloss_and_not_in_mirrors():
    lamp = PunctualLight("point", (9.0, 9.0, 9.0), Static(hw.translation(0, 2, 2)))
    plate = hw.quad((-1, 0, 1), (2, 0, 0), (0, 0, -2))
    view = hw.camera(hw.look_from((0, 2, -2), (0, 0, 0)), 8, 8, fov_deg=20)
    for alpha, lit in ((0.3, True), (0.0, False)):
        metal = Material(kind="conductor", color=WHITE, alpha=alpha)
        frame = hw.render(hw.world(plate, materials=(metal,), view=view, punctual_lights=(lamp,)), spp=16)
        assert np.all((hw.radiance(frame) > 0) == lit)


CHECKS = CheckerTexture((0.9, 0.8, 0.7), (0.1, 0.2, 0.3), scale=1.0)


def mirrored_wall(glass, **rest):
    """A plate at 45° that shows a wall on the right; beyond the plate nothing."""
    plate = hw.quad((-1, -1, 1), (2, 0, -2), (0, 2, 0))
    wall = hw.quad((3, -9, 9), (0, 0, -18), (0, 18, 0), material=1)
    wall = replace(wall, uvs=np.array([[0, 0], [18, 0], [18, 18], [0, 18]], np.float32))
    view = hw.camera(hw.look_from((0, 0, 4), (0, 0, 0)), 8, 8, fov_deg=8)
    materials = (glass, Material(color=WHITE, texture=0))
    return hw.world(plate, wall, materials=materials, textures=(CHECKS,), view=view, **rest)


def test_features_follow_a_mirror():
    """A ray straight ahead meets the plate at distance 4, turns to +x, and the wall 3 further on."""
    silver = Material(kind="conductor", color=(0.9, 0.8, 0.7))
    frame = hw.render(mirrored_wall(silver), spp=64)
    assert np.all(np.abs(frame.plane("Depth") - 7) < 0.6)
    np.testing.assert_allclose(frame.plane("Nx"), -1, atol=1e-5)
    albedo = np.stack([frame.plane(f"Albedo.{c}") for c in "RGB"], axis=-1)
    colors = np.array([CHECKS.color_a, CHECKS.color_b]) * silver.color
    nearest = np.abs(albedo[:, :, None] - colors).max(axis=-1).min(axis=-1)
    assert (nearest < 0.02).mean() > 0.5
    assert np.all(frame.plane("Coverage") == 1)


def test_features_of_the_mirror_itself_on_request():
    silver = Material(kind="conductor", color=(0.9, 0.8, 0.7))
    frame = hw.render(mirrored_wall(silver), spp=64, follow_specular=False)
    assert np.all(np.abs(frame.plane("Depth") - 4) < 0.6)
    np.testing.assert_allclose(frame.plane("Nx"), np.sqrt(0.5), atol=1e-5)
    for channel, expected in zip("RGB", silver.color, strict=True):
        np.testing.assert_allclose(frame.plane(f"Albedo.{channel}"), expected, rtol=1e-5)


def test_following_changes_features_and_not_light():
    scene = room(Material(kind="dielectric", color=WHITE))
    followed, plain = (hw.render(scene, spp=16, follow_specular=f) for f in (True, False))
    np.testing.assert_array_equal(hw.radiance(followed), hw.radiance(plain))
    assert np.any(followed.plane("Depth") != plain.plane("Depth"))
    behind = followed.plane("Depth") - plain.plane("Depth")
    assert behind.min() > -1e-5 and behind.max() > 0.5
    assert np.all(np.abs(followed.plane("Albedo.R")) <= 1)


def test_a_way_that_ends_nowhere_shows_the_last_mirror():
    silver = Material(kind="conductor", color=(0.9, 0.8, 0.7))
    plate = hw.quad((-1, -1, 1), (2, 0, -2), (0, 2, 0))
    view = hw.camera(hw.look_from((0, 0, 4), (0, 0, 0)), 8, 8, fov_deg=8)
    frame = hw.render(hw.world(plate, materials=(silver,), view=view, environment=WHITE), spp=16)
    assert np.all(frame.plane("Coverage") == 1) and np.all(np.abs(frame.plane("Depth") - 4) < 0.6)
    np.testing.assert_allclose(frame.plane("Albedo.B"), 0.7, rtol=1e-5)


def test_gloss_and_plastic_show_themselves():
    """Only where every lobe is a mirror is anything followed."""
    for material in (Material(kind="plastic", color=(0.3, 0.2, 0.1)), Material(kind="conductor", alpha=0.1)):
        frame = hw.render(mirrored_wall(material), spp=16)
        assert np.all(np.abs(frame.plane("Depth") - 4) < 0.6)


def test_one_scene_may_have_every_material():
    """Each kind beside the others is what it is alone."""
    kinds = (Material(), *ROUGH.values(), Material(kind="dielectric", color=WHITE), Material(kind="thin-dielectric"))
    squares = [hw.quad((i - 4.0, -0.5, 0), (0.9, 0, 0), (0, 1, 0), material=i) for i in range(len(kinds))]
    view = hw.camera(hw.look_from((0.4, 0, 10), (0.4, 0, 0)), 36, 4, fov_deg=50)
    every = hw.radiance(
        hw.render(hw.world(*squares, materials=kinds, view=view, environment=WHITE), spp=64, max_depth=2)
    )
    for i, material in enumerate(kinds):
        alone = [replace(square, material_ids=square.material_ids * 0) for square in squares[i : i + 1]]
        one = hw.radiance(
            hw.render(hw.world(*alone, materials=(material,), view=view, environment=WHITE), spp=64, max_depth=2)
        )
        column = int((i - 4.0 + 0.45 - 0.4) / (20 * np.tan(np.radians(25))) * 36 + 18)
        np.testing.assert_allclose(every[:, 1:3, column].mean(), one[:, 1:3, column].mean(), atol=0.03)
