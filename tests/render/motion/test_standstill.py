"""Frames in which nothing moves: none is rendered, and what follows is as if each had been."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.frames import Frame, page_aligned
from clsim.render import PathTracer, RenderOptions
from clsim.render.cache.light_cache_host import LightCacheHost
from clsim.render.motion.standstill import Standstill
from clsim.render.primary.effort import Effort
from clsim.scene import SphereLight, Static
from clsim.scene.driven import Driven
from clsim.scene.modulation import Pwm
from tests.render import hand_worlds as hw
from tests.render.motion.test_deform import Swell

pytestmark = pytest.mark.usefixtures("ordinary")

STAYS = (0.0, 0.0, 0.0, 1.0)
CACHED = RenderOptions(
    spp=8, probe_spp=1, probe_every=1000, first_hit_rays=16, sampler="sobol", light_cache=True, fps=100, frames=9
)
PLAIN = RenderOptions(spp=2, noise="common", fps=100, frames=9)
SHUTTER_S = 0.004


def driven(*keys):
    """Return a motion through positions at times [s]."""
    motion = Driven(hw.IDENTITY)
    for time_s, position in keys:
        motion.set(time_s, (position, STAYS, 1.0))
    return motion


def rests_between(first, second):
    """From one place to another until .03 s, where it stays until .1 s, and back until .12 s."""
    return driven((0.0, first), (0.03, second), (0.1, second), (0.12, first))


def world_of(**moves):
    """A box before two walls in lamplight; what is not given stands."""
    pose = hw.look_from((0.6, 1.6, 4.5), (0, 0.7, -0.5))
    lamp = moves.get("lamp", Static(hw.translation(1.2, 3.0, 1.0)))
    return hw.world(
        hw.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4)),
        hw.quad((-2, 0, -2), (4, 0, 0), (0, 4, 0)),
        hw.box((-0.4, -0.4, -0.4), (0.4, 0.4, 0.4)),
        view=replace(hw.camera(pose, 20, 16), motion=moves.get("camera", Static(pose))),
        motions=[hw.IDENTITY, hw.IDENTITY, moves.get("box", Static(hw.translation(0.3, 0.4, 0.0)))],
        sphere_lights=(SphereLight(0.2, (40.0, 40.0, 40.0), lamp, "lamp", moves.get("modulation")),),
    )


MOVES = {
    "box": {"box": rests_between((0.4, 0.4, 0.0), (-0.3, 0.4, 0.2))},
    "camera": {"camera": rests_between((0.0, 1.0, 4.5), (0.3, 1.1, 4.0))},
    "lamp": {"lamp": rests_between((1.2, 3.0, 1.0), (0.2, 3.0, 1.0))},
}


@pytest.fixture
def rendered(monkeypatch):
    """Return a function that counts the frames that are rendered."""
    numbers, render = [], PathTracer._render_at

    def counted(tracer, index, time_us, out):
        numbers.append(index)
        render(tracer, index, time_us, out)

    monkeypatch.setattr(PathTracer, "_render_at", counted)
    return numbers


def frames(world, options, count=15, then=lambda tracer, index: None):
    """Return the planes of frames 10 ms apart ``[frames, C, H, W]``, and tell ``then`` of each one first."""
    tracer = PathTracer(world, options)
    frame = Frame(page_aligned((len(tracer.names), tracer.height, tracer.width)), tracer.names)
    found = []
    try:
        for index in range(count):
            then(tracer, index)
            tracer.fill_at(index, index * 10_000, frame)
            assert (frame.index, frame.time_us) == (index, index * 10_000)
            found.append(frame.planes.copy())
            frame.planes.fill(np.nan)
    finally:
        tracer.close()
    return np.stack(found)


@pytest.mark.parametrize("who", MOVES)
@pytest.mark.parametrize("options", [CACHED, PLAIN, replace(CACHED, light_hz=100.0)])
def test_frames_at_rest_are_as_if_they_were_rendered(monkeypatch, rendered, who, options):
    """While it stands three frames are rendered, and all from when it goes on; brightness is that of any other run."""
    world = world_of(**MOVES[who])
    shown = frames(world, options)[:, :3]
    assert rendered == [0, 1, 2, 3, 4, 5, 11, 12, 13, 14]
    np.testing.assert_array_equal(shown[6:11], shown[5:6].repeat(5, axis=0))
    monkeypatch.setattr(Standstill, "repeat", lambda *_: False)
    every = frames(world, options)[:, :3]
    assert len(rendered) == 10 + 15
    # More is learnt of cached light by all these frames, and shows in what is seen first afterwards.
    log = np.abs(np.log((shown.mean(axis=1) + 1e-5) / (every.mean(axis=1) + 1e-5)))
    assert log[:11].max() <= 2e-4 and log.mean() <= 2e-3


def test_a_lamp_that_goes_out_after_a_while_lets_nothing_rest(rendered):
    """It shines alike for ten frames; and is seen to go out at the eleventh."""
    shown = frames(world_of(modulation=Pwm(5.0, 0.5)), CACHED)[:, :3]
    assert rendered == list(range(15))
    assert shown[11].max() < 0.01 * shown[9].max()


@pytest.mark.slow  # kernels of their own are compiled
def test_what_deforms_lets_nothing_rest(rendered):
    ball = hw.ball(0.4, rings=8, smooth=True)
    world = world_of()
    swells = replace(ball, deformation=Swell(ball, smooth=True))
    frames(replace(world, meshes=(*world.meshes[:2], swells)), CACHED, 6)
    assert rendered == list(range(6))


@pytest.mark.parametrize("shutter_s", [0.0, 0.02])
def test_a_rest_ends_with_the_frame_whose_exposure_sees_the_first_move(shutter_s):
    """At .1 s; it is .095 s when such a shutter opens for .1 s + half of its time."""
    world = world_of(**MOVES["box"])
    still, planes = Standstill(world, replace(world.camera, shutter_s=shutter_s)), np.zeros(1, np.float32)
    repeated = []
    for time_s in (0.06, 0.07, 0.08, 0.085, 0.095):
        repeated.append(still.repeat(time_s, None, planes))
        if not repeated[-1]:
            still.remember(planes)
    assert repeated == [False, True, True, True, shutter_s == 0]


def test_where_a_camera_stands_is_asked_of_itself_and_not_of_the_worlds_own():
    goes, planes = rests_between((0.0, 1.0, 4.5), (0.3, 1.1, 4.0)), np.zeros(1, np.float32)
    for own, other in ((hw.IDENTITY, goes), (goes, hw.IDENTITY)):
        world = world_of(camera=own)
        still, repeated = Standstill(world, replace(world.camera, motion=other)), []
        for time_s in (0.0, 0.01, 0.02):
            repeated.append(still.repeat(time_s, None, planes))
            if not repeated[-1]:
                still.remember(planes)
        assert repeated == [False, other is not goes, other is not goes]


@pytest.mark.slow  # kernels of their own are compiled
def test_a_shutter_that_is_open_when_something_begins_to_move_sees_it(rendered):
    """What goes on at .1 s is seen by the frame whose exposure ends a moment later."""
    late = driven((0.0, (0.4, 0.4, 0.0)), (0.1 + SHUTTER_S / 4, (0.4, 0.4, 0.0)), (0.2, (-0.3, 0.4, 0.2)))
    world = world_of(box=late)
    frames(replace(world, camera=replace(world.camera, shutter_s=SHUTTER_S)), PLAIN)
    assert rendered == [0, 10, 11, 12, 13, 14]


def test_other_light_and_another_effort_end_a_rest(rendered):
    """Once each; then all rests again. Where nothing has happened yet, the first frame is all that is rendered."""

    def then(tracer, index):
        if index == 5:
            tracer._data.set_light("lamp", (10.0, 10.0, 10.0))
            tracer.forget_light()
        if index == 10:
            tracer.effort = Effort(8, 1, 4, 1000)

    shown = frames(world_of(), replace(CACHED, lights_set=True), then=then)[:, :3]
    assert rendered == [0, 5, 6, 7, 10, 11, 12]
    assert shown[7].mean() < 0.5 * shown[4].mean() and np.any(shown[12] != shown[9])


def test_frames_around_a_rest_tell_when_they_were(monkeypatch):
    """The step to the frame in which something moves again begins at the last frame, not at the last rendered one."""
    steps = []
    monkeypatch.setattr(LightCacheHost, "finish", _noting(steps, LightCacheHost.finish))
    frames(world_of(**MOVES["box"]), replace(CACHED, light_hz=100.0), 13)
    assert steps[-2:] == [(100_000, 110_000), (110_000, 120_000)]


def _noting(steps, finish):
    def noted(host):
        steps.append(host.step_us)
        return finish(host)

    return noted
