"""Radiance against closed forms, and the ways of finding light against each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.scene import Material, PunctualLight, SphereLight, Static
from clsim.scene.motion import Keyframes
from tests.render import hand_worlds as hw

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("anything")]  # kernels of their own are compiled

WHITE = Material(color=(1.0, 1.0, 1.0))
LAMP = Material(color=(0.0, 0.0, 0.0), emission=(4.0, 5.0, 6.0), emits_behind=False)


def test_a_closed_glowing_box_shows_the_geometric_series():
    """Every wall sees E + a·E + a²·E + … = E / (1 − a), whatever its shape."""
    glow = Material(color=(0.5, 0.3, 0.0), emission=(1.0, 2.0, 3.0))
    scene = hw.world(hw.box((-1, -1, -1), (1, 2, 1.5)), materials=(glow,))
    frame = hw.render(scene, spp=64, max_depth=40)
    mean, error = hw.mean_and_error(frame)
    expected = np.array([1.0 / 0.5, 2.0 / 0.7, 3.0])
    assert np.all(np.abs(mean - expected) < 4 * error + 1e-5)
    assert np.all(error < 0.02 * expected)


def test_a_cut_path_shows_the_cut_series():
    glow = Material(color=(0.5, 0.5, 0.5), emission=(1.0, 1.0, 1.0))
    scene = hw.world(hw.box((-1, -1, -1), (1, 1, 1)), materials=(glow,))
    for max_depth, expected in ((1, 1.0), (2, 1.5), (3, 1.75)):
        mean, error = hw.mean_and_error(hw.render(scene, spp=64, max_depth=max_depth))
        assert np.all(np.abs(mean - expected) < 4 * error + 1e-5), max_depth


@pytest.mark.parametrize("smooth", [False, True])
def test_a_white_convex_body_vanishes_in_a_white_sky(smooth):
    scene = hw.world(
        hw.ball(1.0, smooth=smooth),
        materials=(WHITE,),
        view=hw.camera(hw.look_from((0, 0.5, 4), (0, 0, 0))),
        environment=(0.7, 0.7, 0.7),
    )
    frame = hw.render(scene, spp=16)
    if smooth:  # shading normals lose the light that would come from below the facets
        inside = frame.plane("Coverage") == 1
        assert abs(hw.radiance(frame)[:, inside].mean() - 0.7) < 0.02
    else:
        np.testing.assert_allclose(hw.radiance(frame), 0.7, rtol=1e-5)
    assert frame.plane("Coverage").max() == 1.0 and frame.plane("Coverage").min() == 0.0


def _floor_under(**rest):
    """A large floor seen from above in a narrow view, so that the picture is the radiance at the origin."""
    floor = hw.quad((-4, 0, 4), (8, 0, 0), (0, 0, -8))
    view = hw.camera(hw.look_from((0, 1, 0), (0, 0, 0), up=(0, 0, -1)), 8, 8, fov_deg=0.2)
    meshes = rest.pop("meshes", ())
    return hw.world(floor, *meshes, view=view, **rest)


def test_irradiance_under_a_rectangle_is_its_form_factor():
    """Howell, catalogue of configuration factors, B-3/B-4: a rectangle with a corner over a parallel element."""
    half_w, half_d, height = 0.6, 0.4, 2.0
    lamp = hw.quad((-half_w, height, -half_d), (2 * half_w, 0, 0), (0, 0, 2 * half_d), material=1)
    scene = _floor_under(meshes=(lamp,), materials=(Material(color=(0.5, 0.5, 0.5)), LAMP))
    x, y = half_w / height, half_d / height
    corner = (
        x / np.sqrt(1 + x * x) * np.arctan(y / np.sqrt(1 + x * x))
        + y / np.sqrt(1 + y * y) * np.arctan(x / np.sqrt(1 + y * y))
    ) / (2 * np.pi)
    expected = 0.5 * 4 * corner * np.array(LAMP.emission)
    mean, error = hw.mean_and_error(hw.render(scene, spp=64, max_depth=2))
    assert np.all(np.abs(mean - expected) < 4 * error)
    assert np.all(error < 0.01 * expected)


@pytest.mark.parametrize("radius", [0.05, 0.7])
def test_irradiance_under_a_sphere_light(radius):
    """E = π·L·(r/d)²·cos θ of a sphere wholly above the horizon; radiance = albedo·E/π."""
    centre = (0.9, 2.0, 0.3)
    lamp = SphereLight(radius, (4.0, 5.0, 6.0), Static(hw.translation(*centre)))
    scene = _floor_under(sphere_lights=(lamp,), materials=(Material(color=(0.5, 0.5, 0.5)),))
    d = np.linalg.norm(centre)
    expected = 0.5 * np.array(lamp.radiance) * (radius / d) ** 2 * centre[1] / d
    mean, error = hw.mean_and_error(hw.render(scene, spp=64, max_depth=2))
    assert np.all(np.abs(mean - expected) < 4 * error + 1e-4 * expected)
    assert np.all(error < 0.01 * expected)


@pytest.mark.parametrize("side_m", [0.001, 0.005])
def test_a_tiny_lamp_far_away_does_not_shade_itself(side_m):
    """Where a ray meets so small a triangle is uncertain; a fifth to two fifths of the light were lost."""
    lamp = hw.quad((1, 0, 1.5), (0, side_m, 0), (side_m, 0, 0), material=1)
    wall = hw.quad((-4, -4, -2), (8, 0, 0), (0, 8, 0))
    frame = hw.render(hw.world(wall, lamp, materials=(WHITE, LAMP), view=hw.camera()), spp=1, max_depth=2)
    assert (frame.plane("R") > 0.0).all()


def test_a_sphere_light_casts_a_shadow_even_close_to_the_lamp_behind():
    lamp = hw.quad((-0.1, 2, -0.1), (0.2, 0, 0), (0, 0, 0.2), material=1)
    dark = SphereLight(0.4, (0.0, 0.0, 0.0), Static(hw.translation(0, 1.6, 0)))
    scene = _floor_under(meshes=(lamp,), materials=(hw.GREY, LAMP), sphere_lights=(dark,))
    assert np.all(hw.radiance(hw.render(scene, spp=16, max_depth=2)) == 0)
    aside = replace(scene, sphere_lights=(replace(dark, motion=Static(hw.translation(1, 1.6, 0))),))
    assert np.all(hw.radiance(hw.render(aside, spp=16, max_depth=2)) > 0)


def test_irradiance_of_a_uniform_sky():
    scene = _floor_under(environment=(0.2, 0.3, 0.4), materials=(Material(color=(0.5, 0.5, 0.5)),))
    np.testing.assert_allclose(hw.radiance(hw.render(scene, spp=4)).mean(axis=(1, 2)), (0.1, 0.15, 0.2), rtol=1e-5)


def _room(**rest):
    """A floor, a wall and a block, so that there are shadows and indirect light."""
    return hw.world(
        hw.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4)),
        hw.quad((-2, 0, -1), (4, 0, 0), (0, 3, 0)),
        hw.box((-0.4, 0.0, -0.4), (0.3, 0.6, 0.2)),
        *rest.pop("meshes", ()),
        view=hw.camera(hw.look_from((0.5, 1.5, 4), (0, 0.6, 0))),
        **rest,
    )


LIT_ROOMS = {
    "triangles": _room(
        meshes=(hw.quad((-0.9, 1.6, 0.2), (0.8, 0, 0), (0, 0, 0.7), material=1),), materials=(hw.GREY, LAMP)
    ),
    "spheres": _room(
        sphere_lights=(
            SphereLight(0.3, (3.0, 3.0, 3.0), Static(hw.translation(-0.9, 1.5, 0.6))),
            SphereLight(0.2, (9.0, 5.0, 1.0), Static(hw.translation(0.7, 0.5, 0.7))),
        )
    ),
    "environment": _room(environment=(0.3, 0.5, 0.7)),
    "all": _room(
        meshes=(hw.quad((-0.9, 1.6, 0.2), (0.8, 0, 0), (0, 0, 0.7), material=1),),
        materials=(hw.GREY, LAMP),
        sphere_lights=(SphereLight(0.3, (3.0, 3.0, 3.0), Static(hw.translation(0.9, 1.5, 0.6))),),
        environment=(0.3, 0.5, 0.7),
    ),
}


def test_a_lamp_shines_alike_whether_it_could_move_or_not():
    """One that stands still is drawn from a table of its own."""
    still = LIT_ROOMS["triangles"]
    resting = Keyframes((0.0, 1.0), ((0.0, 0.0, 0.0),) * 2, ((0.0, 0.0, 0.0, 1.0),) * 2)
    could = replace(still, instances=(*still.instances[:-1], replace(still.instances[-1], motion=resting)))
    expected, found = (hw.radiance(hw.render(scene, spp=64)) for scene in (could, still))
    assert expected.mean() > 0.03
    np.testing.assert_allclose(found.mean(), expected.mean(), rtol=1e-4)
    # A path may part from its twin where rounding decides.
    assert np.mean(np.isclose(found, expected, rtol=1e-4)) > 0.95


@pytest.mark.parametrize(
    "lit_by", [pytest.param(name, marks=() if name == "triangles" else pytest.mark.slow) for name in LIT_ROOMS]
)
def test_every_way_of_finding_light_agrees(lit_by):
    scene = LIT_ROOMS[lit_by]
    results = {
        strategy: hw.mean_and_error(hw.render(scene, spp=256, seed=seed, strategy=strategy, threads=2))
        for seed, strategy in enumerate(("mis", "light", "scatter"))
    }
    mean, error = results["mis"]
    assert np.all(error < 0.03 * mean)
    for strategy in ("light", "scatter"):
        other, other_error = results[strategy]
        z = (other - mean) / np.hypot(error, other_error)
        assert np.all(np.abs(z) < 4), (strategy, z)
    # MIS must be worth its cost: about as quiet as the better of the two, or quieter.
    assert np.all(error <= 1.5 * np.minimum(results["light"][1], results["scatter"][1]))


def test_roulette_changes_noise_and_not_the_mean():
    scene = LIT_ROOMS["triangles"]
    early, early_error = hw.mean_and_error(hw.render(scene, spp=256, seed=1, roulette_start=1))
    late, late_error = hw.mean_and_error(hw.render(scene, spp=256, seed=2, roulette_start=100))
    assert np.all(np.abs(early - late) < 4 * np.hypot(early_error, late_error))
    assert np.all(early_error > late_error)


def behind_a_panel(material, **rest):
    """What the camera sees at the centre of a panel that turns its back on it, a metre before a white wall."""
    panel = hw.quad((-1, -1, -2), (2, 0, 0), (0, 2, 0), material=1)
    wall = hw.quad((-9, -9, -1), (18, 0, 0), (0, 18, 0), material=2)
    white = Material(color=(0.0, 0.0, 0.0), emission=(7.0, 7.0, 7.0))
    view = hw.camera(hw.look_from((0, 0, -4), (0, 0, -2)))
    frame = hw.render(hw.world(panel, wall, materials=(hw.GREY, material, white), view=view, **rest), spp=16)
    return hw.radiance(frame)[:, 7:9, 7:9].mean(axis=(1, 2))


def test_backs_emit_and_scatter_separately():
    """Under a sky of 1 a back that scatters shows its colour, one that emits its emission besides."""
    sky = {"environment": (1.0, 1.0, 1.0)}
    lamp = Material(color=(0.6, 0.4, 0.2), emission=(4.0, 5.0, 6.0))
    np.testing.assert_allclose(behind_a_panel(lamp, **sky), (4.6, 5.4, 6.2), rtol=0.01)
    lamp = replace(lamp, emits_behind=False)
    np.testing.assert_allclose(behind_a_panel(lamp, **sky), (0.6, 0.4, 0.2), rtol=0.05)
    lamp = replace(lamp, back="black")
    np.testing.assert_allclose(behind_a_panel(lamp, **sky), 0.0)
    lamp = replace(lamp, back="black", emits_behind=True)
    np.testing.assert_allclose(behind_a_panel(lamp, **sky), lamp.emission, rtol=1e-5)


def test_culled_backs_are_invisible_to_the_camera_and_stop_light_all_the_same():
    grey = replace(hw.GREY, back="culled")
    np.testing.assert_allclose(behind_a_panel(grey), 7.0, rtol=1e-5)
    # The lid turns its back on floor and lamp: it scatters their light and keeps the sun out as if it were not culled.
    floor = hw.quad((-1, 0, 1), (2, 0, 0), (0, 0, -2))
    lid = hw.quad((-9, 1, 9), (18, 0, 0), (0, 0, -18), material=1)
    sun = PunctualLight("directional", (5.0, 5.0, 5.0), Static(hw.look_from((0, 5, 0), (0, 0, 0), (0, 0, 1))))
    lamp = PunctualLight("point", (2.0, 2.0, 2.0), Static(hw.translation(0.3, 0.8, 0.2)))
    view = hw.camera(hw.look_from((0, 0.9, 0.1), (0, 0, 0)), 8, 8)
    for lights, lit in (((sun,), False), ((sun, lamp), True)):
        pictures = []
        for back in ("culled", "same"):
            materials = (hw.GREY, replace(hw.GREY, back=back))
            scene = hw.world(floor, lid, materials=materials, view=view, punctual_lights=lights)
            pictures.append(hw.radiance(hw.render(scene, spp=16)))
        np.testing.assert_allclose(*pictures, rtol=1e-4)
        assert (pictures[0].max() > 0) == lit


def test_a_black_back_blocks_the_view():
    """A one-sided lamp and wall seen from behind: nothing emitted, nothing scattered, yet the view is blocked."""
    lamp = hw.quad((-1, -1, -2), (2, 0, 0), (0, 2, 0), material=1)
    front = hw.world(lamp, materials=(hw.GREY, LAMP), environment=(1.0, 1.0, 1.0))
    behind = hw.with_camera(front, hw.camera(hw.look_from((0, 0, -4), (0, 0, -2))))
    wall = replace(behind, materials=(hw.GREY, replace(hw.GREY, back="black")))
    for scene, expected in ((front, LAMP.emission), (behind, (0, 0, 0)), (wall, (0, 0, 0))):
        frame = hw.render(scene, spp=4)
        centre = frame.planes[:, 7:9, 7:9]
        np.testing.assert_allclose(centre[:3].mean(axis=(1, 2)), expected)
        assert np.all(centre[frame.names.index("Coverage")] == 1)
        assert np.all(centre[3:6] == 0)


def test_ways_of_finding_the_sky_agree_where_normals_are_smoothed():
    """Densities are about the shading normal: a coarse ball, whose own normals are far from it, tells."""
    ball = hw.ball(1.0, rings=3, smooth=True)
    view = hw.camera(hw.look_from((0, 0.5, 4), (0, 0, 0)), 8, 8, fov_deg=14)
    scene = hw.world(ball, materials=(WHITE,), view=view, environment=(1.0, 1.0, 1.0))
    results = [
        hw.mean_and_error(hw.render(scene, spp=1024, seed=k, max_depth=2, strategy=strategy))
        for k, strategy in enumerate(("mis", "light", "scatter"))
    ]
    for other, error in results[1:]:
        assert np.all(np.abs(other - results[0][0]) < 4 * np.hypot(error, results[0][1]) + 1e-4)
    assert np.all(results[0][1] < 2e-3)
