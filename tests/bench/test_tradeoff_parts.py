"""The parts of the sweep: fronts, keys, stored points, labels, what is swept."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clsim.bench.tradeoff import measure, mismatch, reference_cache
from clsim.bench.tradeoff.content_key import content_key, world_key
from clsim.bench.tradeoff.pareto import pareto_front
from clsim.bench.tradeoff.point_store import PointStore
from clsim.bench.tradeoff.reference_cache import reference_key
from clsim.bench.tradeoff.settings import (
    BASE,
    ICIP_2023,
    QUICK_POINTS,
    Point,
    Rendering,
    full_points,
    named_points,
    quick_points,
)
from clsim.bench.tradeoff.stopwatch import Stopwatch, peak_memory_bytes, reset_peak_memory
from clsim.bench.tradeoff.summary import summarise, turned_knobs
from clsim.bench.tradeoff.sweep import figures
from clsim.detect.config import DetectorConfig
from clsim.events import EVENT_DTYPE, empty_batch
from clsim.opencl.device import choose_device
from clsim.render import RenderOptions
from clsim.scene import Sensor, load_world
from clsim.score import score

_few = st.integers(0, 5).map(float)


def test_a_stopwatch_adds_up_what_is_spent_between_its_start_and_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    wall, cpu = iter([0.0, 2.0, 10.0, 11.0]), iter([5.0, 5.5, 6.0, 6.25])
    clock = SimpleNamespace(perf_counter=lambda: next(wall), process_time=lambda: next(cpu))
    monkeypatch.setattr("clsim.bench.tradeoff.stopwatch.time", clock)
    watch = Stopwatch()
    for _ in range(2):
        with watch:
            pass
    assert (watch.wall_s, watch.cpu_s) == (3.0, 0.75)


@given(st.lists(st.tuples(_few, _few), max_size=12))
def test_the_front_is_what_nothing_dominates(points: list[tuple[float, float]]) -> None:
    def dominated(i: int) -> bool:
        cost, value = points[i]
        return any(c <= cost and v >= value and (c, v) != (cost, value) for c, v in points)

    front = pareto_front([cost for cost, _ in points], [value for _, value in points])
    assert sorted(front) == [i for i in range(len(points)) if not dominated(i)]
    assert [points[i][0] for i in front] == sorted(points[i][0] for i in front)


def test_a_reference_has_another_key_when_anything_that_went_in_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    world, options = load_world("two-boxes", resolution=(16, 12)), RenderOptions(spp=4, frames=4)
    camera, material = world.camera, world.materials[0]
    red = (dataclasses.replace(material, color=(0.9, 0.1, 0.1)), *world.materials[1:])
    moved = dataclasses.replace(camera, motion=load_world("moving-light").camera.motion)
    mesh = dataclasses.replace(world.meshes[0], vertices=world.meshes[0].vertices + np.float32(1e-4))
    variants = [
        (load_world("moving-light", resolution=(16, 12)), options),
        (load_world("two-boxes", resolution=(16, 11)), options),
        (dataclasses.replace(world, materials=red), options),
        (dataclasses.replace(world, camera=moved), options),
        (dataclasses.replace(world, meshes=(mesh, *world.meshes[1:])), options),
        (dataclasses.replace(world, sensor=dataclasses.replace(world.sensor, threshold_on=0.21)), options),
        *((world, dataclasses.replace(options, **{name: value})) for name, value in _OTHER_OPTIONS.items()),
    ]
    keys = [reference_key(world, options), *(reference_key(*variant) for variant in variants)]
    monkeypatch.setattr("clsim.__version__", "999")
    _forget_code()
    keys.append(reference_key(world, options))
    monkeypatch.undo()
    _forget_code()
    assert len(set(keys)) == len(keys)
    again = load_world("two-boxes", resolution=(16, 12))
    again = dataclasses.replace(again, name="a copy", notes=("of it",), warnings=("it lacks",))
    assert reference_key(again, options) == reference_key(world, options)


@pytest.mark.parametrize(
    "name",
    [
        "render/view.py",
        "render/native/search/tree_any.h",
        "kernels/detect/wlr.cl",
        "kernels/sensor/shot.clh",
        "detect/gate.py",
    ],
)
def test_the_key_of_code_is_of_all_sources_however_deep(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from clsim.bench.tradeoff.content_key import FRAME_ROOMS, code_key

    monkeypatch.setattr("clsim.bench.tradeoff.content_key.files", lambda package: tmp_path / package)
    for room in FRAME_ROOMS:
        (tmp_path / f"clsim.{room}").mkdir()
    source = tmp_path / f"clsim.{name}"
    source.parent.mkdir(parents=True, exist_ok=True)
    keys = set()
    for text in ("1", "2", "1"):
        source.write_text(text)
        _forget_code()
        keys.add(code_key(FRAME_ROOMS))
    _forget_code()
    assert len(keys) == 2


_OTHER_OPTIONS = {"spp": 5, "frames": 5, "fps": 60.0, "seed": 1, "noise": "independent", "max_depth": 3}


def _forget_code() -> None:
    from clsim.bench.tradeoff.content_key import code_key

    code_key.cache_clear()


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (("ab", "c"), ("a", "bc")),
        ((1, (2, 3)), (1, 2, (3,))),
        (((1,), 2), ((1, 2),)),
        (1, 1.0),
        (1.0, 1.0 + 1e-12),
        (np.zeros(2), np.zeros((2, 1))),
        (np.zeros(2, np.float32), np.zeros(2, np.int32)),
        (None, "None"),
        ({"a": None}, {}),
    ],
)
def test_different_contents_have_different_keys(one: object, other: object) -> None:
    assert content_key(one) != content_key(other)


def test_what_an_object_remembers_is_no_content() -> None:
    def key(**content: object) -> str:
        return content_key(SimpleNamespace(**content))

    assert key(a=1, _cache=2) == key(a=1, _cache=3) != key(a=2, _cache=2)


def test_what_cannot_be_seen_is_refused() -> None:
    with pytest.raises(TypeError, match="object"):
        content_key(object())


def test_every_bundled_motion_has_a_key() -> None:
    keys = {world_key(load_world(name)) for name in ("two-boxes", "moving-light", "cornell", "still")}
    assert len(keys) == 4


def test_whole_lines_survive_a_cut(tmp_path: Path) -> None:
    path = tmp_path / "cache" / "points.jsonl"
    store = PointStore(path)
    store.append("a", {"f1": 0.5})
    store.append("b", {"f1": 0.25})
    path.write_text(path.read_text()[:-8])
    store = PointStore(path)
    assert "a" in store and "b" not in store and store["a"] == {"f1": 0.5}
    store.append("c", {"f1": 0.75})
    store = PointStore(path)
    assert store["c"] == {"f1": 0.75} and "a" in store and "b" not in store
    assert json.loads(path.read_text().splitlines()[-1])["key"] == "c"


def test_the_sweeps_have_each_point_once() -> None:
    quick, full = quick_points(7), full_points((0, 1))
    assert len(set(quick)) == len(quick) <= QUICK_POINTS
    assert len(set(full)) == len(full) and {point.rendering.seed for point in full} == {0, 1}
    labels = {point.label for point in full}
    assert len(labels) == len(full) / 2, "two settings have one name"
    label = named_points(0)["balanced"].label
    assert label == "1 to 8 spp each 16 frames common sobol cached + 32 first hits, esim rule linear-light"
    rules = {dataclasses.replace(BASE, event_rule=rule).label for rule in ("frame", "interpolated", "linear-light")}
    assert len(rules) == 3
    sensor = load_world("two-boxes").sensor
    for point in {*quick, *full}:
        assert point.detector.config(sensor).threshold_on == sensor.threshold_on


def test_named_points_are_those_of_live_runs() -> None:
    from clsim.live.quality import QUALITIES

    named = named_points(3)
    assert set(named) == set(QUALITIES) and set(named.values()) <= set(full_points((3,)))
    for name, quality in QUALITIES.items():
        rendering, detector = named[name].rendering, named[name].detector
        assert (rendering.noise, rendering.sampling) == (quality.noise, quality.sampling)
        for field in ("spp", "sampler", "first_hit_rays", "probe_every", "stored_paths", "lamp_paths", "follow_every"):
            assert getattr(rendering, field) == getattr(quality, field)
        assert rendering.probe_spp == (quality.probe_spp if quality.sampling != "uniform" else None)
        assert (detector.method, detector.window) == (quality.method, quality.window)
        assert (detector.gate or "radiance", detector.event_rule) == (quality.gate, quality.event_rule)


def test_a_bench_runs_what_a_live_run_would() -> None:
    from clsim.live.options import LiveOptions
    from clsim.live.stages import plan_stages

    for world in map(load_world, ("cornell", "two-boxes", "moving-light")):
        for name in ("draft", "balanced", "accurate"):
            live = plan_stages(LiveOptions("", quality=name), world)
            point = named_points(0)[name]
            bench = point.options(live.fps, 2, world.sensor)
            told = "spp", "probe_spp", "probe_every", "first_hit_rays", "light_cache", "fires_at", "sampler", "noise"
            for field in (*told, "stored_paths", "lamp_paths", "follow_every", "first_frame_error"):
                assert getattr(bench, field) == getattr(live.render, field), (name, field)
            assert point.detector.config(world.sensor) == live.detector


def test_means_fronts_and_knobs() -> None:
    quick = quick_points(0)
    costs = {8: 1.0, 2: 0.5, 32: 4.0}
    quick.append(Point(Rendering(2, "common", 0), BASE))

    def figures(spp: int, f1: float) -> dict[str, float | None]:
        return {"cpu_s": costs[spp], "detect_cpu_s": 0.1, "f1": f1, "strict_f1": f1 / 2, "dt_median_us": None}

    base = [point for point in quick if point.detector == BASE and point.rendering.noise == "common"]
    f1 = {2: 0.5, 8: 0.8, 32: 0.7}
    points = [
        point.as_dict() | {"seed": seed} | figures(point.rendering.spp, f1[point.rendering.spp] + spread)
        for seed, spread in ((0, -0.01), (1, 0.01))
        for point in base
    ]
    rows = summarise(points)
    assert [row["spp"] for row in rows] == [2, 8, 32]
    assert [row["front_f1"] for row in rows] == [True, True, False]
    assert rows[1]["f1"] == pytest.approx(0.8) and rows[1]["f1_sd"] == pytest.approx(0.02 / 2**0.5)
    assert rows[1]["seeds"] == [0, 1] and rows[1]["dt_median_us"] is None
    assert [(knob, at["spp"], other["spp"]) for knob, at, other in turned_knobs(rows)] == [
        ("spp", 8, 2),
        ("spp", 8, 32),
    ]


def test_quick_turns_single_knobs() -> None:
    looking = Point(Rendering(8, "common", 0, first_hit_rays=4), BASE)
    of_paper = Point(Rendering(8, "common", 0), ICIP_2023)
    rows = summarise(
        [
            point.as_dict() | {"cpu_s": 1.0, "detect_cpu_s": 1.0, "f1": 0.5, "strict_f1": 0.5}
            for point in (*quick_points(0), looking, of_paper)
        ]
    )
    knobs = [knob for knob, _, _ in turned_knobs(rows)]
    assert knobs == ["method", "method", "method", "spp", "first_hit_rays", "window"]
    assert [row["noise"] for row in rows if row["icip_2023"]] == ["independent"], "as the paper's is"
    assert ICIP_2023.event_rule == "frame" and {row["f1_sd"] for row in rows} == {None}, "one seed has no spread"


def test_the_full_sweep_turns_the_sampler() -> None:
    points = [point.as_dict() | {"cpu_s": 1.0, "f1": 0.5, "strict_f1": 0.5} for point in full_points((0,))]
    pairs = [
        (base["spp"], other["sampler"]) for knob, base, other in turned_knobs(summarise(points)) if knob == "sampler"
    ]
    assert pairs == [(8, "sobol")]


def test_the_quickest_of_the_later_passes_counts_with_the_events_of_the_first(monkeypatch):
    """The first builds kernels, so that its own times tell nothing."""
    found = []

    def one(*_):
        rendering, detecting = Stopwatch(), Stopwatch()
        rendering.cpu_s, detecting.cpu_s = ((0.001, 0.001), (0.5, 0.2), (0.1, 0.3), (0.3, 0.2), (9.0, 9.0))[len(found)]
        found.append(measure.Run(np.full(3, len(found)), 0.5, 7, 1, rendering, detecting, None))
        return found[-1]

    monkeypatch.setattr(measure, "_pass", one)
    monkeypatch.setattr(measure, "_ENOUGH_CPU_S", 1.5)
    world = load_world("two-boxes", resolution=(16, 12))
    run = measure.run_point(world, RenderOptions(), DetectorConfig(), choose_device(), lambda: None)
    assert len(found) == 4 and run.events.tolist() == [0, 0, 0]
    assert (run.rendering.cpu_s, run.detecting.cpu_s) == (0.1, 0.3)


def test_a_detector_of_the_sweep_sees_as_the_scenes_sensor_does() -> None:
    sensor = Sensor(threshold_on=0.3, threshold_off=0.4, scale=5.0, floor=0.6)
    for point in quick_points(0):
        config = point.detector.config(sensor)
        assert (config.threshold_on, config.threshold_off, config.scale, config.floor) == (0.3, 0.4, 5.0, 0.6)


def test_figures_add_up_costs_and_tell_how_many_events_are_true() -> None:
    """Three of four events have a partner, of six true ones."""
    truth = empty_batch(6)
    truth["t"], truth["x"], truth["y"], truth["on"] = np.arange(6) * 10_000, np.arange(6), 0, True
    found = truth[:4].copy()
    found["on"][3] = False
    costs = {"render_cpu_s": 2.0, "detect_cpu_s": 0.5, "render_wall_s": 3.0, "detect_wall_s": 1.0}
    told = figures(score(found, truth, 8, 4, 100.0, within_us=(1000,)), costs)
    assert (told["true_events"], told["cpu_s"], told["wall_s"]) == (3, 2.5, 4.0)
    assert told["f1_within_1ms"] == pytest.approx(2 * 3 / (4 + 6))


def test_a_kept_reference_that_is_not_whole_is_none(tmp_path: Path) -> None:
    """However it was damaged: it is rendered anew."""
    events = np.zeros(50, EVENT_DTYPE)
    levels = mismatch.Levels(np.random.default_rng(0).random((4, 6, 8), np.float32), np.arange(4))
    path = tmp_path / "reference.npz"
    reference_cache._save(
        path, reference_cache.Reference(dict.fromkeys(reference_cache.RULES, events), levels, 1.0, 2.0)
    )
    data = path.read_bytes()
    found = reference_cache._load(path)
    assert found is not None and np.array_equal(found.levels.values, levels.values) and found.wall_s == 2.0
    for place in range(0, len(data), 40):
        path.write_bytes(data[:place])
        assert reference_cache._load(path) is None
        path.write_bytes(data[:place] + bytes([data[place] ^ 0xFF]) + data[place + 1 :])
        found = reference_cache._load(path)
        assert found is None or np.array_equal(found.levels.values, levels.values)


def test_the_peak_of_memory_is_in_bytes() -> None:
    reset_peak_memory()
    before = peak_memory_bytes()
    if before is None:
        pytest.skip("the system does not tell")
    taken = np.ones(128 << 20, np.uint8)
    assert peak_memory_bytes() - before == pytest.approx(taken.nbytes, rel=0.015)  # a kB there is 1024 bytes
    del taken
    assert peak_memory_bytes() - before > 120 << 20, "which is free again by now"
