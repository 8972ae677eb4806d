"""The sweep from end to end, on a tiny scene."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from clsim.bench import tradeoff, tradeoff_measure
from clsim.bench.tradeoff import TradeoffOptions, run_tradeoff
from clsim.bench.tradeoff_settings import BASE, ESIM, ICIP_2023, IRRADIANCE, Point, Rendering, named_points
from clsim.bench.tradeoff_tables import markdown_text
from clsim.errors import InputError
from clsim.opencl.device import choose_device
from clsim.render import RenderOptions
from clsim.scene import load_world
from clsim.score import Score

COMMON, FRESH = Rendering(2, "common", 0), Rendering(4, "independent", 0)
POINTS = (Point(COMMON, ESIM), Point(COMMON, BASE), Point(FRESH, ICIP_2023))
COSTS = {
    "paths", "first_hit_rays_traced", "solved_share", "render_cpu_s", "render_wall_s", "detect_cpu_s",
    "detect_wall_s", "cpu_s", "wall_s", "true_events", "cpu_s_per_true_event", "render_peak_bytes", "detect_peak_bytes",
    "startup_cpu_s", "startup_wall_s",
}  # fmt: skip


def options(cache: Path, **changes: Any) -> TradeoffOptions:
    given = {"points": POINTS, "reference_spp": 16, "resolution": (16, 12), "frames": 4, "fps": 20.0} | changes
    return TradeoffOptions("two-boxes", cache, **given)


def ignore(what: str, done: float, total: float) -> None:
    """Tell nobody."""


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return run_tradeoff(options(tmp_path_factory.mktemp("cache")), ignore)


def test_all_figures_are_there(results: dict[str, Any]) -> None:
    scores = set(Score.__dataclass_fields__) - {"within"} | {"f1_within_1ms"}
    assert len(results["points"]) == len(POINTS) == len(results["settings"])
    for point, wanted in zip(results["points"], POINTS, strict=True):
        assert set(point) == set(wanted.as_dict()) | scores | COSTS
        assert point["paths"] == 16 * 12 * 4 * wanted.rendering.spp
        assert point["first_hit_rays_traced"] == 0
        assert point["events"] > 0 and point["detect_cpu_s"] > 0 and point["render_cpu_s"] > 0
        assert point["cpu_s"] == point["render_cpu_s"] + point["detect_cpu_s"]
        assert point["reference_events"] == results["reference"]["events"][point["event_rule"]]
    assert results["points"][0]["render_cpu_s"] == results["points"][1]["render_cpu_s"], "rendered twice"
    assert 0 < results["points"][1]["solved_share"] <= 1
    for rule in ("frame", "interpolated"):
        ceiling = results["ceiling"][rule]
        assert set(ceiling) == scores
        assert 0 < ceiling["strict_f1"] < 1, "the ceiling is the reference itself"
    assert json.loads(json.dumps(results)) == results


def test_starting_is_told_apart_and_happens_before_anything_is_timed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Kernels are loaded once for all points that need them: three detectors and one renderer here."""
    order: list[str] = []
    sequence, start = tradeoff.render_sequence, tradeoff.start_up

    def render(*given: Any) -> Any:
        order.append("render")
        return sequence(*given)

    def note(*given: Any) -> Any:
        order.append("start")
        found = start(*given)
        for watch, cpu_s in zip(found, (1000.0 * len(order), 100.0 * len(order)), strict=True):
            watch.cpu_s = cpu_s
        return found

    monkeypatch.setattr(tradeoff, "render_sequence", render)
    monkeypatch.setattr(tradeoff, "start_up", note)
    results = run_tradeoff(options(tmp_path, points=(*POINTS, Point(FRESH, ESIM))), ignore)
    assert order == ["start", "start", "render", "start", "render"]
    told = [point["startup_cpu_s"] for point in results["points"]]
    assert [round(each, -2) for each in told] == [1100, 1200, 1400, 1100], "the renderer's kernel is loaded but once"
    assert results["points"][0]["cpu_s"] < 100
    head, _, line, *_ = [line for line in markdown_text(results).splitlines() if line.startswith("|")]
    place = [cell.strip() for cell in head.split("|")].index("to start")
    assert 1000 < float(line.split("|")[place]) < 1500


def test_a_point_is_what_a_live_run_gives(results: dict[str, Any]) -> None:
    import clsim

    batches = clsim.stream("two-boxes", spp=2, resolution=(16, 12), duration_s=0.15, fps=20.0)
    assert results["points"][1]["events"] == sum(len(batch) for batch in batches)


def test_a_second_run_measures_what_is_missing_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rendered: list[int] = []
    detected: list[str] = []
    sequence, each, detect = tradeoff_measure.render_sequence, tradeoff_measure.render_each, tradeoff_measure.detect

    def counting(render: Any) -> Any:
        def count_render(world: Any, options: Any, told: Any) -> Any:
            rendered.append(options.spp)
            return render(world, options, told)

        return count_render

    def count_detect(config: Any, frames: Any, device: Any) -> Any:
        if len(detected) == 2:
            raise KeyboardInterrupt
        detected.append(config.gate)
        return detect(config, frames, device)

    monkeypatch.setattr(tradeoff, "render_sequence", counting(sequence))
    monkeypatch.setattr("clsim.bench.reference_cache.render_each", counting(each))
    monkeypatch.setattr(tradeoff, "detect", count_detect)
    with pytest.raises(KeyboardInterrupt):
        run_tradeoff(options(tmp_path), ignore)
    assert rendered == [16, 16, 2, 4] and len(detected) == 2
    rendered.clear()
    detected.clear()
    told: list[tuple[float, float]] = []
    results = run_tradeoff(options(tmp_path), lambda what, done, total: told.append((done, total)))
    assert rendered == [4] and detected == ["delta-r"]
    assert told[-1][0] == told[-1][1] == 16 * 12 * 4 * (4 + 4), "the work told is not the work done"
    assert len(results["points"]) == 3
    rendered.clear()
    assert run_tradeoff(options(tmp_path), ignore) == results
    assert rendered == []
    run_tradeoff(options(tmp_path, points=POINTS[:1], reference_spp=8), ignore)
    assert rendered == [8, 8, 2], "points scored against another reference were taken for these"


def test_frames_and_detection_in_turns_are_the_same_as_one_after_the_other() -> None:
    world, device = load_world("two-boxes", resolution=(16, 12)), choose_device()
    options, config = RenderOptions(spp=2, frames=4, fps=20.0), BASE.config(world.sensor)
    frames, _ = tradeoff_measure.render_sequence(world, options, lambda: None)
    after = tradeoff_measure.detect(config, frames, device)
    seen: list[int] = []
    run = tradeoff_measure.run_in_turns(world, options, config, device, lambda: seen.append(1))
    assert len(after.events) > 0 and np.array_equal(run.detected.events, after.events)
    assert run.detected.solved_share == after.solved_share
    assert run.rendered.paths == 16 * 12 * 4 * 2 and len(seen) == 4
    assert run.rendered.cost.cpu_s > 0 and run.detected.cost.cpu_s > 0


def test_samplers_and_sampling_are_axes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    in_turns: list[str] = []

    def run_in_turns(*given: Any) -> Any:
        in_turns.append(given[2].method)
        return tradeoff_measure.run_in_turns(*given)

    monkeypatch.setattr(tradeoff, "run_in_turns", run_in_turns)
    renderings = [
        Rendering(4, "common", 0),
        Rendering(4, "common", 0, "sobol"),
    ]
    wanted = [*(Point(each, BASE) for each in renderings), named_points(0)["balanced"]]
    results = run_tradeoff(options(tmp_path, points=wanted), ignore)
    assert in_turns == ["irradiance"]
    plain, even, adaptive = results["points"]
    assert (plain["sampler"], even["sampler"], adaptive["sampling"]) == ("pcg", "sobol", "adaptive")
    assert even["f1"] != plain["f1"], "the sampler did not reach the tracer"
    pixels = 16 * 12 * 4
    assert pixels < adaptive["paths"] < pixels * 8 and 0 < adaptive["first_hit_rays_traced"] <= pixels * 16
    assert {row["label"] for row in results["settings"]} == {
        "4 spp common, radiance K13", "4 spp common sobol, radiance K13",
        "1 to 8 spp common sobol + 16 first hits, irradiance K7",
    }  # fmt: skip


@pytest.mark.parametrize("quality", ["draft", "balanced"])
def test_a_named_point_is_what_a_live_run_gives(tmp_path: Path, quality: str) -> None:
    """Also in later passes, which are timed: what they render must be the same."""
    import clsim

    live = clsim.stream("two-boxes", quality=quality, resolution=(16, 12), duration_s=0.15, fps=20.0)
    results = run_tradeoff(options(tmp_path, points=[named_points(0)[quality]]), ignore)
    assert results["points"][0]["events"] == sum(len(batch) for batch in live) > 0


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
    assert (every, turns) == (5, 3) and turns < near < every
    assert [point["probe_every"] for point in results["points"]] == [1, 2, 2]
    labels = {row["label"] for row in results["settings"]}
    assert "2 spp each 2 frames common sobol + 4 first hits, irradiance K7" in labels and len(labels) == 3


def test_later_passes_render_what_the_first_one_did(monkeypatch: pytest.MonkeyPatch) -> None:
    passes: list[Any] = []
    turns = tradeoff_measure._turns

    def keep(*given: Any) -> Any:
        passes.append(turns(*given))
        return passes[-1]

    monkeypatch.setattr(tradeoff_measure, "_turns", keep)
    world, point = load_world("moving-light", resolution=(16, 12)), named_points(0)["balanced"]
    given = RenderOptions(spp=8, probe_spp=1, first_hit_rays=16, sampler="sobol", frames=6, fps=20.0)
    tradeoff_measure.run_in_turns(world, given, point.detector.config(world.sensor), choose_device(), lambda: None)
    assert len(passes) > 1
    for each in passes:
        assert np.array_equal(each.events, passes[0].events) and each.paths == passes[0].paths


def test_a_still_scene_has_nothing_to_score(tmp_path: Path) -> None:
    wanted = TradeoffOptions("still", tmp_path, points=POINTS[:1], reference_spp=1, resolution=(16, 12), frames=2)
    with pytest.raises(InputError, match="no event fires in 2 frames of still"):
        run_tradeoff(wanted, ignore)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fps": 0.0}, "`fps` must be a positive number"),
        ({"frames": 1}, "`frames` must be at least 2"),
        ({"reference_spp": 0}, "`reference_spp` must be at least 1"),
        ({"seeds": (1, 1)}, "`seeds` must be different"),
        ({"seeds": ()}, "got none"),
        ({"seeds": (tradeoff.CEILING_SEED,)}, "`seeds` must be different"),
        ({"seeds": (0, 1), "quick": True}, "`quick` measures one seed"),
    ],
)
def test_wrong_options_are_refused(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        options(tmp_path, **changes)
