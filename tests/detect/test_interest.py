"""What a detector tells a renderer, against the float64 reference's state."""

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detect.reference import ReferenceDetector
from clsim.detect.reference.irradiance import smoothed_level
from clsim.detector import Detector
from tests.detect.irradiance_scenes import textured_room
from tests.detect.reference_scenes import make_frame, random_frames

METHODS = ["esim", "wlr-esim", "esim-ad", "irradiance"]
ON, OFF = 0.15, 0.12


def config_of(**options):
    return DetectorConfig(**{"window": 5, "threshold_on": ON, "threshold_off": OFF, "precision": "float64", **options})


def pair(config, frame):
    size = (frame.width, frame.height, frame.names)
    return Detector(config, *size), ReferenceDetector(config, *size)


@pytest.mark.parametrize("rule", ["interpolated", "frame"])
@pytest.mark.parametrize("method", METHODS)
def test_distances_and_changes_are_the_references(method, rule):
    """Pixel (2, 3) has no value at first, (5, 6) never one, (7, 8) none in the middle."""
    frames = random_frames(1, count=4)
    for k, (y, x) in ((0, (2, 3)), (2, (7, 8)), *((k, (5, 6)) for k in range(4))):
        frames[k].plane("R")[y, x] = np.nan
    detector, reference = pair(config_of(method=method, event_rule=rule), frames[0])
    had_level = np.zeros(reference.level.shape, dtype=bool)
    for number, frame in enumerate(frames):
        before = reference.level.copy()
        fired = len(detector.step(frame))
        assert fired == len(reference.step(frame))
        interest = detector.interest()
        assert interest.number == number
        has_level = had_level | np.isfinite(frame.plane("R"))
        to_on, to_off = reference.ref + ON - reference.level, reference.level - (reference.ref - OFF)
        change = np.where(had_level, reference.level - before, 0.0)
        for got, expected in ((interest.to_on, to_on), (interest.to_off, to_off), (interest.change, change)):
            assert got.dtype == np.float32 and got.shape == (frame.height, frame.width)
            np.testing.assert_allclose(got, np.where(has_level, expected, np.nan), rtol=0, atol=2e-6)
        assert np.nanmin(interest.to_on) >= -1e-6 and np.nanmin(interest.to_off) >= -1e-6
        assert (fired > 0 and (change != 0).any()) == (number > 0)
        assert np.isnan(interest.stderr[5, 6]) and (method == "irradiance" or np.nanmax(interest.stderr) == 0)
        had_level = has_level
    detector.close()


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_the_standard_error_is_that_of_the_frame(precision):
    """From the first frame on, which was smoothed before anybody had asked."""
    config = config_of(method="irradiance", precision=precision)
    frames = [textured_room(seed) for seed in range(3)]
    detector, _ = pair(config, frames[0])
    for k, frame in enumerate(frames):
        frame.time_us = k
        detector.step(frame)
        expected = smoothed_level(frame, config)[1]
        assert expected.max() > 0.1
        np.testing.assert_allclose(detector.interest().stderr, expected, rtol=1e-3, atol=1e-5)


def test_maps_stay_what_they_were():
    """A renderer reads a map while the next is made."""
    frames = random_frames(2)
    detector, _ = pair(config_of(method="esim"), frames[0])
    detector.step(frames[0])
    first = detector.interest()
    kept = [plane.copy() for plane in (first.to_on, first.to_off, first.change, first.stderr)]
    detector.step(frames[1])
    detector.interest()
    for plane, copy in zip((first.to_on, first.to_off, first.change, first.stderr), kept, strict=True):
        np.testing.assert_array_equal(plane, copy)


def test_planes_that_begin_to_vary_do_not_lose_the_level_before():
    frames = random_frames(3, count=5)
    for frame in frames[:3]:
        for name in ("Nx", "Albedo.R"):
            frame.plane(name)[...] = 0.5
    detector, _ = pair(config_of(), frames[0])
    before = None
    for frame in frames:
        detector.step(frame)
        change, level = detector.interest().change, detector.level()
        if before is not None:
            np.testing.assert_allclose(change, level - before, rtol=0, atol=2e-6)
            assert (change != 0).mean() > 0.5
        before = level
    assert "Nx" in detector.features


def test_nothing_has_changed_after_a_reset():
    frames = random_frames(4)
    detector, _ = pair(config_of(method="esim"), frames[0])
    for frame in frames[:2]:
        detector.step(frame)
        changed = detector.interest().change
    assert (changed != 0).all()
    detector.reset()
    detector.step(frames[2])
    interest = detector.interest()
    assert interest.number == 2 and (interest.change == 0).all()
    np.testing.assert_allclose(interest.to_on, ON, rtol=0, atol=1e-6)


def test_asking_changes_no_event():
    frames = random_frames(5)
    for method in METHODS:
        asked, silent = (pair(config_of(method=method), frames[0])[0] for _ in range(2))
        for frame in frames:
            first, second = asked.step(frame), silent.step(frame)
            np.testing.assert_array_equal(first, second)
            asked.interest()
        assert asked.stats.events > 0


def test_there_is_no_map_before_the_first_frame():
    frame = make_frame(np.zeros((3, 3)))
    detector, _ = pair(config_of(method="esim"), frame)
    with pytest.raises(ValueError, match="no frame yet"):
        detector.interest()
