"""Figures of a sequence against arrays that were written, and the limits on them."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from PIL import Image

from clsim.datasets import preview as preview_module
from clsim.datasets.job import Done, run_job, sequence_folder
from clsim.datasets.measure import Figures, measure, reasons
from clsim.datasets.spec import Limits, load_spec
from clsim.events import EVENT_DTYPE

_SUMMARY = SimpleNamespace(width=10, height=4, frames=6, simulated_s=0.5, events=400, on_events=100)


def test_figures_are_those_of_the_arrays(tmp_path):
    """Speeds of .05 to 9.95 px in even steps, of valid pixels; others are far faster."""
    speed = np.arange(0.05, 10, 0.1)
    flow = np.full((2, 4, 25, 2), 1000.0, np.float32)
    valid = np.zeros((2, 4, 25), np.uint8)
    for frame, half in enumerate((speed[:50], speed[50:])):
        flow[frame, :2] = np.stack([0.6 * half, -0.8 * half], axis=-1).reshape(2, 25, 2)
        valid[frame, :2] = 1
    depth = np.full((2, 4, 25), 3.0, np.float32)
    depth[1, 2, 7] = 0.25
    with h5py.File(tmp_path / "events.h5", "w") as file:
        file["frames/flow"], file["frames/flow_valid"], file["frames/depth"] = flow, valid, depth
    figures = measure(tmp_path, _SUMMARY, SimpleNamespace(truth=("flow", "depth")))
    assert figures.events_per_pixel_s == pytest.approx(400 / 40 / 0.5)
    assert figures.flow_p95_px == pytest.approx(np.percentile(speed, 95), abs=1e-3)
    assert figures.moving_share == pytest.approx(0.99)
    assert figures.nearest_m == 0.25
    assert (figures.frames, figures.duration_s, figures.on_events) == (6, 0.5, 100)


def test_without_truth_nothing_is_told_of_it(tmp_path):
    figures = measure(tmp_path, _SUMMARY, SimpleNamespace(truth=()))
    assert (figures.flow_p95_px, figures.moving_share, figures.nearest_m) == (None, None, None)


@pytest.mark.parametrize(
    ("name", "good", "low", "high"),
    [
        ("events_per_pixel_s", 5.0, 0.9, 10.1),
        ("flow_p95_px", 1.0, 0.99, 11.0),
        ("moving_share", 10.0, 0.5, 10.5),
    ],
)
def test_limits_keep_what_is_between_them(name, good, low, high):
    limits = Limits(**{name: (1.0, 10.0)})
    plain = Figures(1, 1, 1, 1.0, 1, 1, 1.0)
    assert reasons(replace(plain, **{name: good}), limits) == []
    for value in (low, high):
        assert reasons(replace(plain, **{name: value}), limits) == [f"{name} is {value:.4g}, expected 1 to 10"]
    if name != "events_per_pixel_s":
        assert reasons(plain, limits) == [f"{name} is unknown, expected 1 to 10"]


def test_a_camera_inside_of_something_is_refused():
    limits, plain = Limits(nearest_m=0.2), Figures(1, 1, 1, 1.0, 1, 1, 1.0)
    assert reasons(replace(plain, nearest_m=0.2), limits) == []
    assert reasons(replace(plain, nearest_m=0.19), limits) == ["nearest_m is 0.19, expected at least 0.2"]
    assert reasons(plain, limits) == ["nearest_m is unknown, expected at least 0.2"]


@pytest.mark.parametrize(("workers", "hours"), [(None, 0.125), (2, 0.5), (99, 0.125)])
def test_what_all_will_cost_is_told_by_ten(tmp_path, monkeypatch, workers, hours):
    """Of 100 sequences, each of 36 s and 50 MB, on a machine of eight cores: no more of them work at once."""

    asked, sheets = [], []

    def made(spec, index, out, threads):
        asked.append((spec.layout, spec.run["truth"]))
        kept = index % 2 == 1
        return Done(index, "", "", {"events.h5": (50_000_000, "")}, {}, ("too dark",) * 2, kept, {"cpu_s": 36.0})

    monkeypatch.setattr(preview_module, "run_job", made)
    monkeypatch.setattr(preview_module, "read_done", lambda place: place)
    monkeypatch.setattr(preview_module, "Sequence", contextlib.nullcontext)
    monkeypatch.setattr(preview_module, "_tile", lambda place: int(place.name))
    monkeypatch.setattr(preview_module, "_write_sheet", lambda tiles, path: sheets.append(tiles))
    monkeypatch.setattr("os.cpu_count", lambda: 8)
    tiny = load_spec(str(Path(__file__).parent / "tiny.toml"), 100)
    for longest_s, samples, truth in ((60.0, 10, ["depth", "flow"]), (-1.0, 1, "depth")):
        spec = replace(tiny, layout="dsec", run=tiny.run | {"truth": truth})
        told = preview_module.preview(spec, tmp_path / "new" / "folder", workers, longest_s)
        assert (told.samples, told.rejected) == (samples, 2 * samples)
        assert (told.cpu_hours, told.hours, told.gigabytes) == pytest.approx((1.0, hours, 5.0))
        assert asked[-1] == ("h5", ["depth", *(["flow"] if samples > 1 else []), "intensity"]), "the sheet shows it"
    assert sheets == [[1, 3, 5, 7, 9], []], "of those that are kept"


def test_samples_stand_in_rows_of_five(tmp_path):
    preview_module._write_sheet([np.full((4, 6, 3), 30 * k, np.uint8) for k in range(6)], tmp_path / "a.png")
    sheet = np.asarray(Image.open(tmp_path / "a.png"))[..., 0]
    seen = sheet[1::8, 1::10].ravel().tolist()
    assert sheet.shape == (2 * 8, 5 * 10) and seen == [0, 30, 60, 90, 120, 150, *[230] * 4]


def test_a_sample_s_events_are_those_next_to_its_picture_in_time():
    """Where there are so many that they would cover all; each is at a pixel of its own, ON in red, OFF in blue."""
    events = np.zeros(96, EVENT_DTYPE)
    events["t"] = 5_050 + 100 * np.arange(96)
    events["y"], events["x"] = np.divmod(np.random.default_rng(3).permutation(96), 12)
    events["on"] = np.arange(96) % 3 == 0
    times_us = np.array([0, 10_000, 20_000])
    light = np.repeat([[4.0], [1.0]], [2, 6], axis=0).repeat(12, axis=1)
    light[0, -1] = 1000.0  # a lamp leaves all else as bright as it is
    told = SimpleNamespace(
        width=12,
        height=8,
        frame_times_us=times_us,
        truth=lambda name, frame: light,
        events=lambda start_us, end_us: events[(events["t"] >= start_us) & (events["t"] < end_us)],
    )
    tile = preview_module._tile(told)
    assert tile[:, 0, 0].tolist() == [255] * 2 + [int(255 * 0.25 ** (1 / 2.2))] * 6, "as screens show light"
    seen = tile[:, 12:].astype(int)
    expected = np.zeros((8, 12), int)
    near = events[np.argsort(np.abs(events["t"] - times_us[1]), kind="stable")[: 8 * 12 // 6]]
    expected[near["y"], near["x"]] = np.where(near["on"], 1, -1)
    np.testing.assert_array_equal(np.sign(np.where(seen.min(axis=2) == 255, 0, seen[..., 0] - seen[..., 2])), expected)
    events = events[:2]
    events["t"] = 24_999, 25_000
    assert (preview_module._tile(told)[:, 12:].min(axis=2) < 255).sum() == 1, "15 ms after the picture, no more"


def test_a_sequence_holds_what_was_asked_for_and_nothing_that_tells_of_the_clock(tmp_path):
    spec = load_spec(str(Path(__file__).parent / "tiny.toml"))
    short = replace(spec, run=spec.run | {"frame_count": 2}, also=("a.csv", "b.npz"))
    done = run_job(short, 0, str(tmp_path), 2)
    told = (sequence_folder(tmp_path, 0) / "events.h5").read_bytes()
    assert b'"threads": null' in told and str(tmp_path).encode() not in told, "nor of the machine"
    assert set(done.files) >= {"scene.toml", "events.h5", "a.csv", "b.npz"}
    assert [each.name for each in sequence_folder(tmp_path, 0).glob("*.json")] == ["job.json"]
