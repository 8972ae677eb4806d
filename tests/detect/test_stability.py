"""The kernels at extremes: bounds on every row of tools/accuracy/stability.py, and laws of any scene."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from clsim.detect.config import DetectorConfig
from clsim.detect.float64.observation import feature_names, observe
from clsim.detect.reference import ReferenceDetector
from clsim.errors import InputError
from clsim.opencl.device import choose_device
from tests.detect.reference_scenes import random_frames
from tools.accuracy import stability as bench
from tools.accuracy.stability_cases import Case, cases, frames

ROWS = {case.name: case for case in cases()}

USUAL = (5e-5, 0, 1e-12)
BOUNDS = {
    "a smooth surface": (2e-3, 8, 1e-11),
    "λ = 1e-08, features collinear but for 1e-4": (1.0, 5, 1e-7),
    "λ = 1e-07, features collinear but for 1e-4": (0.2, 5, 1e-8),
    "λ = 1e-06, features collinear but for 1e-4": (3e-2, 2, 1e-10),
    "λ = 1e-05, features collinear but for 1e-4": (1e-4, 0, 1e-12),
    "λ = 1e-08, a smooth surface": (3.0, 40, 1e-8),
    "λ = 1e-07, a smooth surface": (2.0, 30, 2e-9),
    "λ = 1e-06, a smooth surface": (5e-2, 15, 1e-10),
    "λ = 1e-05, a smooth surface": (2e-3, 8, 1e-11),
    "λ = 1e-04, a smooth surface": (2e-4, 2, 1e-12),
}
"""Largest error of α in float32, number of flips in float32 and error in float64, where the usual ones do not hold:
there directions of feature space are so nearly dependent that the ridge alone, or with small ones rounding, sets α."""


QUICK = ("a smooth surface", "random features", "C = 1e-36", "C = 1e+30")
"""Rows that each run of the quick suite measures; kernels of their own are compiled for many of the others."""


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in ROWS]
)
def test_errors_flips_and_bad_values(name):
    row = bench.measure(ROWS[name], choose_device())
    single, flips, double = BOUNDS.get(name, USUAL)
    assert row.bad_values == {"float32": 0, "float64": 0}
    assert row.alpha_error["float32"] <= single and row.alpha_error["float64"] <= double
    assert row.flips["float32"] <= flips and row.flips["float64"] == 0
    assert row.pixels > 0


def test_every_bound_has_its_row():
    assert set(BOUNDS) <= set(ROWS)


def test_the_documents_table_has_every_row():
    page = (Path(__file__).parents[2] / "docs" / "stability.md").read_text()
    named = [line.split("|")[1].strip() for line in page.splitlines() if line.startswith("| ")]
    assert named[1:] == list(ROWS), (
        "run: python -m tools.accuracy.stability --markdown FILE, and put the table into the page"
    )


def test_the_bench_notices_wrong_values(monkeypatch):
    """Errors, flips and values that are no numbers are counted, not passed over."""
    case = Case("random", frames())
    levels = bench.FedDetector.levels

    def off(self):
        values = levels(self)
        values[3, 4] += 0.25
        values[5, 6] = np.nan
        return values

    monkeypatch.setattr(bench.FedDetector, "levels", off)
    monkeypatch.setattr(bench.FedDetector, "solved", lambda self: np.zeros((20, 26), dtype=bool))
    row = bench.measure(case, choose_device())
    assert row.alpha_error["float32"] == np.inf and row.bad_values["float64"] == 4
    assert row.flips["float64"] > 100
    monkeypatch.setattr(bench.FedDetector, "levels", lambda self: levels(self) + 0.25)
    assert bench.measure(case, choose_device()).alpha_error["float64"] == pytest.approx(0.25)


def test_times_do_not_drift():
    """Whole microseconds are off by half of one at most, and so is each of a stamp's two ends."""
    assert bench.time_error_us() <= 1.0


def test_the_tool_prints_what_it_measures(monkeypatch, tmp_path, capsys):
    some = [ROWS["frame of 1×1"], ROWS["one valid pixel"]]
    monkeypatch.setattr(bench, "cases", lambda: some)
    files = [str(tmp_path / name) for name in ("t.json", "t.md")]
    monkeypatch.setattr("sys.argv", ["stability.py", "--json", files[0], "--markdown", files[1]])
    bench.main()
    figures = json.loads((tmp_path / "t.json").read_text())
    assert [row["name"] for row in figures["rows"]] == ["frame of 1×1", "one valid pixel"]
    table = (tmp_path / "t.md").read_text()
    assert table in capsys.readouterr().out
    cells = [cell.strip() for cell in table.splitlines()[2].split("|")[1:-1]]
    assert cells[0] == "frame of 1×1" and cells[1] == f"{figures['rows'][0]['alpha_error']['float32']:.0e}"
    assert cells[3:] == ["0", "0", "1", "none"]


@pytest.mark.parametrize("option", ["threshold_on", "threshold_off"])
@pytest.mark.parametrize("value", [0.0, 1e-37, 1e31, -1.0])
def test_thresholds_that_float32_cannot_hold_are_refused(option, value):
    with pytest.raises(InputError, match=f"`{option}` must be .* from 1e-36 to 1e.* {option[10:].upper()} events"):
        DetectorConfig(**{option: value})


@pytest.mark.parametrize("option", ["threshold_on", "threshold_off"])
def test_a_threshold_that_is_no_number_is_refused(option):
    with pytest.raises(InputError, match=f"`{option}` must be a finite number, got nan"):
        DetectorConfig(**{option: float("nan")})


def test_floors_that_float32_cannot_hold_are_refused():
    with pytest.raises(InputError, match=r"`floor` must be at least 1\.2e-38, got 1e-40"):
        DetectorConfig(floor=1e-40)


METHODS = [
    {"method": "esim"},
    {"method": "wlr-esim"},
    {"gate": "delta-r"},
    {"gate": "radiance"},
    {"gate": "radiance", "event_rule": "frame"},
    {"gate": "radiance", "history": 2},
]
LAW = {"seed": st.integers(0, 10**6), "options": st.sampled_from(METHODS)}
FEW = settings(max_examples=8, deadline=None)


def compare(options, change=None, brightness=None, mirror=False, negate=False, seed=0):
    """Run kernels on frames and on changed ones; the events and levels must correspond where nothing was near."""
    first, second = random_frames(seed, count=3), random_frames(seed, count=3)
    for frame in second if change else ():
        change(frame)
    config = DetectorConfig(
        **{"window": 5, "box": 3, "threshold_on": 0.1, "threshold_off": 0.13, "precision": "float64", **options}
    )
    swapped = dataclasses.replace(config, threshold_on=0.13, threshold_off=0.1) if negate else config
    size = (first[0].width, first[0].height, first[0].names)
    plain, other = bench.FedDetector(config, *size), bench.FedDetector(swapped, *size)
    reference = ReferenceDetector(config, *size)
    seen = [observe(frame, feature_names(config, frame.names), config) for frame in first]
    plain.estimator.brightness = [o.brightness for o in seen]
    other.estimator.brightness = [(brightness or (lambda y: y))(o.brightness) for o in seen]
    if mirror:
        other.estimator.brightness = [y[:, ::-1] for y in other.estimator.brightness]
    total = 0
    for a, b, observation in zip(first, second, seen, strict=True):
        expected, got = plain.step(a), other.step(b)
        reference.step_observation(observation, a.time_us)
        clear = reference.margin > 1e-6
        solved = other.solved()[:, ::-1] if mirror else other.solved()
        np.testing.assert_array_equal(plain.solved()[clear], solved[clear])
        got = got.copy()
        if mirror:
            got["x"] = size[0] - 1 - got["x"]
        got["on"] ^= negate
        expected, got = (
            e[np.lexsort((e["t"], e["x"], e["y"]))] for e in (x[clear[x["y"], x["x"]]] for x in (expected, got))
        )
        assert len(expected) == len(got)
        for name in ("x", "y", "on"):
            np.testing.assert_array_equal(expected[name], got[name])
        assert np.abs(expected["t"] - got["t"]).max(initial=0) <= 1
        total += len(expected)
    assert clear.mean() > 0.9 and total > 0
    levels = plain.levels(), other.levels()[:, ::-1] if mirror else other.levels()
    for detector in (plain, other):
        detector.close()
    return levels


@FEW
@given(**LAW, shift=st.floats(-20, 20))
def test_adding_a_constant_to_y_moves_alpha_by_it_and_changes_no_event(seed, options, shift):
    plain, other = compare(options, brightness=lambda y: y + shift, seed=seed)
    np.testing.assert_allclose(other, plain + shift, atol=1e-6)


@FEW
@given(**LAW, power=st.integers(-20, 20), name=st.sampled_from(["Depth", "Nx", "Albedo.G"]))
def test_scaling_a_feature_changes_nothing(seed, options, power, name):
    """By powers of 2, so that a frame's float32 holds the scaled feature exactly."""

    def scale(frame):
        frame.plane(name)[...] *= np.float32(2.0**power)

    plain, other = compare(options, change=scale, seed=seed)
    np.testing.assert_allclose(other, plain, atol=1e-6)


@FEW
@given(**LAW)
def test_mirroring_the_image_mirrors_the_events(seed, options):
    def mirror(frame):
        frame.planes[...] = frame.planes[:, :, ::-1].copy()

    plain, other = compare(options, change=mirror, mirror=True, seed=seed)
    np.testing.assert_allclose(other, plain, atol=1e-6)


@FEW
@given(**LAW)
def test_negating_y_swaps_the_polarities(seed, options):
    plain, other = compare(options, brightness=lambda y: -y, negate=True, seed=seed)
    np.testing.assert_allclose(other, -plain, atol=1e-6)


def test_brightness_that_moves_by_just_the_threshold_fires():
    frames = random_frames(1, count=3)
    first = frames[0]
    config = DetectorConfig(method="esim", threshold_on=0.25, threshold_off=0.125)
    detector = bench.FedDetector(config, first.width, first.height, first.names)
    shape = (first.height, first.width)
    detector.estimator.brightness = [np.full(shape, level) for level in (0.0, 0.25, 0.125)]
    batches = [detector.step(frame).copy() for frame in frames]
    assert [len(batch) for batch in batches] == [0, 99, 99]
    assert batches[1]["on"].all() and not batches[2]["on"].any()
