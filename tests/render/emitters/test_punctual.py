"""Point, spot and directional lights against closed forms."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
import warp as wp

from clsim.render import RenderOptions, SceneData
from clsim.render.emitters.punctual import Punctual, falloff, make_punctual, power
from clsim.render.textures.texture_data import Textures
from clsim.scene import Material, PunctualLight, SphereLight, Static
from tests.render import hand_worlds as hw

pytestmark = pytest.mark.usefixtures("anything")

GREY = Material(color=(0.5, 0.5, 0.5))
INTENSITY = (4.0, 5.0, 6.0)


def floor_under(*lights, meshes=(), materials=(GREY,), **rest):
    """A floor seen in a narrow view from above: the picture is the radiance at the origin, 0.5·E/π."""
    floor = hw.quad((-1, 0, 1), (2, 0, 0), (0, 0, -2))
    view = hw.camera(hw.look_from((0, 1, 0), (0, 0, 0), up=(0, 0, -1)), 4, 4, fov_deg=0.02)
    return hw.world(floor, *meshes, view=view, materials=materials, punctual_lights=lights, **rest)


def irradiance(scene, index=0, spp=1):
    """There is no noise where a single light is drawn, but for the width of the view."""
    return hw.radiance(hw.render(scene, index, spp=spp, max_depth=2)).mean(axis=(1, 2)) * np.pi / 0.5


def shining(position, target):
    """The pose of a light at a position that shines to a target."""
    return Static(hw.look_from(position, target, up=(0.3, 0.2, 1.0)))


def test_a_point_light_follows_the_inverse_square_and_the_cosine():
    for position in ((0.0, 2.0, 0.0), (1.5, 0.7, -2.0)):
        light = PunctualLight("point", INTENSITY, Static(hw.translation(*position)))
        d = np.linalg.norm(position)
        expected = np.array(INTENSITY) / d**2 * position[1] / d
        np.testing.assert_allclose(irradiance(floor_under(light)), expected, rtol=2e-3)


def test_a_directional_light_gives_its_irradiance_times_the_cosine_wherever_it_stands():
    for away in (1.0, 50.0):
        light = PunctualLight("directional", INTENSITY, shining(np.multiply(away, (3.0, 4.0, 0.0)), (0, 0, 0)))
        np.testing.assert_allclose(irradiance(floor_under(light)), np.multiply(INTENSITY, 0.8), rtol=1e-4)
    below = PunctualLight("directional", INTENSITY, shining((0, -1, 0.1), (0, 0, 0)))
    assert np.all(irradiance(floor_under(below)) == 0)


FALLOFFS = {
    "squared": lambda a, i, o: np.clip((np.cos(a) - np.cos(o)) / (np.cos(i) - np.cos(o)), 0, 1) ** 2,
    "linear": lambda a, i, o: np.clip((o - a) / (o - i), 0, 1),
    "smooth": lambda a, i, o: smooth_step(np.clip((np.cos(a) - np.cos(o)) / (np.cos(i) - np.cos(o)), 0, 1)),
}
"""As KHR_lights_punctual, Mitsuba and pbrt define them, of the angle and the cones."""


def smooth_step(x):
    return x * x * (3 - 2 * x)


@pytest.mark.parametrize("curve", FALLOFFS)
@pytest.mark.parametrize("off_axis_deg", [0.0, 15.0, 24.0, 29.5, 30.5])
def test_a_spot_fades_from_the_inner_to_the_outer_cone(curve, off_axis_deg):
    """The falloff, written out; the light is 2 m over the origin and its axis tilted."""
    inner, outer = 20.0, 30.0
    tilt = np.tan(np.radians(off_axis_deg)) * 2.0
    light = PunctualLight("spot", INTENSITY, shining((0, 2, 0), (tilt, 0, 0)), inner, outer, curve)
    ramp = FALLOFFS[curve](*(np.radians(a) for a in (off_axis_deg, inner, outer)))
    np.testing.assert_allclose(irradiance(floor_under(light)), np.array(INTENSITY) / 4 * ramp, rtol=5e-3, atol=1e-6)


@pytest.mark.parametrize("curve", ["linear", "smooth"])
@pytest.mark.parametrize(("inner", "outer"), [(0.0, 45.0), (20.0, 30.0), (0.0, 90.0)])
def test_the_power_of_other_spots_is_the_integral_of_their_falloff(inner, outer, curve):
    light = PunctualLight("spot", (1.0, 0.0, 0.0), hw.IDENTITY, inner, outer, curve)
    c = np.linspace(0, 1, 200_001)
    expected = 2 * np.pi * np.trapezoid(FALLOFFS[curve](np.arccos(c), *np.radians((inner, outer))), c)
    np.testing.assert_allclose(power(light, 1.0)[0], expected, rtol=0.01)


@pytest.mark.parametrize(("inner", "outer"), [(0.0, 45.0), (20.0, 30.0), (30.0, 30.0), (0.0, 90.0)])
def test_the_power_of_a_spot_is_the_integral_of_its_falloff(inner, outer):
    light = PunctualLight("spot", (1.0, 0.0, 0.0), hw.IDENTITY, inner, outer)
    scale, offset = falloff(light)
    c = np.linspace(0, 1, 2_000_001)
    expected = 2 * np.pi * np.trapezoid(np.clip(c * scale + offset, 0, 1) ** 2, c)
    np.testing.assert_allclose(power(light, 1.0)[0], expected, rtol=1e-3)


@pytest.mark.parametrize(
    ("light", "expected"),
    [
        (PunctualLight("point", INTENSITY, hw.IDENTITY), 4 * np.pi),
        (PunctualLight("directional", INTENSITY, hw.IDENTITY), np.pi * 3.0**2),
        (PunctualLight("spot", INTENSITY, hw.IDENTITY, falloff="frame", picture_size=(0.5, -0.25)), 1.0 * 0.5),
    ],
    ids=["point", "directional", "frame"],
)
def test_what_is_lit_all_around_or_across_the_scene_or_in_a_frame_has_that_power(light, expected):
    """A frame reaches as far to either side, at a distance of 1, and is lit evenly there."""
    np.testing.assert_allclose(power(light, 3.0), np.array(INTENSITY) * expected)


def test_bodies_cast_sharp_shadows():
    light = PunctualLight("point", INTENSITY, Static(hw.translation(0, 2, 0)))
    lid = hw.quad((-0.01, 1, -0.01), (0.02, 0, 0), (0, 0, 0.02))
    aside = hw.quad((0.011, 1, -0.01), (0.02, 0, 0), (0, 0, 0.02))
    behind = hw.quad((-1, 2.001, -1), (2, 0, 0), (0, 0, 2))
    view = hw.camera(hw.look_from((0, 0.5, 0), (0, 0, 0), up=(0, 0, -1)), 4, 4, fov_deg=0.02)
    lit = irradiance(floor_under(light))
    assert np.all(irradiance(hw.with_camera(floor_under(light, meshes=(lid,)), view)) == 0)
    for body in (aside, behind):
        np.testing.assert_allclose(irradiance(hw.with_camera(floor_under(light, meshes=(body,)), view)), lit)


@pytest.mark.slow
def test_many_lights_of_all_kinds_add_up():
    """Drawn by power: a picture with several is noisy, and its mean is the sum of the pictures with one each."""
    lamp = hw.quad((-0.9, 1.6, 0.2), (0.4, 0, 0), (0, 0, 0.4), material=1)
    emitter = Material(color=(0.0, 0.0, 0.0), emission=(9.0, 8.0, 7.0))
    point = PunctualLight("point", (1.0, 2.0, 3.0), Static(hw.translation(0.5, 1.0, 0.2)))
    spot = PunctualLight("spot", (9.0, 5.0, 3.0), shining((-1, 2, 1), (0, 0, 0)), 5.0, 40.0)
    sun = PunctualLight("directional", (1.0, 0.5, 0.25), shining((1, 2, 3), (0, 0, 0)))
    sphere = SphereLight(0.2, (3.0, 3.0, 3.0), Static(hw.translation(1, 1.5, -0.6)))
    sky = (0.2, 0.1, 0.05)
    alone = [
        floor_under(point),
        floor_under(spot),
        floor_under(sun),
        floor_under(sphere_lights=(sphere,)),
        floor_under(meshes=(lamp,), materials=(GREY, emitter)),
        floor_under(environment=sky),
    ]
    both = floor_under(
        point, spot, sun, meshes=(lamp,), materials=(GREY, emitter), sphere_lights=(sphere,), environment=sky
    )
    # The lamp shades some of the sky: what it hides is seen with the lamp black.
    black = floor_under(meshes=(lamp,), materials=(GREY, replace(emitter, emission=(0.0,) * 3)), environment=sky)
    alone[-1] = black
    parts = [hw.mean_and_error(hw.render(scene, spp=256, max_depth=2)) for scene in alone]
    total, error = hw.mean_and_error(hw.render(both, spp=1024, max_depth=2, seed=5))
    expected = sum(mean for mean, _ in parts)
    spread = np.sqrt(error**2 + sum(e**2 for _, e in parts))
    assert np.all(np.abs(total - expected) < 4 * spread + 1e-4 * expected)
    assert np.all(spread < 0.02 * expected)


@dataclass(frozen=True)
class Rise:
    duration_s: float = 1.0

    def pose(self, time_s):
        return hw.look_from((0, 1.0 + time_s, 0), (0, -5, 0), up=(1, 0, 0))


@pytest.mark.parametrize("kind", ["point", "spot"])
def test_a_moving_light_is_where_its_motion_says(kind):
    scene = floor_under(PunctualLight(kind, INTENSITY, Rise(), 10.0, 20.0), fps=2.0)
    for index in (0, 1, 2):
        np.testing.assert_allclose(irradiance(scene, index), np.array(INTENSITY) / (1 + index / 2) ** 2, rtol=1e-4)


@dataclass(frozen=True)
class Swoop:
    """Ahead on a way of its own, always towards the origin."""

    way: tuple[float, float, float]
    duration_s: float = 1.0

    def pose(self, time_s):
        return hw.look_from(np.add((1.0, 2.0, 0.5), np.multiply(time_s, self.way)), (0, 0, 0))


@pytest.mark.parametrize("count", [1, 3])
def test_moving_lights_are_where_their_motions_say_at_each_of_several_instants(count):
    """However many lights and instants there are, and however many of these there were before."""
    ways = np.random.default_rng(2).normal(size=(count, 3))
    lights = [PunctualLight("spot", INTENSITY, Swoop(tuple(way)), 10.0, 20.0) for way in ways]
    data = SceneData(floor_under(*lights), instants=True)
    for times_s in ([0.5, 0.1], [0.4], [0.1, 0.9, 0.3, 0.7], [0.2, 0.6]):
        data.move_to(np.array(times_s))
        poses = np.array([[light.motion.pose(time_s) for light in lights] for time_s in times_s])
        table = data.scene.lights.punctual
        for found, expected in ((table.positions, poses[..., :3, 3]), (table.axes, -poses[..., :3, 2])):
            there = found.numpy()[: len(times_s) * count].reshape(expected.shape)
            np.testing.assert_allclose(there, expected, atol=1e-5)


def test_within_an_exposure_each_of_several_spots_shines_from_where_it_is_and_whither_it_points():
    """KHR_lights_punctual's cone, by the poses at that time; axes are straight from key to key."""
    ways = ((1.0, 0.0, 0.8), (-1.2, 0.5, 0.0), (0.0, -0.8, 1.2))
    lights = [PunctualLight("spot", INTENSITY, Swoop(way), 4.0, 20.0) for way in ways]
    world = floor_under(*lights)
    data = SceneData(world, interval_s=1.0)
    data.move(0.5)
    camera = replace(world.camera, shutter_s=1.0)
    towards = make_punctual(RenderOptions().features(data.features, camera))

    @wp.kernel(enable_backward=False, module="unique")
    def ask(
        lights: Punctual,
        textures: Textures,
        position: wp.vec3,
        times: wp.array[float],
        out_irradiance: wp.array2d[wp.vec3],
    ) -> None:
        i, light = wp.tid()
        out_irradiance[i, light] = towards(lights, textures, light, position, times[i]).irradiance

    place, times_s = np.array((0.5, 0.1, -0.4)), np.linspace(0.0, 1.0, 33)
    found = wp.zeros((len(times_s), len(lights)), dtype=wp.vec3, device="cpu")
    given = [data.scene.lights.punctual, data.scene.materials.textures, wp.vec3(*place)]
    given.append(wp.array(times_s, dtype=float, device="cpu"))
    wp.launch(ask, found.shape, inputs=given, outputs=[found], device="cpu")
    poses = np.array([[light.motion.pose(time_s) for light in lights] for time_s in times_s])
    ways_m = place - poses[..., :3, 3]
    distances = np.linalg.norm(ways_m, axis=-1)
    cosines = np.einsum("tlc,tlc->tl", ways_m, -poses[..., :3, 2]) / distances
    inner, outer = np.cos(np.radians((4.0, 20.0)))
    shares = np.clip((cosines - outer) / (inner - outer), 0.0, 1.0) ** 2 / distances**2
    assert (np.ptp(shares, axis=0) > 0.01).all() and (np.ptp(shares[1:], axis=1) > 1e-3).all()
    np.testing.assert_allclose(found.numpy(), shares[..., None] * INTENSITY, rtol=2e-3, atol=1e-3)


@pytest.mark.slow
def test_scattering_finds_no_light_without_size():
    light = PunctualLight("point", INTENSITY, Static(hw.translation(0, 2, 0)))
    assert np.all(hw.radiance(hw.render(floor_under(light), spp=16, strategy="scatter")) == 0)
