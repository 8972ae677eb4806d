"""Motion blur: what a long exposure sees is the mean over it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from clsim.render import RenderOptions, describe_build
from clsim.render.motion.shutter import key_steps, key_times
from clsim.scene import Camera, Instance, Material, PunctualLight, SphereLight, Static
from tests.render import hand_worlds as hw
from tests.render.camera.test_camera import trace_rays

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("any_lights")]  # kernels of their own are compiled

GLOW = Material(color=(0.0, 0.0, 0.0), emission=(1.0, 2.0, 4.0))
GREY = Material(color=(0.5, 0.5, 0.5))


@dataclass(frozen=True)
class Glide:
    """Along x at 1 m/s from where it starts."""

    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    velocity: tuple[float, float, float] = (1.0, 0.0, 0.0)
    duration_s: float = 10.0

    def pose(self, time_s):
        return hw.translation(*np.add(self.start, np.multiply(time_s, self.velocity)))


@dataclass(frozen=True)
class Spin:
    """About the z axis."""

    turns_per_s: float = 1.0
    phase: float = 0.0
    duration_s: float = 10.0

    def pose(self, time_s):
        angle = 2 * np.pi * (self.turns_per_s * time_s + self.phase)
        matrix = np.eye(4)
        matrix[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        return matrix


def view(motion=hw.IDENTITY, shutter_s=0.5, width=32, height=2):
    """Looks along −z; at z = −1 the picture is 2 m wide."""
    return Camera(width, height, 90.0, motion, shutter_s)


def strip(motion, camera):
    """A glowing strip .5 m wide that is .25 m left of its origin's right edge at z = −1."""
    return hw.world(
        hw.quad((-0.25, -1, -1), (0.5, 0, 0), (0, 2, 0)), materials=(GLOW,), view=camera, motions=[motion], fps=1.0
    )


def swept_coverage(x, centre, shutter_s):
    """Share of the exposure for which a strip of half width .25 m, moving 1 m/s, covers image position x [m]."""
    begin, end = x - 0.25 - centre, x + 0.25 - centre
    half = shutter_s / 2
    return np.clip(np.minimum(end, half) - np.maximum(begin, -half), 0, None) / shutter_s


@pytest.mark.parametrize("what", ["object", pytest.param("camera", marks=pytest.mark.slow)])
def test_a_strip_in_uniform_motion_is_smeared_to_a_trapezium(what):
    """At frame 1 the strip is at x = .25 m, wherever it is the strip or the camera that moves."""
    if what == "object":
        scene = strip(Glide((-0.75, 0, 0)), view())
    else:
        scene = strip(Static(hw.translation(0.25, 0, 0)), view(Glide((1, 0, 0), (-1.0, 0, 0))))
    frame = hw.render(scene, 1, spp=1024, max_depth=1)
    edges = np.linspace(-1, 1, 32 * 50 + 1)
    fine = swept_coverage((edges[1:] + edges[:-1]) / 2, 0.25, 0.5)
    expected = fine.reshape(32, 50).mean(axis=1)
    error = np.sqrt(expected * (1 - expected) / 1024) + 1e-3
    for row in frame.plane("Coverage"):
        assert np.all(np.abs(row - expected) < 4.5 * error)
    np.testing.assert_allclose(frame.plane("G"), 2 * frame.plane("Coverage"), rtol=1e-5)
    assert np.count_nonzero((expected > 0.05) & (expected < 0.95)) > 8


def test_an_object_that_crosses_the_whole_view_is_not_lost():
    """At neither end of the exposure, nor in its middle, is it where it is looked for."""
    scene = strip(Glide((-20, 0, 0), (40.0, 0, 0)), view(shutter_s=1.0))
    frame = hw.render(replace(scene, fps=2.0), 1, spp=4096, max_depth=1)
    # 40 m/s: each place is covered for .5 / 40 s.
    z = (frame.plane("Coverage").mean() - 0.0125) / np.sqrt(0.0125 / (4096 * 64))
    assert abs(z) < 4.5


def ring_of(motion, centre, turns):
    """Mean distance of a small glowing square from the origin while it goes round it so many times."""
    x, y, _ = centre
    hand = hw.quad((x - 0.01, y - 0.01, -1), (0.02, 0, 0), (0, 0.02, 0))
    camera = view(shutter_s=turns, width=64, height=64)
    frame = hw.render(
        hw.world(hand, materials=(GLOW,), view=camera, motions=[motion], fps=1.0), 1, spp=512, max_depth=1
    )
    x, y = np.meshgrid((np.arange(64) + 0.5 - 32) / 32, (32 - np.arange(64) - 0.5) / 32)
    weight = frame.plane("Coverage").astype(np.float64)
    assert abs(weight.sum() / (64 * 64) - 0.0001) < 0.00002
    weight /= weight.sum()
    return (weight * np.hypot(x, y)).sum(), weight, np.arctan2(y, x)


def test_a_quarter_turn_keeps_its_radius():
    """The tip of a hand stays on its circle."""
    radius, weight, angles = ring_of(Spin(), (0.5, 0.0, 0.0), 0.25)
    assert abs(radius - 0.5) < 0.004
    assert abs((weight * angles).sum()) < 0.03
    seen = angles[weight > 0]
    assert seen.min() < -0.72 and seen.max() > 0.72


@dataclass(frozen=True)
class Round:
    """On a circle about the z axis, never turning itself."""

    radius_m: float = 0.5
    height_m: float = 0.0
    phase: float = 0.0
    duration_s: float = 10.0

    def pose(self, time_s):
        angle = 2 * np.pi * (time_s + self.phase)
        return hw.translation(self.radius_m * np.cos(angle), self.radius_m * np.sin(angle), self.height_m)


@pytest.mark.parametrize(("motion", "centre"), [(Spin(), (0.5, 0.0, 0.0)), (Round(), (0.0, 0.0, 0.0))])
def test_a_whole_turn_keeps_its_radius(motion, centre):
    """Chords between nine keys would come to .487 m in the mean."""
    radius, weight, _ = ring_of(motion, centre, 1.0)
    assert abs(radius - 0.5) < 0.003
    assert np.count_nonzero(weight) > 32 * np.pi


@pytest.mark.parametrize("motion", [Spin(phase=0.125), Round(phase=0.125)])
def test_what_swings_out_between_keys_is_not_lost(motion):
    """Two turns: all nine keys are in the corners of a square, which the circle leaves on all sides."""
    centre = (0.5, 0.0, 0.0) if isinstance(motion, Spin) else (0.0, 0.0, 0.0)
    radius, weight, _ = ring_of(motion, centre, 2.0)
    assert abs(radius - 0.5) < 0.012
    assert np.count_nonzero(weight) > 80


@dataclass(frozen=True)
class GrowingSpin:
    """About the z axis, growing from half its size at 0.5 s to one and a half at 1.5 s."""

    duration_s: float = 10.0

    def pose(self, time_s):
        return Spin().pose(time_s) @ np.diag((*[max(time_s, 0.1)] * 3, 1.0))


def test_what_grows_as_it_turns_is_as_large_as_its_pose_says():
    """On a spiral around .5 m; the mean of its area is that of the square of its size, 13/12."""
    hand = hw.quad((0.49, -0.01, -1), (0.02, 0, 0), (0, 0.02, 0))
    camera = view(shutter_s=1.0, width=64, height=64)
    scene = hw.world(hand, materials=(GLOW,), view=camera, motions=[GrowingSpin()], fps=1.0)
    frame = hw.render(scene, 1, spp=512, max_depth=1)
    x, y = np.meshgrid((np.arange(64) + 0.5 - 32) / 32, (32 - np.arange(64) - 0.5) / 32)
    weight = frame.plane("Coverage").astype(np.float64)
    # Seen from the origin all sizes are alike: distance grows as size does.
    assert abs(weight.sum() / (64 * 64) - 0.0001) < 0.00002
    assert abs((weight * np.hypot(x, y)).sum() / weight.sum() - 0.5) < 0.004


@pytest.mark.parametrize("kind", ["sphere", "point"])
def test_a_light_that_goes_round_once_shines_from_its_circle(kind):
    """On the axis, h below the circle: E = I·h / (h² + r²)^1.5 all the time; chords would give 8 % more."""
    radius, height, intensity = 2.0, 0.5, 3.0
    motion = Round(radius, height)
    lights = {
        "sphere": {"sphere_lights": (SphereLight(0.02, (intensity / (np.pi * 0.02**2),) * 3, motion),)},
        "point": {"punctual_lights": (PunctualLight("point", (intensity,) * 3, motion),)},
    }[kind]
    floor = hw.quad((-3, -3, 0), (6, 0, 0), (0, 6, 0))
    camera = Camera(8, 8, 0.02, Static(hw.look_from((0, 0, 0.3), (0, 0, 0))), shutter_s=1.0)
    frame = hw.render(hw.world(floor, materials=(GREY,), view=camera, fps=1.0, **lights), 1, spp=64, max_depth=2)
    expected = 0.5 / np.pi * intensity * height / (height**2 + radius**2) ** 1.5
    np.testing.assert_allclose(hw.radiance(frame).mean(axis=(1, 2)), expected, rtol=5e-3)


def test_a_camera_that_goes_round_once_sees_a_ring():
    """The strip is a small square at the origin, seen by a camera on a circle: it smears to that circle."""
    hand = hw.quad((-0.01, -0.01, -1), (0.02, 0, 0), (0, 0.02, 0))
    camera = view(Round(), shutter_s=1.0, width=64, height=64)
    frame = hw.render(hw.world(hand, materials=(GLOW,), view=camera, fps=1.0), 1, spp=512, max_depth=1)
    x, y = np.meshgrid((np.arange(64) + 0.5 - 32) / 32, (32 - np.arange(64) - 0.5) / 32)
    weight = frame.plane("Coverage").astype(np.float64)
    assert abs((weight * np.hypot(x, y)).sum() / weight.sum() - 0.5) < 0.003


@pytest.mark.parametrize("turns", [0.1, 1.0])
def test_a_blurred_turn_of_the_camera_is_the_mean_of_its_poses(turns):
    """Rays at any time are those of a camera that stands there."""
    camera = view(Spin(turns), shutter_s=1.0, width=8, height=8)
    xy = np.random.default_rng(0).random((50, 2)) * 8
    for time in (*np.arange(0, 1, 1 / 16), 0.4, 1.0):
        _, blurred, _ = trace_rays(camera, xy, time=np.full(50, time), time_s=2.0)
        there = 2.0 - 0.5 + time
        _, still, _ = trace_rays(replace(camera, shutter_s=0.0), xy, time_s=there)
        axes = [camera.motion.pose(t)[:3, :3] for t in (2.0, there)]
        flip = np.diag((1.0, -1.0, -1.0))
        np.testing.assert_allclose(blurred @ (axes[0] @ flip).T, still @ (axes[1] @ flip).T, atol=2e-5)


@pytest.mark.parametrize("kind", ["sphere", "point"])
def test_a_moving_light_lights_with_the_mean_over_the_exposure(kind):
    """1 m above the floor it glides over the origin: E(x) = I·h / (h² + x²)^1.5 for a point, so for a far sphere."""
    motion = Glide((-2, 1, 0))
    intensity = 3.0
    lights = {
        "sphere": {"sphere_lights": (SphereLight(0.02, (intensity / (np.pi * 0.02**2),) * 3, motion),)},
        "point": {"punctual_lights": (PunctualLight("point", (intensity,) * 3, motion),)},
    }[kind]
    pose = hw.look_from((0, 0.5, 0), (0, 0, 0), up=(0, 0, -1))
    camera = Camera(8, 8, 0.02, Static(pose), shutter_s=2.0)
    floor = hw.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6))
    scene = hw.world(floor, materials=(GREY,), view=camera, fps=1.0, **lights)
    x = np.linspace(-1.5, 0.5, 20001)
    expected = 0.5 / np.pi * np.trapezoid(intensity / (1 + x**2) ** 1.5, x) / 2.0
    frame = hw.render(replace(scene, fps=2.0), 3, spp=256, max_depth=2)
    mean, error = hw.mean_and_error(frame)
    assert np.all(np.abs(mean - expected) < 4 * error + 1e-3 * expected)
    assert np.all(error < 0.01 * expected)


def test_blur_changes_nothing_where_nothing_moves():
    scene = strip(hw.IDENTITY, view())
    assert "motion blur" in describe_build(scene, RenderOptions())["left out"]
    sharp = hw.render(hw.with_camera(scene, view(shutter_s=0.0)), spp=4).planes
    np.testing.assert_array_equal(hw.render(scene, spp=4).planes, sharp)


def test_an_object_that_rests_while_another_moves_stays_as_it_was():
    scene = strip(hw.IDENTITY, view())
    moving = replace(
        scene, meshes=(*scene.meshes, hw.ball(0.1)), instances=(*scene.instances, Instance(1, Glide((5, 0, -1))))
    )
    blurred, still = (
        hw.render(hw.with_camera(moving, view(shutter_s=s)), spp=4, max_depth=1).plane("Coverage") for s in (0.5, 0.0)
    )
    np.testing.assert_array_equal(blurred, still)


def test_variances_of_blurred_pixels_are_honest():
    """Over many seeds the variance of the mean is what frames say of themselves."""
    scene = strip(Glide((-0.75, 0, 0)), view(shutter_s=0.5))
    frames = [hw.render(scene, 1, spp=8, seed=seed, max_depth=1) for seed in range(60)]
    actual = np.var([f.plane("G") for f in frames], axis=0, ddof=1).mean()
    said = np.mean([f.plane("Variance.G") for f in frames])
    assert abs(said / actual - 1) < 0.15


@pytest.mark.parametrize("jump_s", [1.01, 1.0, 0.9, 0.59999])
def test_a_jump_bends_nothing_before_and_after_it(jump_s):
    """Where a motion starts over within the exposure, what is shown are its two parts, and a trace between them.

    That is so at a key too, where speeds are taken over the jump.
    """

    @dataclass(frozen=True)
    class Jump:
        duration_s: float = 10.0

        def pose(self, time_s):
            return hw.translation(-0.5 if time_s < jump_s else 0.5, 0.0, 0.0)

    times = key_times(1.0, 0.8)
    steps = key_steps([Jump()], times, np.array([[Jump().pose(t)[:3, 3]] for t in times]))
    assert np.all(steps == 0)
