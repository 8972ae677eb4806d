"""The synchronous driver gives what live runs give."""

import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import clsim
from clsim.detector import Detector
from clsim.errors import Error, InputError
from clsim.events import CAUSES
from clsim.live.stages import Stages
from clsim.render import RenderCancelled
from clsim.render.view import View
from clsim.sensor import SensorSettings
from clsim.sensor.pixel_stages import Leak
from clsim.simulator.snapshot import Snapshot
from clsim.truth.labels import Labeller
from tests.simulator import stage

SIZE, FPS, FRAMES = (48, 36), 60.0, 8


def live(scene: str, **options: object) -> np.ndarray:
    with clsim.stream(scene, resolution=SIZE, fps=FPS, frame_count=FRAMES, **options) as run:
        return np.concatenate(list(run))


def simulator(scene: str, **options: object) -> clsim.Simulator:
    return clsim.Simulator(scene, resolution=SIZE, fps=FPS, **options)


@pytest.mark.parametrize(
    "options",
    [{}, {"quality": "draft"}, {"method": "esim-ad"}, {"method": "esim", "noise": "independent", "seed": 3}],
    ids=["balanced", "draft", "esim-ad", "independent"],
)
def test_steps_of_any_length_give_the_bits_of_a_live_run(options: dict[str, object]) -> None:
    expected = live("two-boxes", **options)
    assert len(expected) > 50
    end_us = round((FRAMES - 1) * 1e6 / FPS)
    with simulator("two-boxes", **options) as run:
        whole = run.step(end_us)
        assert whole.tobytes() == expected.tobytes() and run.time_us == end_us
        run.reset()
        assert run.time_us == 0
        parts = [run.step(until_us) for until_us in (0, 0, 1_000, 16_667, 40_000, 90_000, end_us)]
    assert np.concatenate(parts).tobytes() == expected.tobytes()
    assert [len(part) for part in parts[:3]] == [0, 0, 0], "frame 0 sets the references, and 1 ms holds no frame more"
    assert parts[3]["t"].max() <= 16_667 < parts[4]["t"].min()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "options"),
    [
        ("cornell", {"quality": "accurate"}),
        ("cornell", {"quality": "draft"}),
        pytest.param("moving-light", {"quality": "accurate"}, marks=pytest.mark.slow),
    ],
    ids=["paths stored", "objects go slowly", "a lamp moves"],
)
def test_where_a_live_run_chooses_by_the_scene_so_does_a_simulator(scene: str, options: dict[str, object]) -> None:
    expected = live(scene, **options)
    assert len(expected) > 20
    with simulator(scene, **options) as run:
        assert run.step(round((FRAMES - 1) * 1e6 / FPS)).tobytes() == expected.tobytes()


def test_no_thread_is_needed_nor_left() -> None:
    before = set(threading.enumerate())
    with simulator("two-boxes", threads=1) as run:
        run.step(20_000)
        assert set(threading.enumerate()) == before


def test_a_world_in_memory_is_a_scene() -> None:
    world = clsim.load_scene("two-boxes", resolution=SIZE)
    assert isinstance(world, clsim.World)
    with clsim.Simulator(world, fps=FPS) as run, simulator("two-boxes") as other:
        assert (run.width, run.height, run.fps) == (*SIZE, FPS) and run.world is world
        assert run.step(50_000).tobytes() == other.step(50_000).tobytes()
    with pytest.raises(InputError, match="`resolution` is for scenes that are loaded"):
        clsim.Simulator(world, resolution=SIZE)


def test_what_cannot_be_is_told() -> None:
    with pytest.raises(InputError, match="`spp` must be at least 1, got 0"):
        simulator("two-boxes", spp=0)
    with pytest.raises(InputError, match="did you mean two-boxes"):
        simulator("two-boxs")
    world = clsim.load_scene("two-boxes", resolution=(16, 12))
    world = replace(world, warnings=("lacks fog",))
    with clsim.Simulator(world, method="irradiance", history=2) as run:
        assert run.warnings == ("lacks fog", "`method` irradiance has no use for `history`")
        run.step(20_000)
        with pytest.raises(InputError, match="`until_us` must not be before the last frame, at 16667 µs, got 10000"):
            run.step(10_000)
        for use, sentence in (
            (lambda: run.pose("red box", float("nan")), "`time_us` must be a finite number, got nan"),
            (lambda: run.pose(["red box"]), r"`name` must be a text, got \['red box'\]"),
            (lambda: run.set_light("lamp", (0.0, 1.0, 1e39)), r"`radiance` must not be negative, nor more than 1e\+30"),
            (lambda: run.restore(None), "`state` must be what `snapshot` returns, got None"),
        ):
            with pytest.raises(InputError, match=sentence):
                use()
    run.close()
    for use in (lambda: run.step(30_000), run.reset, lambda: run.set_camera(np.eye(4))):
        with pytest.raises(Error, match="the simulator is closed"):
            use()


def test_settings_reach_the_stages() -> None:
    """Each would go unseen where both drivers lost it alike."""
    end_us = round((FRAMES - 1) * 1e6 / FPS)
    with simulator("still", method="esim", noise="independent") as noisy, simulator("still", method="esim") as quiet:
        assert len(noisy.step(end_us)) > 0 == len(quiet.step(end_us))
    found = {}
    for name, options in {
        "seed 0": {},
        "seed 1": {"seed": 1},
        "frame rule": {"event_rule": "frame"},
        "deaf to OFF": {"threshold": (0.2, 50.0)},
        "shallow": {"max_depth": 1},
    }.items():
        with simulator("two-boxes", method="esim", **options) as run:
            found[name] = run.step(end_us)
    assert len({events.tobytes() for events in found.values()}) == len(found)
    on_grid = {round(k * 1e6 / FPS) for k in range(FRAMES)}
    assert set(found["frame rule"]["t"].tolist()) <= on_grid < set(found["seed 0"]["t"].tolist()) | on_grid
    assert found["deaf to OFF"]["on"].all() and not found["seed 0"]["on"].all()


def test_a_reset_lets_go_of_what_was_built() -> None:
    with simulator("two-boxes") as run:
        run.step(0)
        before = run._camera_pipeline.view
        run.reset()
        with pytest.raises(RenderCancelled):
            before.fill(1, run._camera_pipeline._frame)


def test_what_is_set_after_a_reset_is_seen_in_the_first_frame(tmp_path: Path) -> None:
    """Also where there was no other frame before, so that the time is the same."""
    seen = []
    with stage.simulator(tmp_path) as run:
        for x in (0.0, 0.3, 0.0):
            run.reset()
            run.set_pose("box", ((x, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)), 0)
            run.step(0)
            seen.append(run.frame().planes)
    assert (seen[0] != seen[1]).any() and (seen[0] == seen[2]).all()


@pytest.mark.parametrize("at_us", [None, 5_000])
def test_of_two_poses_for_one_time_the_later_one_holds(tmp_path: Path, at_us: int | None) -> None:
    upright = (0.0, 0.0, 0.0, 1.0)
    with stage.simulator(tmp_path) as run:
        for x in (0.4, 0.1):
            run.set_pose("box", ((x, 0.0, 0.0), upright), at_us)
        run.step(5_000)
        assert run.pose("box")[0, 3] == pytest.approx(0.1)
        assert run.pose("box", 0)[0, 3] == 0.0, "where it began"


@pytest.mark.parametrize("at_us", [None, 7_000])
def test_a_camera_may_be_put_by_the_axes_of_either_kind(tmp_path: Path, at_us: int | None) -> None:
    """By one +y is up and it looks along −z, by the other +y is down and it looks along +z: half a turn about x."""
    pose = np.array([[0.0, 0.0, 1.0, 0.2], [1.0, 0.0, 0.0, 0.4], [0.0, 1.0, 0.0, 3.0], [0.0, 0.0, 0.0, 1.0]])
    for axes, turn in (("opengl", (1.0, 1.0, 1.0, 1.0)), ("opencv", (1.0, -1.0, -1.0, 1.0))):
        with stage.simulator(tmp_path) as run:
            run.set_camera(pose @ np.diag(turn), at_us, axes=axes)
            run.step(10_000)
            np.testing.assert_allclose(run.pose("camera", 9_999), pose, atol=1e-3 if at_us is None else 1e-12)


def test_who_changes_a_pose_that_was_told_moves_nothing(tmp_path: Path) -> None:
    with stage.simulator(tmp_path) as run:
        for name in ("floor", "box", "lamp", "camera"):
            expected = run.pose(name).copy()
            run.pose(name)[:3, 3] = 7.0
            assert (run.pose(name) == expected).all()


def test_a_lamp_of_one_colour_can_be_set_and_one_without_light_cannot(tmp_path: Path) -> None:
    file = Path(stage.scene(tmp_path))
    file.write_text(file.read_text().replace("radiance = [20.0, 20.0, 20.0]", "radiance = [0.0, 20.0, 0.0]"))
    with clsim.Simulator(file) as run:
        run.step(0)
        green = run.frame().plane("G").mean()
        run.set_light("lamp", (0.0, 0.0, 0.0))
        run.step(5_000)
        assert run.frame().plane("G").mean() < 0.95 * green
    file.write_text(file.read_text().replace("radiance = [0.0, 20.0, 0.0]", "radiance = [0.0, 0.0, 0.0]"))
    with clsim.Simulator(file) as run, pytest.raises(InputError, match="'lamp' shines in stage"):
        run.set_light("lamp", (1.0, 1.0, 1.0))


def test_causes_are_those_of_the_last_steps_events_one_by_one() -> None:
    """However long the steps are: some have several frames, some one or none."""
    found: list[tuple[np.ndarray, np.ndarray]] = []
    leaky = SensorSettings(leak=Leak(20.0))
    with simulator("two-boxes", method="esim", sensor=leaky) as run:
        for ends_us in ((100_000,), (40_000, 42_000, 60_000, 100_000)):
            parts = []
            for until_us in ends_us:
                parts.append((run.step(until_us), run.causes))
                assert len(parts[-1][0]) == len(run.causes)
            found.append(tuple(map(np.concatenate, zip(*parts, strict=True))))
            run.reset()
    whole, cut = found
    assert whole[0].tobytes() == cut[0].tobytes() and whole[1].tobytes() == cut[1].tobytes()
    assert {CAUSES[cause] for cause in whole[1]} == {"signal", "leak"}


def test_what_could_not_be_built_is_told_and_built_by_the_next_step(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(stages: Stages) -> None:
        raise InputError("no such device")

    with simulator("two-boxes") as run:
        with monkeypatch.context() as patch:
            patch.setattr(Stages, "build_detector", refuse)
            with pytest.raises(InputError, match="no such device"):
                run.step(0)
        assert len(run.step(50_000)) > 0
    run = simulator("two-boxes")
    monkeypatch.setattr(Stages, "build_detector", refuse)
    with pytest.raises(InputError, match="no such device"), run:
        run.step(0)


def test_what_a_simulator_holds_is_given_back_once_it_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its renderer's and its detector's memory, and each once though it is closed twice."""
    closed = []
    for kind in (View, Detector):
        close = kind.close
        monkeypatch.setattr(kind, "close", lambda self, close=close: (closed.append(type(self)), close(self))[1])
    run = simulator("still", method="esim", quality="draft")
    run.step(0)
    run.close()
    run.close()
    assert set(closed) == {View, Detector} and len(closed) == 2


def test_steps_by_the_wall_clock_end_when_their_time_has_come(monkeypatch: pytest.MonkeyPatch) -> None:
    """Told by a clock that goes on by nothing but waiting, and by 70 ms of work once."""
    now_s, waits = [100.0], []

    def sleep(seconds: float) -> None:
        waits.append(seconds)
        now_s[0] += seconds

    monkeypatch.setattr("clsim.simulator.stepping.time", SimpleNamespace(perf_counter=lambda: now_s[0], sleep=sleep))
    with simulator("still", method="esim", quality="draft", clock="wall") as run:
        run.step(10_000)
        run.step(30_000)
        assert waits == pytest.approx([0.0, 0.02]) and run.lag_s == 0
        now_s[0] += 0.07
        run.step(50_000)
        assert waits[-1] == 0 and run.lag_s == pytest.approx(0.05)
        run.step(130_000)
        assert waits[-1] == pytest.approx(0.03) and run.lag_s == 0
        run.reset()
        run.step(10_000)
        run.step(30_000)
        assert waits[-2:] == pytest.approx([0.0, 0.02]) and run.lag_s == 0, "the first step's end is now, again"


def test_light_that_was_set_before_a_snapshot_shines_again_after_another(tmp_path: Path) -> None:
    def goes_on() -> bytes:
        return run.step(30_000).tobytes() + run.frame().planes.tobytes()

    with stage.simulator(tmp_path, seed=3) as run:
        run.step(10_000)
        run.set_light("lamp", (26.0, 24.0, 22.0))
        run.step(20_000)
        saved, first = run.snapshot(), goes_on()
        run.set_light("lamp", (0.0, 0.0, 0.0))
        run.step(40_000)
        run.restore(saved)
        assert goes_on() == first


def test_a_snapshot_after_a_reset_knows_nothing_of_light_that_was_set_before(tmp_path: Path) -> None:
    def goes_on() -> bytes:
        run.set_pose("box", ((0.2, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)), 20_000)
        return run.step(20_000).tobytes() + run.frame().planes.tobytes()

    with stage.simulator(tmp_path, seed=3) as run:
        run.step(10_000)
        fresh = run.frame().planes
        run.set_light("lamp", (0.0, 0.0, 0.0))
        run.step(20_000)
        run.reset()
        run.step(10_000)
        assert (run.frame().planes == fresh).all()
        saved, first = run.snapshot(), goes_on()
        run.restore(saved)
        assert goes_on() == first


def test_a_snapshot_holds_what_a_camera_that_stands_saw(tmp_path: Path) -> None:
    """A box that goes on after it is not where it then was; without a trace of it once it is restored."""

    def goes_on(*places: float) -> list[bytes]:
        found = []
        for x in places:
            run.set_pose("box", ((x, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
            found.append(run.step(run.time_us + 10_000).tobytes() + run.frame().planes.tobytes())
        return found

    with stage.simulator(tmp_path, quality="draft") as run:
        goes_on(0.0, 0.05, 0.1, 0.15)
        saved, first = run.snapshot(), goes_on(0.2, 0.25)
        goes_on(-0.3, -0.5)
        run.restore(saved)
        assert goes_on(0.2, 0.25) == first


def test_a_snapshot_holds_the_poses_that_wait_for_the_end_of_a_step_and_no_others(tmp_path: Path) -> None:
    aside = (0.4, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
    with stage.simulator(tmp_path) as run:
        run.step(0)
        before = run.snapshot()
        run.set_pose("box", aside)
        waits, moved = run.snapshot(), run.step(10_000).tobytes()
        assert moved
        run.restore(waits)
        assert run.step(10_000).tobytes() == moved
        run.restore(before)
        assert not len(run.step(10_000))


def test_all_that_can_be_read_is_after_a_restore_what_it_was(tmp_path: Path) -> None:
    def told() -> dict[str, object]:
        frame = run.frame()
        return {
            "frame": (frame.planes.tobytes(), frame.time_us, frame.index),
            "truth": {name: values.tobytes() for name, values in run.truth().items()},
            "causes": run.causes.tobytes(),
            "times": (run.time_us, run.frame_time_us),
            "poses": [run.pose(name).tobytes() for name in run.names],
        }

    with stage.simulator(tmp_path) as run:
        run.step(0)
        run.set_pose("box", ((0.4, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
        assert len(run.step(10_000)) and len(run.causes)
        saved, before = run.snapshot(), told()
        run.set_pose("box", ((0.0, 0.2, 0.0), (0.0, 0.0, 0.0, 1.0)))
        run.step(30_000)
        assert all(told()[name] != before[name] for name in before)
        run.restore(saved)
        assert told() == before


def test_what_an_object_lacked_at_a_snapshot_it_lacks_again() -> None:
    """What is found once and kept must be found anew, for it may be of what came later."""
    held = Labeller()
    snapshot = Snapshot([held], None)
    held._last, held.found_later = (3, np.zeros(2, np.float32)), 1  # type: ignore[attr-defined]
    snapshot.restore()
    assert vars(held) == {"_last": None}


def test_no_light_is_left_where_the_only_lamp_is_put_out() -> None:
    """Nothing moves but the camera, so that what is cached of the light would stay."""
    with clsim.Simulator("cornell", resolution=(32, 24), fps=200.0, quality="draft") as run:
        run.step(10_000)
        assert run.frame().planes[:3].mean() > 0.1
        run.set_light("lamp", (0.0, 0.0, 0.0))
        run.step(15_000)
        assert run.frame().planes[:3].max() == 0.0
