"""Where objects move fast, pixels are traced between frames without being asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import clsim
from clsim.bench.edge import edge_scene
from clsim.errors import InputError
from clsim.live.options import LiveOptions
from clsim.live.pacing.base_rate import camera_px_s
from clsim.live.rendering import Rendering
from clsim.live.stages import FAST_PX, plan_stages
from clsim.scene import load_world
from tests.simulator.stage import keyframed, scene
from tools.accuracy.fast_scenes import Faster

FPS = 120.0
SIZE = 32, 24


def world(way_px):
    """An edge that goes so far from frame to frame; its box goes about as far."""
    return edge_scene("geometric", way_px * FPS, *SIZE, FPS).world


def planned(way_px, **given):
    return plan_stages(LiveOptions("edge", fps=FPS, **given), world(way_px))


@pytest.mark.parametrize("quality", [None, "balanced", "accurate", "exact"])
def test_fast_objects_are_followed_between_frames_and_slow_ones_are_not(quality):
    fast, slow = planned(2 * FAST_PX, quality=quality), planned(FAST_PX / 2, quality=quality)
    assert fast.options.time == "adaptive" and fast.retracing is not None
    assert slow.options.time == "fixed" and slow.retracing is None
    assert fast.fps == slow.fps == FPS, "frames are as many as ever"
    assert ["traced between" in note for note in fast.notes] == [True] and not slow.notes


@pytest.mark.parametrize(
    "given",
    [
        {"quality": "draft"},
        {"quality": "published"},
        {"method": "esim"},
        {"time": "fixed"},
        {"pace": "real"},
        {"confidence": 1.0},
        {"noise": "independent"},
        {"event_rule": "frame"},
        {"fps": 2 * FPS},
    ],
    ids=str,
)
def test_they_are_not_where_something_else_is_asked_for(given):
    stages = plan_stages(LiveOptions("edge", **{"fps": FPS} | given), world(1.6 * FAST_PX))
    assert stages.options.time == "fixed" and stages.retracing is None and not stages.notes


def test_a_fast_camera_gets_told_how_many_frames_it_wants():
    """More pictures are better and cheaper there than pixels traced between: all pixels are in motion."""
    slow = load_world("two-boxes", resolution=SIZE)
    fast = replace(slow, camera=replace(slow.camera, motion=Faster(slow.camera.motion, 64.0)))
    way_px = camera_px_s(fast) / FPS
    assert 2.0 < way_px < 8.0
    told = plan_stages(LiveOptions("two-boxes", fps=FPS), fast)
    assert told.options.time == "fixed"
    (sentence,) = told.warnings
    fps = float(sentence.rpartition("`fps` ")[2])
    assert f"{way_px:.1f} pixels" in sentence and 0.5 < camera_px_s(fast) / fps <= 1.0
    for seen, given in ((slow, {}), (fast, {"fps": fps}), (fast, {"time": "fixed"}), (fast, {"pace": "real"})):
        assert plan_stages(LiveOptions("two-boxes", **{"fps": FPS} | given), seen).warnings == ()


def test_they_are_not_where_a_camera_exposes_or_moves():
    """Where it moves most pixels change, and what is traced between frames is seldom worth its cost."""
    fast = world(2 * FAST_PX)
    glides = load_world("two-boxes", resolution=SIZE).camera.motion
    for other in ({"shutter_s": 0.004}, {"motion": glides}):
        seen = replace(fast, camera=replace(fast.camera, **other))
        assert plan_stages(LiveOptions("edge", fps=FPS), seen).options.time == "fixed"


def test_times_are_as_exact_as_the_quality_asks_for():
    for quality, expected in (("balanced", 100.0), ("accurate", 30.0), ("exact", 30.0)):
        assert planned(2 * FAST_PX, quality=quality).retracing.tolerance_us == expected
    asked = planned(2 * FAST_PX, time="adaptive", quality="accurate", time_tolerance_us=70.0)
    assert asked.retracing.tolerance_us == 70.0 and not asked.notes


@pytest.mark.slow
def test_a_stream_and_a_simulator_follow_them_alike(tmp_path):
    """At 60 frames a second the box goes 3 pixels from one to the next."""
    file = scene(tmp_path, keyframed())
    with clsim.stream(file, frame_count=3, fps=60.0) as events:
        live = np.concatenate(list(events))
    assert len(np.unique(live["t"])) > 100
    with clsim.Simulator(file, fps=60.0) as simulator:
        assert np.array_equal(np.concatenate([simulator.step(20_000), simulator.step(33_333)]), live)
        with pytest.raises(InputError, match="`time` adaptive knows the scene's own light"):
            simulator.set_light("lamp", (1.0, 1.0, 1.0))


def test_what_is_set_is_seen_at_frames_alone(tmp_path):
    file = scene(tmp_path, keyframed())

    def events(**options):
        with clsim.Simulator(file, fps=60.0, **options) as simulator:
            simulator.set_light("lamp", (10.0, 10.0, 10.0))
            return simulator.step(33_333)

    np.testing.assert_array_equal(events(), events(time="fixed"))


def test_frames_for_files_are_rendered_alone_unless_more_is_asked_for(tmp_path):
    file = scene(tmp_path, keyframed())
    assert [Rendering(LiveOptions(file, fps=60.0, time=time)).between for time in ("auto", "adaptive")] == [False, True]
