"""Analytic direct light: closed forms against sums over many directions, and pictures against plain paths."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from clsim.render.device.compiler import kernel_options
from clsim.render.features.scene_features import direct_light_is_analytic
from clsim.render.primary.lamp_light import sphere_irradiance, triangle_irradiance
from clsim.scene import ImageTexture, Material, PunctualLight, SphereLight, Static
from tests.render import hand_worlds as hw
from tests.render.primary.test_steered import LUMINANCE, Run
from tests.render.test_tracer import LAMP, lit_world
from tests.shared_kernels import ORDINARY, widen

pytestmark = pytest.mark.usefixtures("ordinary")

DIRECTIONS = 400_000


@pytest.fixture
def coats_and_metal(ordinary, monkeypatch, request):
    """Build kernels that know both."""
    widen(monkeypatch, request, ORDINARY | {"kinds": ("diffuse", "conductor", "plastic")})


@wp.kernel(module="unique", enable_backward=False, module_options=kernel_options())
def irradiances(corners: wp.array2d(dtype=wp.vec3), cones: wp.array(dtype=wp.vec2), out: wp.array2d(dtype=float)):
    i = wp.tid()
    out[0, i] = triangle_irradiance(corners[i, 0], corners[i, 1], corners[i, 2], wp.vec3(0.0, 0.0, 1.0))
    out[1, i] = sphere_irradiance(cones[i][0], cones[i][1])


def found(corners=((0, 0, 1), (1, 0, 1), (0, 1, 1)), cone=(1.0, 0.1)):
    """Return what the kernel finds for a triangle and a sphere, whose surface looks along z."""
    out = wp.zeros((2, 1), dtype=float, device="cpu")
    inputs = [wp.array([corners], dtype=wp.vec3, device="cpu"), wp.array([cone], dtype=wp.vec2, device="cpu"), out]
    wp.launch(irradiances, dim=1, inputs=inputs, device="cpu")
    return out.numpy()[:, 0]


def hemisphere():
    """Return directions of equal shares of the projected hemisphere, ``[N, 3]``: each is worth π / N."""
    number = np.arange(DIRECTIONS)
    u, turns = (number + 0.5) / DIRECTIONS, number * 0.6180339887498949
    radius, phi = np.sqrt(u), 2 * np.pi * (turns % 1)
    return np.stack([radius * np.cos(phi), radius * np.sin(phi), np.sqrt(1 - u)], axis=1)


@pytest.mark.parametrize("angle_deg", [0.0, 55.0, 70.0, 89.0, 95.0, 109.0])
def test_a_sphere_sends_what_its_directions_sum_up_to(angle_deg):
    """Above the horizon, across it, and with its centre below it; its half angle is 20 degrees."""
    angle, half = np.radians(angle_deg), np.radians(20.0)
    inside = hemisphere() @ [np.sin(angle), 0.0, np.cos(angle)] > np.cos(half)
    expected = np.pi * inside.mean()
    assert found(cone=(np.cos(angle), np.sin(half) ** 2))[1] == pytest.approx(expected, abs=1e-4, rel=2e-3)


def test_a_sphere_below_the_horizon_sends_nothing():
    assert found(cone=(np.cos(np.radians(110.5)), np.sin(np.radians(20.0)) ** 2))[1] == 0.0


@pytest.mark.parametrize(
    "corners",
    [
        ((0.3, -0.2, 1.0), (1.5, 0.1, 0.8), (0.2, 1.2, 1.4)),
        ((2.0, 0.0, 0.5), (1.0, 1.0, -0.7), (1.0, -1.0, 0.2)),
        ((1.0, 0.2, -0.5), (0.8, 1.0, 0.9), (1.2, -1.0, -0.1)),
        ((0.0, 0.0, -1.0), (1.0, 0.0, -1.0), (0.0, 1.0, -0.1)),
    ],
    ids=["above", "one corner below", "two corners below", "below"],
)
def test_a_triangle_sends_what_its_directions_sum_up_to(corners):
    directions = hemisphere()
    sides = [np.cross(corners[i], corners[(i + 1) % 3]) for i in range(3)]
    turned = np.sign(np.dot(sides[0], corners[2]))
    inside = np.all([turned * (directions @ side) > 0 for side in sides], axis=0)
    assert found(corners=corners)[0] == pytest.approx(np.pi * inside.mean(), abs=1e-4, rel=2e-3)


def test_one_path_leaves_no_noise_of_lamps_where_nothing_stands_between():
    """Without the lamps' light, all is dark in a scene without sky and with one bounce."""
    world = lit_world()
    world = replace(world, camera=replace(world.camera, width=36, height=30))
    frame = Run(world, spp=1, max_depth=2, first_hit_rays=256, seed=3).fill(0)
    other = Run(world, spp=1, max_depth=2, first_hit_rays=256, seed=4).fill(0)
    plain = Run(world, spp=1024, max_depth=2, first_hit_rays=0).fill(0)
    first, second, expected = (np.tensordot(LUMINANCE, each.planes[:3], axes=1) for each in (frame, other, plain))
    lit = (frame.plane("Samples") < 8) & (np.minimum(np.minimum(first, second), expected) > 1e-3)
    assert lit.sum() > 100
    # Corners ask lamps near their rims, so that no shadow begins unseen.
    assert (np.abs(np.log(first[lit] / second[lit])) < 1e-3).mean() > 0.95
    assert np.abs(np.log(first[lit] / expected[lit])).mean() < 0.03
    assert first.sum() == pytest.approx(expected.sum(), rel=0.01)


def through_slats(width_m):
    """A floor under a wide lamp that shines through slats, five a metre: all of it is in soft shadows."""
    slats = [hw.box((x, 1, -2), (x + width_m, 1.02, 2)) for x in np.arange(-2, 2, 0.2)]
    sun = SphereLight(0.5, (40.0, 40.0, 40.0), Static(hw.translation(0.3, 3.5, 0.2)))
    floor = hw.quad((-4, 0, 4), (8, 0, 0), (0, 0, -8))
    view = hw.camera(hw.look_from((0, 0.9, 0.01), (0, 0, 0), up=(0, 0, -1)), 24, 24)
    return hw.world(floor, *slats, sphere_lights=(sun,), view=view)


@pytest.mark.parametrize(("light_cache", "width_m", "rays", "share"), [(False, 0.16, 32, 0.05), (True, 0.1, 8, 0.15)])
def test_in_a_soft_shadow_few_pixels_are_lit_or_dark_by_chance(light_cache, width_m, rays, share):
    """The places on a lamp for which a pixel's corners ask may all be free, or none; so corners next to them count."""
    world = through_slats(width_m)
    seen = Run(world, spp=1, max_depth=2, first_hit_rays=rays, light_cache=light_cache).fill(0)
    plain = Run(world, spp=256, max_depth=2, first_hit_rays=0).fill(0)
    seen, plain = (np.tensordot(LUMINANCE, each.planes[:3], axes=1) for each in (seen, plain))
    assert (np.abs(seen / plain - 1) > 0.5).mean() < share


@pytest.mark.slow
def test_what_lies_between_the_corners_of_pixels_is_lit():
    """Pale dots before a dark wall: rays inside find them, and do not ask the lamps where corners told of the wall."""
    side = 2 * np.tan(np.radians(20.0)) / 16
    dots = [
        hw.quad(((x - 7.85) * side, (y - 7.85) * side, -1), (0.7 * side, 0, 0), (0, 0.7 * side, 0), material=1)
        for x, y in np.ndindex(15, 15)
    ]
    wall = hw.quad((-2, -2, -2), (4, 0, 0), (0, 4, 0))
    lamp = hw.quad((-0.5, -0.5, 1.0), (0, 1, 0), (1, 0, 0), material=2)
    materials = (Material(color=(0.01, 0.01, 0.01)), hw.GREY, LAMP)
    world = hw.world(wall, *dots, lamp, materials=materials, view=hw.camera())
    seen = Run(world, spp=1, max_depth=2, first_hit_rays=16).fill(0)
    plain = Run(world, spp=256, max_depth=2, first_hit_rays=0).fill(0)
    seen, plain = (np.tensordot(LUMINANCE, each.planes[:3], axes=1).sum() for each in (seen, plain))
    assert seen / plain > 0.82


def from_above(**lights):
    """A floor with a block above it, seen from above."""
    floor, block = hw.quad((-4, 0, 4), (8, 0, 0), (0, 0, -8)), hw.box((-0.4, 1, -0.8), (0.4, 1.2, 0.8))
    view = hw.camera(hw.look_from((0, 6, 0.01), (0, 0, 0), up=(0, 0, -1)), 24, 24)
    return hw.world(floor, block, view=view, **lights)


def luminances(world, spp, paths):
    """Return a picture with analytic direct light, and one of plain paths."""
    seen = Run(world, spp=spp, max_depth=2, first_hit_rays=16).fill(0)
    plain = Run(world, spp=paths, max_depth=2, first_hit_rays=0).fill(0)
    return [np.tensordot(LUMINANCE, each.planes[:3], axes=1) for each in (seen, plain)]


@pytest.mark.slow
def test_the_shadow_in_a_weak_lamps_light_is_seen_next_to_a_strong_ones():
    """Two suns, of which one has a tenth of the light: corners ask both, and not by their power."""
    suns = [
        PunctualLight("directional", (light,) * 3, Static(hw.look_from((x, 1, 0), (0, 0, 0), up=(0, 0, 1))))
        for light, x in ((1.8, 0.8), (0.2, -0.8))
    ]
    seen, plain = luminances(from_above(punctual_lights=tuple(suns)), 1, 64)
    shadow = (plain > 0.85 * plain.max()) & (plain < 0.93 * plain[0, 0])
    assert shadow.sum() > 20
    assert np.median(seen[shadow] / plain[shadow]) < 1.03


@pytest.mark.slow
def test_cells_do_not_blur_the_shadows_of_several_panels():
    """Four triangles; cells are two pixels wide, and wider ones take part where few paths are known."""
    panels = [hw.quad((x, 3, -0.1), (0.2, 0, 0), (0, 0, 0.2), material=1) for x in (-1.2, 1.0)]
    world = from_above()
    world = replace(
        world, meshes=(*world.meshes, *panels), materials=(hw.GREY, LAMP),
        instances=(*world.instances, *(replace(world.instances[0], mesh=index) for index in (2, 3))),
    )  # fmt: skip
    cached = Run(world, spp=8, probe_spp=1, first_hit_rays=32, light_cache=True).fill(0)
    cached, plain = (
        np.log(np.maximum(np.tensordot(LUMINANCE, each.planes[:3], axes=1), 1e-3))
        for each in (cached, hw.render(world, spp=1024, sampler="sobol"))
    )
    assert np.sqrt(np.mean((cached - plain) ** 2)) < 0.04


@pytest.mark.slow
@pytest.mark.parametrize("lamps", [6, 8])
def test_the_shadow_of_each_of_several_lamps_is_sharp(lamps):
    """More suns than a pixel has corners: those around it ask for the others."""
    suns = []
    for turn in np.arange(lamps) * 2 * np.pi / lamps:
        pose = Static(hw.look_from((0.8 * np.cos(turn), 1, 0.8 * np.sin(turn)), (0, 0, 0), up=(0.1, 0, 1)))
        suns.append(PunctualLight("directional", (0.4,) * 3, pose))
    world = from_above(punctual_lights=tuple(suns))
    cached = Run(world, spp=8, probe_spp=1, max_depth=2, first_hit_rays=32, light_cache=True).fill(0)
    cached, plain = (
        np.log(np.maximum(np.tensordot(LUMINANCE, each.planes[:3], axes=1), 1e-3))
        for each in (cached, hw.render(world, spp=1024, sampler="sobol", max_depth=2))
    )
    assert np.sqrt(np.mean((cached - plain) ** 2)) < 0.045


@pytest.mark.slow
def test_each_of_several_spots_lights_its_own_part_and_has_its_own_shadow():
    """Corners ask only the spots that shine on them: else a pixel counts as dark, or as lit, by another one's light."""
    spots = []
    for x, z in itertools.product((-1.4, 0.0, 1.4), (-0.8, 0.8)):
        pose = Static(hw.look_from((x, 3.5, z), (x + 0.1, 0, z), up=(0, 0, -1)))
        spots.append(PunctualLight("spot", (10.0,) * 3, pose, inner_deg=9.0, outer_deg=20.0))
    world = from_above(punctual_lights=tuple(spots))
    cached = Run(world, spp=1, probe_spp=1, max_depth=2, first_hit_rays=16, light_cache=True).fill(0)
    plain = Run(world, spp=256, max_depth=2, first_hit_rays=0).fill(0)
    cached, plain = (np.tensordot(LUMINANCE, each.planes[:3], axes=1) for each in (cached, plain))
    assert (plain < 0.05 * plain.max()).mean() > 0.1
    assert np.abs(cached - plain).max() < 0.2 * plain.max()


@pytest.mark.slow
def test_the_edge_of_a_sharp_cone_lies_within_pixels():
    """Light at one place in each pixel is all or nothing there."""
    pose = Static(hw.look_from((0, 5, 0), (0, 0, 0), up=(0.3, 0, -1)))
    spot = PunctualLight("spot", (8, 8, 8), pose, inner_deg=15.0, outer_deg=15.05)
    seen, plain = luminances(from_above(punctual_lights=(spot,)), 64, 256)
    rim = (plain > 0.02 * plain.max()) & (plain < 0.98 * plain.max())
    assert rim.sum() > 50
    assert np.abs(seen - plain)[rim].mean() < 0.02 * plain.max()
    assert direct_light_is_analytic(from_above(punctual_lights=(replace(spot, inner_deg=13.0),)))


@pytest.mark.slow
def test_a_picture_of_light_is_seen_as_the_mean_over_pixels():
    """A projector's checks, narrower than pixels: light at one place in each is no picture of them."""
    checks = np.full((64, 64, 4), 255, np.uint8)
    checks[::2, ::2, :3] = checks[1::2, 1::2, :3] = 0
    pose = Static(hw.look_from((0, 5, 0), (0, 0, 0), up=(0.3, 0, -1)))
    projector = PunctualLight("spot", (8, 8, 8), pose, picture=0, picture_size=(0.3, 0.3), falloff="frame")
    world = from_above(punctual_lights=(projector,))
    world = replace(world, textures=(ImageTexture(checks, nearest=True),))
    seen, plain = luminances(world, 64, 64)
    lit = plain > 0.5 * plain.max()
    assert lit.sum() > 50
    assert np.std(seen[lit] / plain[lit]) < 0.2


@pytest.mark.slow  # kernels of their own are compiled
@pytest.mark.usefixtures("coats_and_metal")
@pytest.mark.parametrize("alpha", [0.0, 0.3], ids=["mirroring", "rough"])
@pytest.mark.parametrize("angle_deg", [10.0, 60.0, 80.0])
def test_under_a_coat_light_of_a_lamp_is_what_the_coat_lets_pass_from_there(alpha, angle_deg):
    """More than of light from all sides where it comes straight from above, and less where it grazes."""
    to = np.array([np.sin(np.radians(angle_deg)), np.cos(np.radians(angle_deg)), 0.0])
    lamp = SphereLight(0.4, (40.0, 40.0, 40.0), Static(hw.translation(*(6.0 * to))))
    coated = Material(kind="plastic", color=(0.6, 0.4, 0.2), alpha=alpha, ior=1.5)
    floor = hw.quad((-0.5, 0, 0.5), (1, 0, 0), (0, 0, -1))
    # Seen from where the coat mirrors no lamp.
    view = hw.camera(hw.look_from((0.3, 2.0, 1.0), (0, 0, 0)), 8, 8, 20.0)
    world = hw.world(floor, materials=(coated, hw.GREY), sphere_lights=(lamp,), view=view)
    assert direct_light_is_analytic(world)
    plain = Run(world, spp=1024, max_depth=2, first_hit_rays=0).fill(0).planes[:3, 1:-1, 1:-1]
    once, again = (
        Run(world, spp=1, max_depth=2, first_hit_rays=32, light_cache=True, seed=seed).fill(0).planes[:3, 1:-1, 1:-1]
        for seed in (0, 1)
    )
    # A little of a rough coat's reflection is seen too, whose lobe is fitted.
    rtol = {10.0: 0.02, 60.0: 0.02, 80.0: 0.08}[angle_deg] if alpha else 0.015
    np.testing.assert_allclose(once.mean(axis=(1, 2)), plain.mean(axis=(1, 2)), rtol=rtol)
    if alpha == 0:
        # One path tells nothing of the lamp: all of it is known in closed form.
        np.testing.assert_allclose(once, again, rtol=0.001)


def test_thin_tubes_are_lit_by_how_each_part_of_them_faces():
    """Of two tubes in one pixel a lamp lights one side each, and the pixel shows all of that."""
    pixel, facets = 2 * np.tan(np.radians(20.0)) / 8, 24
    turns = np.linspace(0, 2 * np.pi, facets + 1)
    circle = 0.2 * pixel * np.stack([np.cos(turns), np.zeros(facets + 1), np.sin(turns)], axis=1)
    tubes = [
        hw.quad(a + begin, b - a, (0, 4, 0), material=1)
        for begin in ((0.25 * pixel, -2, -1), (1.5 * pixel, -2, -2))
        for a, b in itertools.pairwise(circle)
    ]
    lamp = SphereLight(0.3, (40.0, 40.0, 40.0), Static(hw.translation(6.0, 0.0, -1.5)))
    materials = (Material(color=(0.01, 0.01, 0.01)), hw.GREY)
    wall = hw.quad((-8, -8, -3), (16, 0, 0), (0, 16, 0))
    world = hw.world(wall, *tubes, materials=materials, sphere_lights=(lamp,), view=hw.camera(width=8, height=8))
    seen = Run(world, spp=1, max_depth=2, first_hit_rays=64, light_cache=True).fill(0).planes[:3].sum()
    plain = Run(world, spp=1024, max_depth=2, first_hit_rays=0).fill(0).planes[:3].sum()
    assert seen == pytest.approx(plain, rel=0.05)


@pytest.mark.slow  # kernels of their own are compiled
@pytest.mark.usefixtures("coats_and_metal")
def test_the_sun_on_metal_does_not_shine_on_what_lies_beside_it():
    """Strips of metal and of cloth, as wide as a pixel: cells of several pixels hold both."""
    side = 0.1
    strips = [hw.quad(((x - 12) * side, 0, 1.2), (side, 0, 0), (0, 0, -2.4), material=x % 2) for x in range(24)]
    metal = Material(kind="conductor", color=(0.9, 0.9, 0.9), alpha=0.4)
    lamp = SphereLight(0.2, (400.0, 400.0, 400.0), Static(hw.translation(0.0, 4.0, -2.0)))
    view = hw.camera(hw.look_from((0, 2.0, 2.0), (0, 0, 0)), 24, 24, 40.0)
    world = hw.world(*strips, materials=(hw.GREY, metal), sphere_lights=(lamp,), view=view)
    seen = Run(world, spp=16, max_depth=2, first_hit_rays=32, light_cache=True).fill(0)
    plain = Run(world, spp=1024, max_depth=2, first_hit_rays=0).fill(0)
    cloth = np.abs(plain.plane("Albedo.R") - hw.GREY.color[0]) < 0.01
    assert cloth.sum() > 20
    ratio = seen.plane("G")[cloth].mean() / plain.plane("G")[cloth].mean()
    assert ratio == pytest.approx(1.0, abs=0.01)
