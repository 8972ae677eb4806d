"""The gates and the event rules, each against arithmetic written out pixel by pixel."""

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detect.float64.fit import fit_pixels
from clsim.detect.float64.gate import Model, beyond, box_means, delta_r, leaves_range, radiance
from clsim.detect.float64.observation import feature_names, observe
from clsim.detect.float64.rule import Step, apply_rule
from clsim.detect.reference import ReferenceDetector
from tests.detect.reference_scenes import make_frame, random_frames, run

CONFIG = DetectorConfig(window=5, box=3, threshold_on=0.1, threshold_off=0.15, gate_scale=0.8)


def two_frames(seed):
    """A model from the first frame, and the second as an observation; some pixels of both are bad."""
    old, new = random_frames(seed, count=2, step=1.0)
    old.planes[4, 2, 2:5] = np.nan
    new.planes[0, 6, 7] = np.inf
    planes = feature_names(CONFIG, old.names)
    before, after = (observe(frame, planes, CONFIG) for frame in (old, new))
    both = np.flatnonzero(before.valid.ravel() & after.valid.ravel())
    model = Model(99, 10, 2)
    model.replace(both, fit_pixels([before], both, CONFIG), box_means(before, CONFIG.box))
    return before, after, model, both


def box_by_hand(o, pixel, farthest):
    y, x = divmod(int(pixel), 11)
    brightness, features = [], []
    for v in range(max(y - 1, 0), min(y + 2, 9)):
        for u in range(max(x - 1, 0), min(x + 2, 11)):
            if o.valid[v, u]:
                brightness.append(o.brightness[v, u])
                features.append(o.features[v, u].copy())
                if not o.hit[v, u]:
                    features[-1][2] = farthest
    return np.mean(brightness), np.mean(features, axis=0)


@pytest.mark.parametrize("sky_depth", [0.0, 50.0])
def test_radiance_gate_by_hand(sky_depth):
    before, after, model, pixels = two_frames(8)
    for o in (before, after):
        o.features[..., 2][o.valid & ~o.hit] = sky_depth
    model.replace(pixels, fit_pixels([before], pixels, CONFIG), box_means(before, CONFIG.box))
    ref = np.random.default_rng(0).normal(-1, 0.2, 99)
    verdict = radiance(model, pixels, ref, after, box_means(after, CONFIG.box), CONFIG)
    plain = delta_r(model, pixels, ref, after, CONFIG)
    decided = {"delta-r": 0, "box": 0, "range": 0, "none": 0}
    for i, pixel in enumerate(pixels):
        farthest = model.fit.hi[pixel, 2]
        y0, x0 = box_by_hand(before, pixel, farthest)
        y1, x1 = box_by_hand(after, pixel, farthest)
        slope, alpha = model.fit.slope[pixel], model.fit.alpha[pixel]
        centre = after.features.reshape(-1, 10)[pixel].copy()
        if not after.hit.ravel()[pixel]:
            centre[2] = farthest
        by_features = alpha + slope @ (centre - model.fit.centre[pixel])
        predicted = by_features + (y1 - y0) - slope @ (x1 - x0)
        assert plain.predicted[i] == pytest.approx(by_features, abs=1e-10)
        assert verdict.predicted[i] == pytest.approx(predicted, abs=1e-10)
        by_delta_r = not -0.15 <= by_features - ref[pixel] <= 0.1
        by_box = not -0.15 * 0.8 <= predicted - ref[pixel] <= 0.1 * 0.8
        lo, hi = model.fit.lo[pixel], model.fit.hi[pixel]
        slack = 1e-3 * np.maximum(np.abs(lo), np.abs(hi))
        by_range = bool(((centre < lo - slack) | (centre > hi + slack)).any())
        assert plain.solve[i] == by_delta_r
        assert verdict.solve[i] == (by_delta_r or by_box or by_range)
        decided["delta-r"] += by_delta_r and not by_box and not by_range
        decided["box"] += by_box and not by_delta_r and not by_range
        decided["range"] += by_range and not by_box and not by_delta_r
        decided["none"] += not (by_range or by_box or by_delta_r)
    assert min(decided.values()) > 0, f"the scene must exercise every part of the gate alone: {decided}"


def test_margin_tells_how_near_a_test_was():
    solve, margin = beyond(np.array([0.09, 0.11, -0.14, -0.151, 0.0]), CONFIG)
    assert solve.tolist() == [False, True, False, True, False]
    np.testing.assert_allclose(margin, [0.01, 0.01, 0.01, 0.001, 0.1])


def test_a_feature_that_is_zero_for_ever_is_not_near_its_range():
    frame = make_frame(np.zeros((3, 3)), Nx=0.0)
    o = observe(frame, ("Nx",), CONFIG)
    model = Model(9, 3, None)
    model.replace(np.arange(9), fit_pixels([o], np.arange(9), CONFIG), None)
    outside, margin = leaves_range(model, np.arange(9), o)
    assert not outside.any() and margin.min() > 1e-4


@pytest.mark.parametrize("gate", ["delta-r", "radiance"])
@pytest.mark.parametrize("rule", ["frame", "interpolated"])
def test_the_model_is_replaced_by_events_alone(gate, rule):
    frames = random_frames(11, count=4)
    config = DetectorConfig(window=5, gate=gate, event_rule=rule, threshold_on=0.1, threshold_off=0.1)
    detector = ReferenceDetector(config, 11, 9, frames[0].names)
    detector.step(frames[0])
    for frame in frames[1:]:
        before = detector.model.fit.alpha.copy()
        boxes = detector.model.box_brightness.copy()
        batch = detector.step(frame)
        fired = np.zeros((9, 11), dtype=bool)
        fired[batch["y"], batch["x"]] = True
        fired = fired.ravel()
        assert fired.any() and (detector.solved.ravel() & ~fired).any()
        np.testing.assert_array_equal(detector.model.fit.alpha[~fired], before[~fired])
        np.testing.assert_array_equal(detector.model.fit.alpha[fired], detector.level.ravel()[fired])
        assert (detector.model.fit.alpha[fired] != before[fired]).all()
        np.testing.assert_array_equal(detector.model.box_brightness[~fired], boxes[~fired])


def test_nothing_is_solved_once_the_model_fits_again():
    a = make_frame(np.zeros((6, 6)), 0, Depth=1.0)
    b = [make_frame(np.full((6, 6), 0.5), k, Depth=1.0) for k in (1, 2)]
    detector = ReferenceDetector(DetectorConfig(event_rule="frame"), 6, 6, a.names)
    assert len(run(detector, [a, b[0]])) == 36
    detector.step(b[1])
    assert detector.stats.solved == 36


def interpolated(before, after, ref, start_us=1000, end_us=2000, **options):
    step = Step(start_us, end_us, np.array([before]), np.array([after]), np.array([ref]))
    return apply_rule(step, np.array([5]), 4, DetectorConfig(threshold_on=0.2, threshold_off=0.3, **options))


def test_crossing_times_are_linear_and_rounded_up():
    outcome = interpolated(0.1, 0.72, 0.0)
    # 0.2, 0.4 and 0.6 are crossed after 10/62, 30/62 and 50/62 of the step.
    assert outcome.events["t"].tolist() == [1162, 1484, 1807]
    assert outcome.events["on"].all() and set(outcome.events["x"]) == {1} and set(outcome.events["y"]) == {1}
    assert outcome.ref[0] == pytest.approx(0.6)
    assert outcome.margin[0] == pytest.approx(0.08)


def test_off_events_use_their_own_threshold():
    outcome = interpolated(0.0, -0.75, 0.0)
    assert outcome.events["t"].tolist() == [1400, 1800]
    assert not outcome.events["on"].any()
    assert outcome.ref[0] == pytest.approx(-0.6)


def test_level_before_is_clamped_to_the_thresholds():
    """Had it crossed before, it would have fired before: the first crossing is then at the very start."""
    outcome = interpolated(0.35, 0.65, 0.0)
    assert outcome.events["t"].tolist() == [1001, 1445, 1889]
    outcome = interpolated(-5.0, 0.2 + 1e-9, 0.0)
    assert outcome.events["t"].tolist() == [2000]


def test_stamps_never_touch_the_last_frame():
    assert interpolated(0.2, 0.2, 0.0).events["t"].tolist() == [1001]
    assert interpolated(0.2, 0.3, 0.0, end_us=1001).events["t"].tolist() == [1001]


def test_exactly_at_the_threshold_fires():
    for rule in ("frame", "interpolated"):
        assert len(interpolated(0.0, 0.2, 0.0, event_rule=rule).events) == 1
        assert len(interpolated(0.0, -0.3, 0.0, event_rule=rule).events) == 1
        assert len(interpolated(0.0, np.nextafter(0.2, 0), 0.0, event_rule=rule).events) == 0
