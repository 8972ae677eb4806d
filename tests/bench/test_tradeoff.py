"""The sweep from end to end, on a tiny scene."""

from __future__ import annotations

import contextlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from clsim.bench.tradeoff import measure as tradeoff_measure
from clsim.bench.tradeoff import sweep as tradeoff
from clsim.bench.tradeoff.mismatch import Levels, fire
from clsim.bench.tradeoff.reference_cache import RULES, Reference, load_or_render
from clsim.bench.tradeoff.settings import BASE, ESIM, ICIP_2023, IRRADIANCE, Point, Rendering, named_points
from clsim.bench.tradeoff.stopwatch import Stopwatch, peak_memory_bytes
from clsim.bench.tradeoff.sweep import TradeoffOptions, run_tradeoff
from clsim.cli.output.tradeoff_tables import markdown_text
from clsim.datasets.scene_file import scene_text
from clsim.errors import InputError
from clsim.events import EventBatch, empty_batch
from clsim.opencl.device import choose_device
from clsim.render import RenderOptions
from clsim.scene import load_world
from clsim.score import Score
from tests.shared_kernels import ORDINARY, widen

COMMON, FRESH = Rendering(2, "common", 0), Rendering(4, "independent", 0)
POINTS = (Point(COMMON, ESIM), Point(COMMON, BASE), Point(FRESH, ICIP_2023))
COSTS = {
    "paths", "first_hit_rays_traced", "solved_share", "render_cpu_s", "render_wall_s", "detect_cpu_s",
    "detect_wall_s", "cpu_s", "wall_s", "true_events", "peak_bytes",
    "startup_cpu_s", "startup_wall_s", "equivalent_mismatch", "cpu_us_per_pixel_second",
}  # fmt: skip


def options(cache: Path, **changes: Any) -> TradeoffOptions:
    given = {
        "points": POINTS,
        "reference_spp": 16,
        "resolution": (16, 12),
        "frames": 4,
        "fps": 20.0,
        "reference_budget_s": 0.0,
    } | changes
    return TradeoffOptions("two-boxes", cache, **given)


def ignore(what: str, done: float, total: float) -> None:
    """Tell nobody."""


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Any:
    with pytest.MonkeyPatch.context() as patch:
        widen(patch, request, ORDINARY)  # fixtures of modules come before those of tests
        yield run_tradeoff(options(tmp_path_factory.mktemp("cache")), ignore)


def batch(*events: tuple[int, int]) -> EventBatch:
    """Return ON events at times [ms] and columns."""
    made = empty_batch(len(events))
    made["t"], made["x"] = np.reshape(events, (-1, 2)).T * [[1000], [1]]
    made["y"], made["on"] = 3, True
    return made


def watch(cpu_s: float, wall_s: float) -> Stopwatch:
    made = Stopwatch()
    made.cpu_s, made.wall_s = cpu_s, wall_s
    return made


@pytest.fixture
def stand_ins(monkeypatch: pytest.MonkeyPatch) -> dict[str, EventBatch]:
    """Neither renders nor detects; what is returned are the reference's events, which may be others."""
    events = {rule: batch((40, 1), (90, 2), (140, 3)) for rule in RULES} | {"frame": batch((40, 1), (90, 2))}

    def load(world: Any, options: Any, device: Any, cache: Any, on_frame: Any) -> Reference:
        for _ in range(options.frames):
            on_frame()
        seen = {rule: each[options.seed == tradeoff.CEILING_SEED :] for rule, each in events.items()}
        levels = Levels(np.linspace(0, 1, 4, dtype=np.float32)[:, None, None] + np.zeros((4, 12, 16)), np.arange(4))
        return Reference(seen, levels, 1.5, 2.5)

    def run(world: Any, options: Any, config: Any, device: Any, on_frame: Any) -> tradeoff_measure.Run:
        for _ in range(options.frames):
            on_frame()
        found = batch((40, 1), (90, 2), (145, 3), (10, 9))
        return tradeoff_measure.Run(found, 0.25, 7, 5, watch(1.0, 10.0), watch(0.5, 20.0), 99)

    class Loading(contextlib.nullcontext[None]):
        cpu_s, wall_s = 0.25, 0.75

    monkeypatch.setattr(tradeoff, "Stopwatch", Loading)
    monkeypatch.setattr(tradeoff, "load_or_render", load)
    monkeypatch.setattr(tradeoff, "warm_renderer", lambda *_: None)
    monkeypatch.setattr(tradeoff, "start_up", lambda *_: (watch(3.0, 30.0), watch(4.0, 40.0)))
    monkeypatch.setattr(tradeoff, "run_point", run)
    return events


def test_figures_of_a_sweep_by_hand(tmp_path: Path, stand_ins: dict[str, EventBatch]) -> None:
    """Three of four events have partners, of which one is 5 ms late; of frames' events there are two, both met."""
    told: list[tuple[str, float, float]] = []
    results = run_tradeoff(options(tmp_path), lambda *each: told.append(each))
    exact, _, frame = results["points"]
    assert (exact["true_events"], exact["events"], exact["reference_events"]) == (3, 4, 3)
    assert (frame["true_events"], frame["events"], frame["reference_events"]) == (2, 4, 2)
    assert exact["f1_within_1ms"] == pytest.approx(2 * 2 / (4 + 3))
    costs = {
        "paths": 7, "first_hit_rays_traced": 5, "solved_share": 0.25, "peak_bytes": 99,
        "render_cpu_s": 1.0, "render_wall_s": 10.0, "detect_cpu_s": 0.5, "detect_wall_s": 20.0,
        "cpu_s": 1.5, "wall_s": 30.0, "startup_cpu_s": 7.25, "startup_wall_s": 70.75,
    }  # fmt: skip
    for point in results["points"]:
        assert {name: point[name] for name in costs} == costs
        assert point["cpu_us_per_pixel_second"] == pytest.approx(1e6 * 1.5 / (16 * 12 * 4 / 20))
    scale = results["mismatch_scale"]
    expected = np.interp(exact["f1_within_1ms"], scale["f1_within_1ms"][::-1], scale["spread"][::-1])
    beyond = exact["f1_within_1ms"] < scale["f1_within_1ms"][-1]
    assert exact["equivalent_mismatch"] == (None if beyond else pytest.approx(expected))
    assert frame["equivalent_mismatch"] is None, "stamps of frames have no mismatch to be compared with"
    kept = {"spp": 16, "fps": 20.0, "converged": False, "f1_within_1ms_moved": None, "budget_s": 0.0, "spent_s": 3.0}
    kept |= {"cpu_s": 1.5, "wall_s": 2.5, "events": {rule: len(each) for rule, each in stand_ins.items()}}
    assert {name: results["reference"][name] for name in kept} == kept
    assert {rule: each["strict_recall"] for rule, each in results["ceiling"].items()} == pytest.approx(
        {rule: 1 / 2 if rule == "frame" else 2 / 3 for rule in RULES}
    )
    about = {"scene": "two-boxes", "width": 16, "height": 12, "frames": 4, "fps": 20.0, "tau": 5e-4}
    assert {name: results[name] for name in about} == about
    work = 16 * 12 * 4 * (2 * 16 + 2 * (2 + 4) + (4 + 4))
    assert told[-1] == (POINTS[2].label, work, work), "the work told is not the work done"
    assert "ceiling, 16 spp, 20 fps" in [what for what, *_ in told]
    assert run_tradeoff(options(tmp_path), ignore)["points"] == results["points"]


def test_where_nothing_happens_there_is_nothing_to_score(tmp_path: Path, stand_ins: dict[str, EventBatch]) -> None:
    stand_ins["frame"] = batch()
    with pytest.raises(InputError, match="no event fires in 4 frames of two-boxes"):
        run_tradeoff(options(tmp_path), ignore)


@pytest.mark.slow
def test_all_figures_are_there(results: dict[str, Any]) -> None:
    scores = set(Score.__dataclass_fields__) - {"within"} | {"f1_within_1ms"}
    assert len(results["points"]) == len(POINTS) == len(results["settings"])
    for point, wanted in zip(results["points"], POINTS, strict=True):
        assert set(point) == set(wanted.as_dict()) | scores | COSTS
        assert point["paths"] == 16 * 12 * 4 * wanted.rendering.spp
        assert point["first_hit_rays_traced"] == 0
        assert (point["peak_bytes"] or 0) > 1 << 20 or peak_memory_bytes() is None  # where the system tells
        assert point["events"] > 0 and point["detect_cpu_s"] > 0 and point["render_cpu_s"] > 0
    assert 0 < results["points"][1]["solved_share"] <= 1
    for rule in ("frame", "interpolated"):
        ceiling = results["ceiling"][rule]
        assert set(ceiling) == scores
        assert 0 < ceiling["strict_f1"] < 1, "the ceiling is the reference itself"
        assert ceiling["reference_events"] == results["reference"]["events"][rule]
    assert json.loads(json.dumps(results)) == results


@pytest.mark.slow
def test_the_reference_keeps_the_brightness_that_its_events_come_from(tmp_path: Path) -> None:
    world, render = load_world("two-boxes", resolution=(16, 12)), RenderOptions(spp=16, frames=6, fps=20.0)
    rendered, kept = (load_or_render(world, render, choose_device(), tmp_path, lambda: None) for _ in range(2))
    for reference in (rendered, kept):
        thresholds = np.full((2, 12, 16), world.sensor.threshold_on)
        events, expected = fire(reference.levels, thresholds), reference.events["interpolated"]
        assert len(events) == len(expected) > 50
        # Levels are rounded to float32, so that stamps may be off by a little.
        order, expected_order = (np.lexsort((each["t"], each["x"], each["y"])) for each in (events, expected))
        events, expected = events[order], expected[expected_order]
        assert np.array_equal(events["x"], expected["x"]) and np.abs(events["t"] - expected["t"]).max() <= 3


@pytest.mark.slow
def test_starting_is_told_apart_and_happens_before_anything_is_timed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Kernels are loaded once for all points that need them: three detectors and one renderer here."""
    order: list[str] = []
    run, start = tradeoff.run_point, tradeoff.start_up

    def measure(*given: Any) -> Any:
        order.append("run")
        return run(*given)

    def note(*given: Any) -> Any:
        order.append("start")
        found = start(*given)
        for watch, cpu_s in zip(found, (1000.0 * len(order), 100.0 * len(order)), strict=True):
            watch.cpu_s = cpu_s
        return found

    class Loading(contextlib.nullcontext[None]):
        cpu_s, wall_s = 7000.0, 0.0

    monkeypatch.setattr(tradeoff, "Stopwatch", Loading)  # of the scene, which each needs
    monkeypatch.setattr(tradeoff, "run_point", measure)
    monkeypatch.setattr(tradeoff, "start_up", note)
    results = run_tradeoff(options(tmp_path, points=(*POINTS, Point(FRESH, ESIM))), ignore)
    assert order == ["start", "run", "start", "run", "start", "run", "run"]
    told = [point["startup_cpu_s"] for point in results["points"]]
    assert [round(each, -2) for each in told] == [8100, 8300, 8500, 8100], "the renderer's kernel is loaded but once"
    assert results["points"][0]["cpu_s"] < 100
    head, _, line, *_ = [line for line in markdown_text(results).splitlines() if line.startswith("|")]
    place = [cell.strip() for cell in head.split("|")].index("to start")
    assert 8000 < float(line.split("|")[place]) < 8500


@pytest.mark.slow
def test_a_point_is_what_a_live_run_gives(results: dict[str, Any]) -> None:
    import clsim

    batches = clsim.stream("two-boxes", method="esim-ad", spp=2, resolution=(16, 12), duration_s=0.15, fps=20.0)
    assert results["points"][1]["events"] == sum(len(batch) for batch in batches)


@pytest.mark.slow
def test_a_sweep_has_the_scenes_threshold_of_off_events(tmp_path: Path) -> None:
    """It is told, and fewer events fall to a larger one: in the reference, the ceiling and all points."""
    found = []
    for off in (0.2, 0.5):
        scene = tmp_path / f"{off}.toml"
        scene.write_text(scene_text({"base": "two-boxes", "sensor": {"threshold_off": off}}))
        found.append(run_tradeoff(replace(options(tmp_path, points=POINTS[:1]), scene=scene), ignore))
    assert [(each["threshold_on"], each["threshold_off"]) for each in found] == [(0.2, 0.2), (0.2, 0.5)]
    for one, other in (
        [each["reference"]["events"]["interpolated"] for each in found],
        [each["ceiling"]["interpolated"]["events"] for each in found],
        [each["points"][0]["events"] for each in found],
    ):
        assert one > 1.2 * other > 0


@pytest.mark.slow
def test_a_second_run_measures_what_is_missing_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rendered: list[int] = []
    measured: list[Any] = []
    each, run = tradeoff_measure.render_each, tradeoff_measure.run_point

    def count_references(world: Any, options: Any, take: Any) -> Any:
        rendered.append(options.spp)
        return each(world, options, take)

    def count_runs(world: Any, options: Any, config: Any, *given: Any) -> Any:
        if len(measured) == 2:
            raise KeyboardInterrupt
        measured.append((options.spp, config.gate))
        return run(world, options, config, *given)

    monkeypatch.setattr("clsim.bench.tradeoff.reference_cache.render_each", count_references)
    monkeypatch.setattr(tradeoff, "run_point", count_runs)
    with pytest.raises(KeyboardInterrupt):
        run_tradeoff(options(tmp_path), ignore)
    assert rendered == [16, 16] and len(measured) == 2
    rendered.clear()
    measured.clear()
    told: list[tuple[float, float]] = []
    results = run_tradeoff(options(tmp_path), lambda what, done, total: told.append((done, total)))
    assert rendered == [] and measured == [(4, "delta-r")]
    assert told[-1][0] == told[-1][1] == 16 * 12 * 4 * (4 + 4), "the work told is not the work done"
    assert len(results["points"]) == 3
    measured.clear()
    assert run_tradeoff(options(tmp_path), ignore) == results
    assert rendered == measured == []
    run_tradeoff(options(tmp_path, points=POINTS[:1], reference_spp=8), ignore)
    assert rendered == [8, 8] and len(measured) == 1, "points scored against another reference were taken for these"


@pytest.mark.slow
def test_samplers_and_sampling_are_axes(tmp_path: Path) -> None:
    renderings = [
        Rendering(4, "common", 0),
        Rendering(4, "common", 0, "sobol"),
    ]
    wanted = [*(Point(each, BASE) for each in renderings), named_points(0)["balanced"]]
    results = run_tradeoff(options(tmp_path, points=wanted), ignore)
    plain, even, cached = results["points"]
    assert (plain["sampler"], even["sampler"], cached["sampling"]) == ("pcg", "sobol", "cached")
    assert even["f1"] != plain["f1"], "the sampler did not reach the tracer"
    pixels = 16 * 12 * 4
    assert pixels < cached["paths"] < pixels * 8 and 0 < cached["first_hit_rays_traced"] <= pixels * 512
    assert {row["label"] for row in results["settings"]} == {
        "4 spp common, radiance K13", "4 spp common sobol, radiance K13",
        "1 to 8 spp each 16 frames common sobol cached + 32 first hits, esim rule linear-light",
    }  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("quality", ["draft", "balanced"])
def test_a_named_point_is_what_a_live_run_gives(tmp_path: Path, quality: str) -> None:
    """Also in later passes, which are timed: what they render must be the same."""
    import clsim

    live = clsim.stream("two-boxes", quality=quality, resolution=(16, 12), duration_s=0.15, fps=20.0)
    results = run_tradeoff(options(tmp_path, points=[named_points(0)[quality]]), ignore)
    assert results["points"][0]["events"] == sum(len(batch) for batch in live) > 0


@pytest.mark.slow
def test_pixels_that_take_turns_are_a_setting_of_their_own(tmp_path: Path) -> None:
    """Uniform, where no map is asked for, and adaptive, where pixels near an event do not wait."""
    given = {"sampler": "sobol", "first_hit_rays": 4}
    renderings = [
        Rendering(2, "common", 0, **given),
        Rendering(2, "common", 0, **given, probe_every=2),
        Rendering(2, "common", 0, sampling="adaptive", probe_spp=2, **given, probe_every=2),
    ]
    results = run_tradeoff(options(tmp_path, points=[Point(each, IRRADIANCE) for each in renderings], frames=5), ignore)
    every, turns, near = (point["paths"] / (2 * 16 * 12) for point in results["points"])
    # Of each pixel that shows a surface all five frames, or of one in two all but the first; a few come into view.
    assert 3 < every < 5 and turns == pytest.approx(3 / 5 * every, rel=0.03) and turns < near < every
    assert [point["probe_every"] for point in results["points"]] == [1, 2, 2]
    labels = {row["label"] for row in results["settings"]}
    assert "2 spp each 2 frames common sobol + 4 first hits, irradiance K7" in labels and len(labels) == 3


@pytest.mark.slow
def test_later_passes_render_what_the_first_one_did(monkeypatch: pytest.MonkeyPatch) -> None:
    passes: list[Any] = []
    turn = tradeoff_measure._pass

    def keep(*given: Any) -> Any:
        passes.append(turn(*given))
        return passes[-1]

    monkeypatch.setattr(tradeoff_measure, "_pass", keep)
    world, point = load_world("two-boxes", resolution=(16, 12)), named_points(0)["balanced"]
    given = RenderOptions(spp=8, probe_spp=1, first_hit_rays=16, sampler="sobol", frames=6, fps=20.0)
    tradeoff_measure.run_point(world, given, point.detector.config(world.sensor), choose_device(), lambda: None)
    assert len(passes) > 1
    for each in passes:
        assert np.array_equal(each.events, passes[0].events) and each.paths == passes[0].paths


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fps": 0.0}, "`fps` must be a positive number"),
        ({"frames": 1}, "`frames` must be at least 2"),
        ({"reference_spp": 0}, "`reference_spp` must be at least 1"),
        ({"reference_budget_s": -1.0}, "`reference_budget` must not be negative"),
        ({"seeds": (1, 1)}, "`seeds` must be different"),
        ({"seeds": ()}, "got none"),
        ({"seeds": (tradeoff.CEILING_SEED,)}, "`seeds` must be different"),
        ({"seeds": (0, 1), "quick": True}, "`quick` measures one seed"),
    ],
)
def test_wrong_options_are_refused(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        options(tmp_path, **changes)


@pytest.mark.slow
def test_the_reference_is_made_finer_until_it_has_converged_and_that_is_told(tmp_path: Path) -> None:
    quick, fine = (
        run_tradeoff(options(tmp_path, points=POINTS[:1], reference_budget_s=budget_s), ignore)
        for budget_s in (0.0, 3.0)
    )
    coarse, finer = quick["reference"], fine["reference"]
    assert (coarse["spp"], coarse["fps"], coarse["converged"]) == (16, 20.0, False)
    assert finer["spp"] / coarse["spp"] == finer["fps"] / coarse["fps"] >= 2
    assert finer["budget_s"] == 3.0 and finer["converged"] == (finer["f1_within_1ms_moved"] < 0.02)
    assert "left no time" in markdown_text(quick) and f"at {finer['fps']:g} fps" in markdown_text(fine)
    assert quick["points"][0]["events"] == fine["points"][0]["events"], "a point's own frame rate is not touched"
    assert quick["points"][0]["f1_within_1ms"] != fine["points"][0]["f1_within_1ms"]


@pytest.mark.parametrize(("quick", "seeds"), [(True, (7,)), (False, (3, 9))])
def test_a_sweep_is_of_the_seeds_that_are_asked_for(tmp_path: Path, quick: bool, seeds: tuple[int, ...]) -> None:
    sweep = tradeoff.Sweep(TradeoffOptions("two-boxes", tmp_path, quick=quick, seeds=seeds), ignore)
    assert len(sweep.points) >= 12 and {point.rendering.seed for point in sweep.points} == set(seeds)
    assert (sweep.budget_s > 0) is not quick, "a quick one takes the coarsest reference"
    camera, spp = sweep.world.camera, sweep.reference_options.spp
    assert (camera.width, camera.height, spp) == ((64, 48, 1024) if quick else (128, 96, 4096))
    assert tradeoff.Sweep(options(tmp_path), ignore).budget_s == 0, "as is asked for"


def test_points_of_another_machine_are_measured_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = tradeoff.Sweep(options(tmp_path), ignore).store.path
    assert tradeoff.Sweep(options(tmp_path), ignore).store.path == here
    monkeypatch.setattr(tradeoff, "_processor", lambda: "a better one")
    assert tradeoff.Sweep(options(tmp_path), ignore).store.path != here


@pytest.mark.parametrize("fps", [None, 20.0])
def test_a_sweep_has_the_frame_rate_that_is_asked_for_or_else_the_scenes(tmp_path: Path, fps: float | None) -> None:
    sweep = tradeoff.Sweep(TradeoffOptions("two-boxes", tmp_path, quick=True, fps=fps), ignore)
    wanted = fps or load_world("two-boxes").fps
    assert wanted != 20.0 or fps
    assert sweep.fps == sweep.reference_options.fps == wanted
