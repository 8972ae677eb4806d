"""Adaptive sampling and the governor in whole runs: a scene in, events out."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import clsim
from clsim.events.files import open_source
from clsim.live import session as live_session
from clsim.live.options import LiveOptions
from clsim.live.session import open_live
from clsim.live.stages import plan_stages
from clsim.score import score

SIZE = (48, 36)


def events_of(scene: str, **options: object) -> np.ndarray:
    settings = {"resolution": SIZE, "frame_count": 12, "fps": 60.0, "sampling": "adaptive"} | options
    return np.concatenate(list(clsim.stream(scene, **settings)))


def summary_of(scene: str, **options: object) -> dict[str, Any]:
    session = open_live(LiveOptions(scene, resolution=SIZE, **options))  # type: ignore[arg-type]
    session.start()
    assert session.pipeline.wait(120)
    return session.summary().as_dict()


@pytest.mark.parametrize("sampling", ["adaptive", "cached"])
def test_runs_and_thread_counts_are_bit_identical(sampling: str) -> None:
    runs = [events_of("two-boxes", threads=threads, sampling=sampling).tobytes() for threads in (1, 2, 2)]
    assert len(runs[0]) > 0 and runs[0] == runs[1] == runs[2]


@pytest.mark.parametrize("sampling", ["adaptive", "cached"])
def test_a_still_scene_fires_nothing(sampling: str) -> None:
    assert len(events_of("still", sampling=sampling)) == 0


def test_paths_go_where_events_are_near() -> None:
    """Without a map in reach, all frames but the first would be probed alone; with all maps marked, none would."""
    summary = summary_of("moving-light", quality="balanced", sampling="adaptive", frame_count=12, fps=60.0)
    pixels = SIZE[0] * SIZE[1]
    assert summary["effort"] == {"probe_spp": 1, "spp": 8, "first_hit_rays": 12, "every": 2}
    later = summary["paths"] - 8 * pixels
    assert 2 * 11 / 2 * pixels < later < 0.8 * 8 * 11 * pixels
    assert 12 * pixels < summary["first_hit_rays"] <= 12 * 16 * pixels
    assert 0 < summary["noise_share"] < 0.5
    assert summary["governor"] is None


def test_pixels_are_probed_at_different_phases_in_a_live_run() -> None:
    summary = summary_of(
        "moving-light", sampling="uniform", first_hit_rays=4, spp=1, probe_every=3, frame_count=10, fps=60.0
    )
    pixels = SIZE[0] * SIZE[1]
    assert summary["effort"] == {"probe_spp": 1, "spp": 1, "first_hit_rays": 4, "every": 3}
    # All of the first frame, then each pixel in each third; and at rims, the few whose path missed what rays saw.
    assert 0 <= summary["paths"] - pixels * (1 + 9 // 3) < 0.02 * 9 * pixels


def test_maps_are_found_over_the_seam_of_a_loop() -> None:
    """The end of the motion does not meet its start: the detector is reset, and nobody may wait for ever."""
    session = open_live(
        LiveOptions("two-boxes", resolution=SIZE, sampling="adaptive", loop=True, fps=8.0, frame_count=40)
    )
    assert session.schedule.crosses_seam(15, 16)
    session.start()
    assert session.pipeline.wait(120)
    assert session.summary().frames == 40


def test_at_the_pace_of_the_clock_the_governor_tells_what_it_does() -> None:
    summary = summary_of("still", pace="real", fps=20.0, frame_count=12)
    assert (summary["frames"], summary["events"]) == (12, 0), "changes of effort fire no events"
    assert set(summary["governor"]) == {"level", "levels", "changes", "restarts", "given_up", "too_slow"}
    assert summary_of("still", pace="real", fps=20.0, frame_count=2, governor=False)["governor"] is None


def test_an_interrupt_ends_an_adaptive_run_within_a_second(tmp_path: Path) -> None:
    out = tmp_path / "events.aedat4"
    arguments = ["live", "two-boxes", "--quality", "balanced", "--resolution", "64x48", "--loop", "--json"]
    run = subprocess.Popen(
        [sys.executable, "-m", "clsim", *arguments, "--out", str(out)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    try:
        deadline = time.monotonic() + 60
        while (not out.exists() or out.stat().st_size < 20_000) and time.monotonic() < deadline:
            time.sleep(0.05)
        run.send_signal(signal.SIGINT)
        stdout, stderr = run.communicate(timeout=30)
    finally:
        run.kill()
    assert run.returncode == 130, stderr
    summary = json.loads(stdout)
    assert summary["interrupted"] and summary["events"] == len(np.concatenate(list(open_source(out)))) > 0
    about = json.loads((tmp_path / "events.aedat4.json").read_text())
    assert about["options"]["quality"] == "balanced" and about["options"]["sampling"] == "cached"


@pytest.mark.slow
def test_light_is_cached_where_only_the_camera_moves() -> None:
    """Cached light finds the events of a run with far more paths better than paths of each frame do."""
    gains = []
    for seed in range(3):
        truth = events_of("two-boxes", sampling=None, quality="exact", spp=256, frame_count=8, seed=seed)
        found = events_of("two-boxes", sampling="cached", quality="balanced", frame_count=8, seed=seed)
        others = events_of("two-boxes", quality="balanced", frame_count=8, seed=seed)
        cached, fresh = (score(events, truth, *SIZE, fps=60).strict_f1 for events in (found, others))
        gains.append(cached - fresh)
    assert np.mean(gains) > 0.02


@pytest.mark.parametrize(
    ("scene", "quality", "time"),
    [
        ("two-boxes", "draft", "fixed"),
        pytest.param("two-boxes", "draft", "adaptive", marks=pytest.mark.slow),
        pytest.param("two-boxes", "exact", "fixed", marks=pytest.mark.slow),
        ("cornell", "balanced", "fixed"),
    ],
)
def test_noise_is_what_another_seed_does_not_fire(
    monkeypatch: pytest.MonkeyPatch, scene: str, quality: str, time: str
) -> None:
    monkeypatch.setattr(live_session, "DUPLICATE_EVERY", 1)
    given = {"sampling": None, "quality": quality, "frame_count": 8, "time": time}
    told = summary_of(scene, **given, fps=60.0)["noise_share"]
    runs = (events_of(scene, **given, seed=seed) for seed in (0, 1))
    alone = 1 - score(*runs, *SIZE, fps=60, within_us=(25_000,)).within[25_000].precision
    assert alone / 1.5 < told < alone * 1.5


def test_of_a_real_sensor_noise_is_told_as_ideal_pixels_have_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Under another name, for its events are not those."""
    monkeypatch.setattr(live_session, "DUPLICATE_EVERY", 1)
    given = {"sampling": None, "quality": "draft", "frame_count": 8, "fps": 60.0, "threshold": (0.2, 0.2)}
    ideal, real = (summary_of("two-boxes", sensor=sensor, **given) for sensor in (None, "davis346"))
    assert ideal["events"] != real["events"]
    assert real["ideal_noise_share"] == ideal["noise_share"] > 0
    assert real["noise_share"] is ideal["ideal_noise_share"] is None


def test_a_quality_keeps_light_in_every_driver() -> None:
    """With the bits of a run that asks for it, unless a setting goes without it."""
    asked = events_of("two-boxes", sampling="cached", quality="balanced", frame_count=6)
    assert len(asked) > 0
    assert events_of("two-boxes", sampling=None, frame_count=6).tobytes() == asked.tobytes()
    with clsim.Simulator("two-boxes", resolution=SIZE, fps=60.0) as simulator:
        assert simulator.step(until_us=83_334).tobytes() == asked.tobytes()
    others = ({"sampling": "adaptive"}, {"method": "irradiance"}, {"noise": "independent"}, {"quality": "exact"})
    cached = [plan_stages(LiveOptions("two-boxes", **given)).render.light_cache for given in ({}, *others)]  # type: ignore[arg-type]
    assert cached == [True, False, False, False, False]
    assert plan_stages(LiveOptions("moving-light")).render.light_cache


@pytest.mark.parametrize("quality", ["draft", "accurate"])
def test_each_quality_runs(quality: str) -> None:
    assert len(events_of("two-boxes", sampling=None, quality=quality, frame_count=4)) > 0
