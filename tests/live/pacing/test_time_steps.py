"""Pixels traced between frames, in runs: options, drivers, loops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import clsim
from clsim.cli.app import app
from clsim.errors import InputError
from clsim.frames import Frame, page_aligned
from clsim.frames.exr import ExrSequence
from clsim.live.options import LiveOptions
from clsim.live.outputs.noting import NotingTracer
from clsim.live.pacing.schedule import Schedule
from clsim.live.pacing.time_steps import Retracing
from clsim.live.session import open_live
from clsim.live.stages import plan_stages
from clsim.render import RenderOptions
from clsim.scene import load_world
from clsim.score.matching import Sampling, one_to_one

SMALL = {"resolution": (32, 24), "time": "adaptive"}


def gathered(**options):
    with clsim.stream("two-boxes", **(SMALL | options)) as run:
        return np.concatenate(list(run)), run.fps


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"time": "adaptive", "method": "esim-ad"}, "`method` esim or irradiance, got esim-ad"),
        ({"time": "adaptive", "method": "wlr-esim"}, "`method` esim or irradiance, got wlr-esim"),
        ({"time": "adaptive", "quality": "published"}, "`method` esim or irradiance, got esim-ad"),
        ({"time": "adaptive", "quality": "exact", "noise": "independent"}, "`noise` common, got independent"),
        ({"time": "adaptive", "event_rule": "frame"}, "`event_rule` interpolated or linear-light, got frame"),
        ({"time": "adaptive", "first_hit_rays": 0}, "`first_hit_rays` of at least 1"),
        ({"time_tolerance_us": 20.0}, "is for `time` adaptive, but time is auto"),
        ({"time": "adaptive", "time_tolerance_us": 0.5}, "from 1 to 1e"),
        ({"time": "sometimes"}, "`time` must be one of auto, fixed, adaptive and lambda=PIXELS"),
        ({"time": "lambda=0"}, r"with 0\.001 to 1000 pixels, got lambda=0"),
        ({"time": "lambda=1e4"}, "got lambda=1e4"),
        ({"time": "lambda=half"}, "got lambda=half"),
        ({"time": "lambda=0.5", "time_tolerance_us": 20.0}, "is for `time` adaptive, but time is lambda=0.5"),
        ({"time": "lambda=0.5", "method": "esim-ad"}, "`time` lambda=0.5 needs `method` esim or irradiance"),
    ],
)
def test_what_cannot_go_together_is_told(given, message):
    with pytest.raises(InputError, match=message):
        LiveOptions("two-boxes", **given)


@pytest.mark.parametrize("way_px", [0.001, 1000.0])
def test_the_shortest_and_the_longest_way_between_pictures_may_be_chosen(way_px):
    assert LiveOptions("two-boxes", time=f"lambda={way_px:g}").time == f"lambda={way_px:g}"


def test_options_come_back_from_plain_values():
    options = LiveOptions("two-boxes", time="adaptive", time_tolerance_us=20.0)
    assert LiveOptions.from_dict(options.as_dict()).time_tolerance_us == 20.0


def test_a_loop_asks_for_the_times_of_its_motion(monkeypatch):
    class Tracer:
        names = ("R",)
        lit = True
        asked: tuple[float, ...] = ()

        def motion(self, start_s, end_s):
            self.asked = (start_s, end_s)

        def trace(self, pixels, times_s):
            self.asked = tuple(times_s)

        def reflected(self, pixels, light, start_s, end_s, fineness):
            self.asked = (start_s, end_s)

    tracer = Tracer()
    monkeypatch.setattr("clsim.render.SceneData", lambda *given, **named: None)
    monkeypatch.setattr("clsim.render.subframe.retracer.Retracer", lambda *given, **named: tracer)
    retracing = Retracing(100.0, None, RenderOptions())
    looping = retracing.tracer(load_world("two-boxes"), Schedule(30.0, 60, None, loop=True, periodic=True))
    looping.motion(0.0, 1 / 30)
    np.testing.assert_allclose(tracer.asked, (0.0, 1 / 30), atol=1e-6)
    # The third pass begins at 4 s: its first step is that of the motion, and the step before leads beyond its end.
    looping.motion(119 / 30, 4.0)
    np.testing.assert_allclose(tracer.asked, (59 / 30, 2.0), atol=1e-6)
    looping.motion(4.0, 121 / 30)
    np.testing.assert_allclose(tracer.asked, (0.0, 1 / 30), atol=1e-6)
    looping.trace(np.zeros(1, np.int32), np.array([4.01]))
    np.testing.assert_allclose(tracer.asked, 0.01, atol=1e-6)
    looping.reflected(np.zeros(1, np.int64), np.zeros((1, 3), np.float32), 4.0, 121 / 30, None)
    np.testing.assert_allclose(tracer.asked, (0.0, 1 / 30), atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    "options", [{"quality": "balanced"}, {"quality": "exact"}, {"quality": "balanced", "sensor": "davis346"}]
)
def test_a_live_run_and_a_simulator_agree_to_the_bit(options):
    events, fps = gathered(frame_count=4, spp=8, threads=2, **options)
    assert fps == 30.0 and len(events) > 300
    with clsim.Simulator("two-boxes", spp=8, threads=1, **options, **SMALL) as simulator:
        steps = [simulator.step(33_333), simulator.step(100_000)]
    np.testing.assert_array_equal(np.concatenate(steps), events)


@pytest.mark.slow
def test_whole_pictures_and_chosen_pixels_find_the_same_events():
    """Where things go a twentieth of a pixel between pictures, the line between them is all there is."""

    def run(**options):
        with clsim.Simulator("two-boxes", resolution=(32, 24), **options) as simulator:
            return simulator.step(66_667), simulator._camera_pipeline.detector.between.stats

    (close, many), (wide, few) = run(time="lambda=0.05"), run(time="lambda=0.5")
    chosen, _ = run(time="adaptive", time_tolerance_us=10.0)
    # Of each of two steps there is one part more than pictures between.
    assert 6 < (many.rounds + 2) / (few.rounds + 2) <= 10 and many.requests == many.rounds * 32 * 24
    apart = np.abs(one_to_one(chosen, close, Sampling(32, 24, 30.0), 1000))
    assert len(close) > 150 and len(apart) > 0.9 * max(len(close), len(chosen)) and np.median(apart) < 10
    assert len(wide) > 0.9 * len(close)


@pytest.mark.slow
def test_runs_of_any_rate_have_the_same_events():
    """What pixels show at a time is the same to the bit; which of their times are looked at is not."""

    def run(fps):
        with clsim.Simulator("two-boxes", fps=fps, time_tolerance_us=10.0, quality="accurate", **SMALL) as simulator:
            events = simulator.step(100_000)
            return events, simulator.frame().planes.copy()

    (few, last), *others = (run(fps) for fps in (30.0, 60.0, 240.0))
    for many, same in others:
        np.testing.assert_array_equal(same, last)
        apart = np.abs(one_to_one(many, few, Sampling(32, 24, 30.0), 1000))
        assert len(few) > 300 and len(apart) >= 0.97 * max(len(few), len(many)) and np.median(apart) <= 5


@pytest.mark.slow
def test_a_scene_that_stands_still_asks_for_nothing():
    assert clsim.stream("still", resolution=(32, 24), frame_count=3).fps == 120.0
    with clsim.Simulator("still", **SMALL) as simulator:
        assert len(simulator.step(100_000)) == 0
        assert simulator._camera_pipeline.detector.between.stats.requests == 0


@pytest.mark.slow
def test_light_cannot_be_set_while_time_is_adaptive():
    with clsim.Simulator("two-boxes", **SMALL) as simulator, pytest.raises(InputError, match="`time` adaptive"):
        simulator.set_light("lamp", (1.0, 1.0, 1.0))


def test_where_lamps_move_frames_are_as_many_as_without_and_it_is_told():
    """Uncached light knows nothing of a lamp's way between frames; cached light and whole paths do."""
    moving, kept, whole, still = (
        plan_stages(LiveOptions(scene, time="adaptive", **given))
        for scene, given in (
            ("moving-light", {"sampling": "adaptive"}),
            ("moving-light", {}),
            ("moving-light", {"quality": "exact"}),
            ("two-boxes", {}),
        )
    )
    assert (moving.fps, kept.fps, whole.fps, still.fps) == (120.0, 120.0, 120.0, 30.0)
    assert ["lamps move in moving-light" in told for told in moving.warnings] == [True]
    assert kept.warnings == whole.warnings == still.warnings == ()
    assert plan_stages(LiveOptions("moving-light", time="adaptive", fps=60.0)).fps == 60.0


def test_a_camera_that_exposes_has_no_instants():
    world = load_world("two-boxes", resolution=(16, 12))
    blurred = replace(world, camera=replace(world.camera, shutter_s=0.01))
    with pytest.raises(InputError, match=r"exposes for 0\.01 s; expected 0"):
        clsim.Simulator(blurred, time="adaptive")


@pytest.mark.slow
def test_a_snapshot_remembers_the_last_frame():
    """What is seen at the frame before is part of the state: the same step gives the same events again."""
    with clsim.Simulator("two-boxes", threads=1, **SMALL) as simulator:
        simulator.step(33_333)
        state = simulator.snapshot()
        first = simulator.step(66_667).copy()
        simulator.step(100_000)
        simulator.restore(state)
        np.testing.assert_array_equal(simulator.step(66_667), first)
        assert len(first) > 50


def test_what_was_traced_is_told_once_and_in_order():
    class Tracer:
        names, lit = ("A", "B"), True

        def trace(self, pixels, times_s):
            return np.stack([pixels, times_s]).astype(np.float32)

    tracer = NotingTracer(Tracer(), 10)
    for pixels in ((3, 27), (99,)):
        tracer.trace(np.array(pixels, np.int32), np.full(len(pixels), 0.25))
    found = tracer.take()
    assert (found.x.tolist(), found.y.tolist(), found.names.tolist()) == ([3, 7, 9], [0, 2, 9], ["A", "B"])
    assert found.planes.tolist() == [[3, 27, 99], [0.25] * 3] and found.time_s.tolist() == [0.25] * 3
    assert len(tracer.take().x) == 0


@pytest.mark.slow
def test_frames_are_rendered_at_the_times_of_a_file_and_pixels_between_them(tmp_path):
    times, frames, between = tmp_path / "times.txt", tmp_path / "frames", tmp_path / "between"
    times.write_text("0.002\n0.0101 second\n0.0333\n")
    shared = ["render", "two-boxes", "--resolution", "32x24"]
    run = CliRunner()
    assert run.invoke(app, [*shared, "--times", str(times), "--out", str(frames)]).exit_code == 0
    source = ExrSequence(frames)
    frame = Frame(page_aligned((len(source.names), 24, 32)), source.names)
    found = []
    for index in range(3):
        source.fill(index, frame)
        found.append(frame.time_us)
    assert found == [2000, 10100, 33300]
    again, evenly = tmp_path / "again", tmp_path / "evenly"
    repeat = ["render", "--config", str(frames / "frames.json"), "--out"]
    assert run.invoke(app, [*repeat, str(again)]).exit_code == 0
    pictures = [file.name for file in frames.glob("*.exr")]
    assert len(pictures) == 3 and all((again / each).read_bytes() == (frames / each).read_bytes() for each in pictures)
    assert run.invoke(app, [*repeat, str(evenly), "--frame-count", "2"]).exit_code == 0
    assert len(list(evenly.glob("*.exr"))) == 2
    asked = [*shared, "--times", "adaptive", "--frame-count", "3", "--out", str(between)]
    assert run.invoke(app, asked).exit_code == 0
    assert sorted(each.name for each in between.glob("*.npz")) == ["between-000001.npz", "between-000002.npz"]
    with np.load(between / "between-000002.npz") as traced, clsim.Simulator("two-boxes", **SMALL) as simulator:
        simulator.step(66_667)
        assert simulator._camera_pipeline.detector.between.stats.requests > len(traced["x"]) > 100
        assert traced["planes"].shape == (len(traced["names"]), len(traced["x"]))
        assert 1 / 30 < traced["time_s"].min() < traced["time_s"].max() < 2 / 30
    for wrong, told in (
        (["--truth", "depth"], "`truth` needs frames at an even rate"),
        (["--frame-count", "7"], "`times` say when frames are; leave out `frame_count`"),
    ):
        outcome = run.invoke(app, [*shared, "--times", str(times), *wrong, "--out", str(tmp_path)])
        assert told in str(outcome.exception)


@pytest.mark.slow
def test_a_run_at_the_pace_of_the_clock_gives_up_exact_times_first():
    """At a pace that nothing could keep: what is traced between frames gets fewer, and then samples do."""
    session = open_live(LiveOptions("two-boxes", pace="real", fps=2000.0, frame_count=60, **SMALL))
    session.start()
    assert session.pipeline.wait(120)
    summary = session.summary().as_dict()
    assert summary["governor"]["given_up"].startswith("time tolerance 100 -> 10000 us, samples 8 -> ")
    assert summary["effort"].keys() == {"probe_spp", "spp", "first_hit_rays", "every"}
