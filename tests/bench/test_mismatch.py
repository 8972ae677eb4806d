"""The equivalent mismatch, against the detector and against cameras whose mismatch is known."""

from __future__ import annotations

import numpy as np
import pytest

from clsim.bench.tradeoff import mismatch
from clsim.bench.tradeoff.mismatch import Levels, MismatchScale, fire, mismatch_scale
from clsim.bench.tradeoff.reference_cache import log_brightness
from clsim.bench.tradeoff.settings import ESIM
from clsim.detect.reference import ReferenceDetector
from clsim.frames import RADIANCE, Frame
from clsim.scene import Sensor
from clsim.score import score

SIZE = (12, 16)
SENSOR = Sensor(threshold_on=0.2, threshold_off=0.15)
TIMES = np.arange(20) * 8_333


def drifting(seed: int = 0) -> Levels:
    """Smooth brightness that rises and falls differently at each pixel."""
    rng = np.random.default_rng(seed)
    phase, speed = rng.uniform(0, 6, (2, *SIZE))
    s = TIMES[:, None, None] * 1e-6
    return Levels((1.2 * np.sin(phase + (5 + speed) * 4 * s) - 1).astype(np.float32), TIMES)


def nominal(sensor: Sensor = SENSOR) -> np.ndarray:
    return np.full((2, *SIZE), [[[sensor.threshold_on]], [[sensor.threshold_off]]])


def test_without_mismatch_it_fires_what_the_float64_detector_fires() -> None:
    levels = drifting()
    config = ESIM.config(SENSOR)
    detector = ReferenceDetector(config, SIZE[1], SIZE[0], RADIANCE)
    seen, expected = [], []
    for k, level in enumerate(levels.values):
        planes = np.repeat(np.exp(level)[None], 3, axis=0)
        seen.append(np.log(np.tensordot([0.2126, 0.7152, 0.0722], planes.astype(float), axes=1)))
        expected.append(detector.step(Frame(planes, RADIANCE, int(TIMES[k]), k)))
    found = fire(Levels(np.array(seen), TIMES), nominal())
    wanted = np.concatenate(expected)
    assert len(wanted) > 1000 and set(wanted["on"].tolist()) == {True, False}
    assert len(found) == len(wanted)
    for name in ("x", "y", "on"):
        assert np.array_equal(found[name], wanted[name])
    assert np.abs(found["t"] - wanted["t"]).max() <= 1


def test_each_pixel_has_its_own_thresholds() -> None:
    """One pixel rises by 1, another falls by 1: thresholds of .3 and .4 are crossed 3 times and twice."""
    values = np.array([[[0.0, 0.0]], [[1.0, -1.0]]], np.float32)
    thresholds = np.array([[[0.3, 9.0]], [[9.0, 0.4]]])
    events = fire(Levels(values, np.array([0, 1000])), thresholds)
    assert events["x"].tolist() == [0, 1, 0, 1, 0] and events["on"].tolist() == [True, False, True, False, True]
    assert events["t"].tolist() == [300, 400, 600, 800, 900]


def test_what_fell_short_of_an_off_event_is_where_a_rise_begins() -> None:
    """It falls by .3, of the .4 that an event takes, and rises to .25: thresholds of .1 are crossed after .4 and .5."""
    values = np.array([0.0, -0.3, 0.25], np.float32)[:, None, None]
    events = fire(Levels(values, np.array([0, 1000, 2000])), np.array([[[0.1]], [[0.4]]]))
    assert events["on"].all() and events["t"].tolist() == [1728, 1910]


def test_a_camera_is_found_to_have_the_mismatch_that_it_has() -> None:
    levels = drifting()
    scale = mismatch_scale(levels, SENSOR, 120.0, 1000)
    assert scale.f1[0] == 1 and all(np.diff(scale.f1) <= 0) and scale.f1[-1] < 0.5
    rng = np.random.default_rng(99)
    for spread in (0.015, 0.04, 0.1):
        camera = nominal() * (1 + spread * rng.standard_normal((2, *SIZE)))
        found = score(fire(levels, camera), fire(levels, nominal()), *SIZE[::-1], 120.0, within_us=(1000,)).within[1000]
        assert scale.equivalent(found.f1) == pytest.approx(spread, rel=0.35)


def test_scores_fall_as_the_spread_grows_where_there_are_few_events_too() -> None:
    """Chance would have .2 score better than .12 here."""
    walk = np.random.default_rng(0).standard_normal((12, 1, 2)).cumsum(axis=0)
    found = mismatch_scale(Levels((0.2 * walk).astype(np.float32), TIMES[:12]), SENSOR, 120.0, 1000).f1
    assert all(np.diff(found) <= 0) and found[-1] < 0.5 < found[-3] == found[-2]


def test_scores_are_read_off_between_what_was_tried() -> None:
    scale = MismatchScale((0.0, 0.1, 0.3), (1.0, 0.5, 0.1))
    assert [scale.equivalent(f1) for f1 in (1.0, 0.75, 0.5, 0.3, 0.1)] == pytest.approx([0, 0.05, 0.1, 0.2, 0.3])
    assert scale.equivalent(0.09) is None


def test_thresholds_stay_positive() -> None:
    cameras = mismatch._cameras(SENSOR, SIZE, 5.0, 0)
    assert not np.array_equal(cameras[0], cameras[1]), "one camera, drawn again"
    assert len(cameras) == mismatch.DRAWS and min(each.min() for each in cameras) == pytest.approx(0.15 * 0.01)
    assert np.std(mismatch._cameras(SENSOR, (100, 100), 0.03, 1)[0][1]) == pytest.approx(0.15 * 0.03, rel=0.05)


def test_brightness_has_the_sensors_scale_and_floor() -> None:
    """Luminance 1, of green alone .7152, and none."""
    planes = np.array([[[1, 0, 0]], [[1, 1, 0]], [[1, 0, 0]]], np.float32)
    level = log_brightness(Frame(planes, RADIANCE), Sensor(scale=3.0, floor=0.5))
    np.testing.assert_allclose(level, np.log([[3.0, 3 * 0.7152, 0.5]]), rtol=1e-5)
