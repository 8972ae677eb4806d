"""How many frames a second pixels are traced between."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from clsim.live.options import LiveOptions
from clsim.live.pacing.base_rate import _seen, base_fps, camera_px_s, fastest_px_s
from clsim.live.pacing.schedule import plan
from clsim.live.stages import plan_stages
from clsim.scene import Camera, Instance, Static, World, load_world
from clsim.scene.modulation import Pwm, Sine
from clsim.scene.motion import Keyframes
from clsim.scene.shapes import box
from clsim.scene.world import ImageTexture, Lens, Material, SphereLight

UPRIGHT = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Spin:
    """Turns about the line of sight."""

    turns_per_s: float
    duration_s: float = 1.0

    def pose(self, time_s):
        angle = 2 * math.pi * self.turns_per_s * time_s
        pose = np.eye(4)
        pose[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
        return pose


class Roll(Spin):
    """Turns so, 4 m before the origin."""

    def pose(self, time_s):
        pose = super().pose(time_s)
        pose[2, 3] = 4.0
        return pose


def world(motion, fps=960.0):
    """A box 2 m wide and high, as thin as paper, 4 m before a camera of which a pixel there is 4 cm."""
    back = np.eye(4)
    back[2, 3] = 4.0
    fov_deg = math.degrees(2 * math.atan(2.0 / 4.0))
    return World(
        "thing", Camera(100, 80, fov_deg, Static(back)), (box((2.0, 2.0, 1e-6), 0),), (Instance(0, motion),),
        (), fps=fps,
    )  # fmt: skip


def test_speeds_are_those_of_the_pinhole():
    """3 m/s are 75 pixels a second; a corner √2 m from the axis goes round 5 times a second."""
    along = Keyframes((0.0, 1.0), ((-1.5, 0.0, 0.0), (1.5, 0.0, 0.0)), (UPRIGHT, UPRIGHT))
    assert fastest_px_s(world(along)) == pytest.approx(75.0, rel=1e-4)
    flat = replace(world(along).camera, lens=Lens(model="orthographic", view_width_m=4.0))
    assert fastest_px_s(replace(world(along), camera=flat)) == pytest.approx(75.0, rel=1e-4), "of pixels of 4 cm too"
    assert fastest_px_s(world(Spin(5.0))) == pytest.approx(10 * math.pi * math.sqrt(2) * 25, rel=1e-3)
    behind = Keyframes((0.0, 1.0), ((-1.5, 0.0, 9.0), (1.5, 0.0, 9.0)), (UPRIGHT, UPRIGHT))
    aside = Keyframes((0.0, 1.0), ((20.0, 0.0, 0.0), (30.0, 0.0, 0.0)), (UPRIGHT, UPRIGHT))
    assert fastest_px_s(world(behind)) == fastest_px_s(world(aside)) == 0.0


def test_a_camera_is_as_fast_as_most_of_what_it_sees():
    """By what stands still: 3 m/s past a box 4 m away are 75 pixels a second; roll is 2π · 5 a second, to the rim."""
    still = world(Static(np.eye(4)))
    along = Keyframes((0.0, 0.5), ((0.0, 0.0, 4.0), (1.5, 0.0, 4.0)), (UPRIGHT, UPRIGHT))
    assert camera_px_s(replace(still, camera=replace(still.camera, motion=along))) == pytest.approx(75.0, rel=1e-3)
    ahead = np.eye(4)
    ahead[2, 3] = 1.0
    for nearer, px_s in ((1, 75.0), (4, 100.0)):
        things = (*still.instances * 16, *[Instance(0, Static(ahead))] * nearer)
        seen = replace(still, instances=things, camera=replace(still.camera, motion=along))
        assert camera_px_s(seen) == pytest.approx(px_s, rel=1e-3), "one in seventeen is few, four in twenty are not"
    aside = np.eye(4)
    aside[:3, 3] = 10.0, 0.0, 3.0
    out_of_sight = replace(still, instances=(*still.instances, *[Instance(0, Static(aside))] * 9))
    out_of_sight = replace(out_of_sight, camera=replace(still.camera, motion=along))
    assert camera_px_s(out_of_sight) == pytest.approx(75.0, rel=1e-3), "what is beside the picture tells nothing"
    turned = np.array([(0.0, 0, 1, 0), (0, 1, 0, 0), (-1, 0, 0, 0), (0, 0, 0, 1)])  # +x leads away from the camera
    post = box((1e-6, 1.0, 1.0), 0)
    away = replace(
        still,
        meshes=(replace(post, vertices=post.vertices + np.float32((6.0, 0.0, 0.0))),),
        instances=(Instance(0, Static(turned)),),
        camera=replace(still.camera, motion=along),
    )
    assert camera_px_s(away) == pytest.approx(30.0, rel=1e-3), "10 m away"
    rolls = replace(still.camera, motion=Roll(5.0))
    assert camera_px_s(replace(still, camera=rolls)) == pytest.approx(10 * math.pi * math.sqrt(2) * 25, rel=1e-3)
    assert camera_px_s(still) == camera_px_s(world(Spin(5.0))) == 0.0
    moving = world(Spin(5.0))
    assert camera_px_s(replace(moving, camera=replace(moving.camera, motion=along))) == 0.0, "nothing stands still"


@pytest.mark.parametrize(
    ("turns_per_s", "own", "expected"),
    [(0.2, 960.0, 30.0), (5.0, 960.0, 120.0), (5.0, 100.0, 100.0), (0.2, 24.0, 24.0)],
)
def test_fast_objects_get_more_frames(turns_per_s, own, expected):
    """5 turns are 1111 px/s, at 12 a frame 92.6 frames; the scene's own rate is the most."""
    assert base_fps(world(Spin(turns_per_s), own)) == expected


def test_changing_light_gets_the_frames_that_it_asks_for():
    flickers = replace(world(Spin(0.2)), environment_modulation=Sine(10.0))
    assert base_fps(flickers) == 120.0, "ten a period are 100"
    assert base_fps(replace(flickers, fps=24.0)) == 120.0
    assert base_fps(replace(flickers, environment_modulation=Pwm(1000.0))) == 1920.0
    assert base_fps(replace(flickers, environment_modulation=Sine(1.0, 0.0))) == 30.0
    film = ImageTexture(np.zeros((1, 1, 4), np.uint8), film=SimpleNamespace(least_fps=200.0))
    shows = replace(flickers, environment_modulation=None, textures=(film,), materials=(Material(emission_texture=0),))
    assert base_fps(shows) == 240.0
    slow, fast = (SphereLight(0.1, (1.0, 1.0, 1.0), Static(np.eye(4)), modulation=Sine(hz)) for hz in (2.0, 40.0))
    for lamps in ((slow, fast), (fast, slow)):
        assert base_fps(replace(flickers, sphere_lights=lamps)) == 480.0, "the fastest of all tells, 400 are asked for"


def test_a_run_between_frames_has_them_unless_told_otherwise():
    still = load_world("two-boxes", resolution=(8, 6))
    flickers = replace(still, environment_modulation=Sine(120.0))
    for given, seen, expected in (({}, still, 30.0), ({}, flickers, 1920.0), ({"fps": 60.0}, flickers, 60.0)):
        stages = plan_stages(LiveOptions("two-boxes", time="adaptive", **given), seen)
        assert stages.fps == expected
        assert any("changes too fast" in each for each in stages.warnings) == bool(given)


@pytest.mark.parametrize(
    ("given", "fps", "ends_us"),
    [
        ({"duration_s": 0.05}, 40.0, 50_000),
        ({"duration_s": 0.2}, 30.0, 200_000),
        ({"duration_s": 0.01}, 100.0, 10_000),
        ({"duration_s": 0.05, "fps": 30.0}, 30.0, 66_667),
        ({"duration_s": 0.05, "frame_rate": 15.0, "truth": ("depth",), "outputs": ("a.h5",)}, 30.0, 66_667),
        ({"duration_s": 0.05, "time": "fixed"}, 120.0, 50_000),
    ],
)
def test_a_run_whose_rate_nobody_chose_is_as_long_as_it_was_asked_to_be(given, fps, ends_us):
    options = LiveOptions("two-boxes", **{"time": "adaptive"} | given)
    stages = plan_stages(options, load_world("two-boxes", resolution=(8, 6)))
    schedule = plan(2.0, stages.fps, duration_s=options.duration_s)
    assert stages.fps == pytest.approx(fps) and schedule.time_us(schedule.total - 1) == ends_us


def test_what_overlaps_the_picture_is_seen_whichever_side_is_the_longer_one() -> None:
    corners = np.array([(x, y) for x in (-1.0, 1.0) for y in (-1.0, 1.0)] * 2)
    for width, height in ((80, 40), (40, 80)):
        for x, y in ((30.0, 0.0), (-30.0, 0.0), (0.0, 30.0), (0.0, -30.0)):
            overlaps = abs(x) < width / 2 + 1 and abs(y) < height / 2 + 1
            assert _seen(corners + np.array((x, y)), width, height) == overlaps
