"""The gates that keep their old windows."""

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detect.float64.fit import fit_pixels, gather
from clsim.detect.float64.gate import Model
from clsim.detect.float64.kept import KeptWindows, published
from clsim.detect.float64.observation import feature_names, observe
from clsim.detect.reference import ReferenceDetector
from tests.detect.reference_scenes import random_frames, run

OPTIONS = {"window": 5, "threshold_on": 0.1, "threshold_off": 0.13}


def detect(frames, **options):
    detector = ReferenceDetector(DetectorConfig(**{**OPTIONS, **options}), 11, 9, frames[0].names)
    return run(detector, frames), detector


@pytest.mark.parametrize("rule", ["frame", "interpolated"])
@pytest.mark.parametrize("options", [{}, {"history": 3}, {"kernel": "epanechnikov", "stride": 2}, {"ridge": 1e-2}])
def test_brute_force_residual_decides_as_the_closed_form(rule, options):
    frames = random_frames(21, count=5)
    frames[2].planes[3, 4, 4:7] = np.nan
    closed, a = detect(frames, gate="delta-r", event_rule=rule, **options)
    brute, b = detect(frames, gate="delta-r-exact", event_rule=rule, **options)
    assert a.margin.min() > 1e-8, "choose a seed without a pixel at a threshold"
    assert len(closed) > 50
    np.testing.assert_array_equal(closed, brute)
    assert 0 < a.stats.solved == b.stats.solved < a.stats.tested


def normalised(values, lo, hi):
    constant = hi - lo <= 1e-6 * np.maximum(np.abs(lo), np.abs(hi))
    return np.where(constant, 0.0, (values - lo) / np.where(constant, 1.0, hi - lo))


def test_after_a_reset_the_kept_windows_are_those_of_the_new_start():
    """Their history is shorter then than their room."""
    frames = random_frames(25, count=6)
    stats = []
    for gate in ("delta-r", "delta-r-exact"):
        config = DetectorConfig(**OPTIONS, gate=gate, history=3, event_rule="frame")
        detector = ReferenceDetector(config, 11, 9, frames[0].names)
        first = run(detector, frames[:4])
        detector.reset()
        stats.append((len(first), *(detector.step(frame).tolist() for frame in frames[4:]), detector.stats.solved))
    assert stats[0] == stats[1]


@pytest.mark.parametrize("kernel", ["epanechnikov", "gaussian"])
def test_published_gate_by_hand(kernel):
    config = DetectorConfig(**OPTIONS, gate="published", kernel=kernel)
    old, new = random_frames(22, count=2, misses=False, step=1.0)
    planes = feature_names(config, old.names)
    before, after = observe(old, planes, config), observe(new, planes, config)
    pixels = np.arange(99)
    model, kept = Model(99, 10, 2), KeptWindows(99)
    model.replace(pixels, fit_pixels([before], pixels, config), None)
    kept.replace([before], pixels, config)
    ref = model.fit.alpha.copy()
    verdict = published(model, kept, pixels, ref, [after], config)
    then, now = gather([before], pixels, 5, 1), gather([after], pixels, 5, 1)
    solved = 0
    for i in range(99):
        lo, hi = model.fit.lo[i], model.fit.hi[i]
        samples = normalised(then.x[i], lo, hi)
        centre = normalised(now.centre[i], now.lo[i], now.hi[i])
        slope = model.fit.slope[i] * (hi - lo)
        t = samples - centre
        weights = np.exp(-t * t / 2) if kernel == "gaussian" else np.maximum(0.75 * (1 - t * t), 1e-8)
        weights = weights.prod(axis=1) * then.mask[i]
        r = then.y[i] - model.fit.alpha[i] - (samples - centre) @ slope
        moved = (weights * r * r).sum() / weights.sum()
        delta = abs(moved - model.fit.residual[i])
        predicted = model.fit.alpha[i] + slope @ (centre - normalised(then.centre[i], lo, hi))
        assert verdict.predicted[i] == pytest.approx(predicted, abs=1e-9)
        threshold = 0.1 if predicted >= ref[i] else 0.13
        assert verdict.margin[i] == pytest.approx(abs(np.sqrt(delta) - threshold), abs=1e-9)
        expected = delta > threshold**2
        assert verdict.solve[i] == expected
        solved += expected
    assert 10 < solved < 95


def test_published_gate_does_not_see_what_moves_the_whole_window():
    old = random_frames(23, count=1, misses=False)[0]
    new = old.copy()
    new.plane("Depth")[...] += 5
    new.time_us, new.index = 10_000, 1
    _, blind = detect([old, new], gate="published")
    assert blind.stats.solved == 0
    _, seeing = detect([old, new], gate="delta-r")
    assert seeing.stats.solved > 0


def test_published_gate_brings_its_kernel():
    frame = random_frames(24, count=1)
    _, published_gate = detect(frame, gate="published")
    _, epanechnikov = detect(frame, gate="delta-r", kernel="epanechnikov")
    _, gaussian = detect(frame, gate="delta-r")
    np.testing.assert_array_equal(published_gate.level, epanechnikov.level)
    assert np.abs(published_gate.level - gaussian.level).max() > 1e-3
