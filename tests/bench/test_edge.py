"""The bundled edge: rendered brightness is its closed form, and more rays time it better."""

from types import SimpleNamespace

import numpy as np
import pytest

from clsim.bench.edge import KINDS, edge_scene, measure_edge, measure_edges
from clsim.bench.tradeoff.measure import render_each
from clsim.bench.tradeoff.reference_cache import log_brightness
from clsim.render import RenderOptions

SIZE = (32, 24)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_what_is_rendered_is_the_closed_form(kind):
    scene = edge_scene(kind, 100.0, *SIZE, 60.0)
    errors = []

    def take(frame):
        true = scene.edge.luminance(*SIZE, frame.time_us / 1e6)
        assert (true < 0.9).sum() > 50 and (true > 0.3).sum() > 50, "the edge is outside the picture"
        errors.append(np.exp(log_brightness(frame, scene.world.sensor)) - true)

    render_each(scene.world, RenderOptions(spp=256, fps=60.0, frames=scene.frames, sampler="sobol"), take)
    assert len(errors) == scene.frames >= 10
    assert np.abs(errors).max() < 0.02
    assert abs(np.mean(errors)) < 1e-4


@pytest.mark.slow
def test_an_edge_is_timed_and_events_are_paired_with_true_ones():
    """True events have times of their own, and what many rays find is nearer to them than what few find."""
    found = {quality: measure_edge(edge_scene("geometric", 30.0, *SIZE, 120.0), quality, 120.0)
             for quality in ("draft", "accurate")}  # fmt: skip
    assert found["draft"]["true_events"] > 500
    for each in found.values():
        assert 0.5 * each["true_events"] < each["matched"] <= min(each["true_events"], each["events"])
    assert found["accurate"]["error_px"] < 0.005
    assert found["accurate"]["error_px"] < 0.5 * found["draft"]["error_px"] < 0.05


@pytest.mark.slow
@pytest.mark.parametrize(("quality", "most_px"), [("balanced", 0.02), ("accurate", 0.005)])
@pytest.mark.parametrize("speed_px_s", [300.0, 3000.0])
def test_a_fast_edge_is_timed_as_well_as_a_slow_one(quality, most_px, speed_px_s):
    """It goes 2.5 and 25 pixels from frame to frame, where frames alone are off by half a pixel and more."""
    scene = edge_scene("geometric", speed_px_s, *SIZE, 120.0)
    found = measure_edge(scene, quality, 120.0)
    assert found["matched"] > 0.98 * max(found["true_events"], found["events"]) > 500
    assert found["error_px"] < most_px < 0.3 < measure_edge(scene, quality, 120.0, "fixed")["error_px"]


@pytest.mark.parametrize(("speed_px_s", "frames"), [(30.0, 24), (300.0, 10), (3000.0, 3)])
def test_edges_of_all_speeds_stay_in_the_picture_and_pass_its_middle(speed_px_s, frames):
    scene = edge_scene("geometric", speed_px_s, *SIZE, 120.0)
    assert scene.frames == frames
    edge, half_s = scene.edge, (frames - 1) / 120 / 2
    assert edge.offset_px + edge.speed_px_s * half_s == pytest.approx(edge.normal[0] * 16 + edge.normal[1] * 12)
    assert edge.speed_px_s == speed_px_s


@pytest.mark.parametrize("late_us", [-50, 100])
def test_events_that_are_late_have_a_bias_along_the_edge_s_way(monkeypatch, late_us):
    scene = edge_scene("geometric", 300.0, *SIZE, 120.0)
    true = scene.edge.events(*SIZE, (scene.frames - 1) / 120.0, scene.world.sensor.threshold_on)
    true["t"] += late_us
    true["t"][0] += 2000  # one of many, which the median hardly sees
    monkeypatch.setattr("clsim.bench.edge.run_point", lambda *_: SimpleNamespace(events=true[::2], cpu_s=1.0))
    found = measure_edge(scene, "draft", 120.0, "fixed")
    matched = len(true[::2])
    assert found["matched"] == found["events"] == matched and found["true_events"] == len(true)
    assert found["f1"] == pytest.approx(2 * matched / (matched + len(true)))
    assert found["bias_px"] == pytest.approx(300.0 * (late_us + 2000 / matched) * 1e-6)
    assert found["cpu_us_per_pixel_second"] == pytest.approx(1e6 / (SIZE[0] * SIZE[1] * scene.frames / 120.0))
    assert found["error_px"] == pytest.approx(300.0 * abs(late_us) * 1e-6)


def test_all_qualities_are_measured_on_all_edges(monkeypatch):
    monkeypatch.setattr("clsim.bench.edge.measure_edge", lambda scene, *_: {"ramp_px": scene.edge.ramp_px})
    rows = measure_edges((30.0, 300.0), SIZE, 120.0, "fixed", lambda _: None)
    seen = {(row["kind"], row["ramp_px"], row["speed_px_s"], row["quality"]) for row in rows}
    kinds = ("geometric", 0.0), ("albedo", 0.0), ("ramp", 4.0)
    assert seen == {(*k, s, q) for k in kinds for s in (30.0, 300.0) for q in ("draft", "balanced", "accurate")}


@pytest.mark.parametrize(("speed_px_s", "fps"), [(300.0, 120.0), (30.0, 240.0)])
@pytest.mark.parametrize(("share", "paired"), [(0.95, True), (1.05, False)])
def test_events_are_paired_up_to_a_frame_or_a_pixel_of_travel_whichever_is_longer(
    monkeypatch, speed_px_s, fps, share, paired
):
    scene = edge_scene("geometric", speed_px_s, *SIZE, fps)
    first = scene.edge.events(*SIZE, (scene.frames - 1) / fps, scene.world.sensor.threshold_on)[:1]
    late = first.copy()
    late["t"] += round(1e6 * share * max(1 / fps, 1 / speed_px_s))
    monkeypatch.setattr("clsim.bench.edge.run_point", lambda *_: SimpleNamespace(events=late, cpu_s=1.0))
    monkeypatch.setattr("clsim.score.straight_edge.Edge.events", lambda *_: first)
    assert measure_edge(scene, "draft", fps, "fixed")["matched"] == paired
