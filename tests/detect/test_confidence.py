"""An event whose change is not significant waits: against the rule written out in numpy."""

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detect.reference import ReferenceDetector
from clsim.detector import Detector, check_sensor
from clsim.errors import InputError
from clsim.sensor import Specimen
from clsim.sensor.presets import load_sensor
from tests.detect.irradiance_scenes import textured_room

ON, OFF = 0.15, 0.12


def steps(confidence, asks=True):
    """Return the events, levels and standard errors, if they are asked for, of a few noisy frames, with their times."""
    frames = [textured_room(seed) for seed in range(5)]
    config = DetectorConfig("irradiance", threshold_on=ON, threshold_off=OFF, window=5, confidence=confidence)
    detector = Detector(config, frames[0].width, frames[0].height, frames[0].names)
    found = []
    for k, frame in enumerate(frames):
        frame.time_us = 1000 * k
        events = detector.step(frame).copy()
        stderr = np.array(detector.interest().stderr) if asks else None
        assert not asks or np.array_equal(detector.error(), stderr)
        found.append((events, detector.level(), stderr))
    detector.close()
    return found


@pytest.mark.parametrize("confidence", [0.0, 1.0, 4.0])
def test_a_pixel_fires_once_its_change_is_so_many_standard_errors(confidence):
    reference = None
    for events, level, error in steps(confidence):
        if reference is None:
            reference = level.astype(float)
            continue
        change = level - reference
        size = np.where(change > 0, ON, OFF)
        count = np.where(np.abs(change) >= confidence * error, np.floor(np.abs(change) / size), 0)
        fired = np.zeros(level.shape)
        np.add.at(fired, (events["y"], events["x"]), 1)
        # Where float32 and float64 may part, at a threshold, nothing is said.
        clear = np.abs(np.abs(change) / size - np.round(np.abs(change) / size)) > 1e-4
        clear &= np.abs(np.abs(change) - confidence * error) > 1e-4
        assert clear.mean() > 0.9
        np.testing.assert_array_equal(fired[clear], count[clear])
        sign = np.where(np.where(clear, count, fired) > 0, np.sign(change), 0)
        reference += sign * np.where(clear, count, fired) * size


def test_more_confidence_fires_less():
    counts = [sum(len(events) for events, _, _ in steps(confidence)) for confidence in (0.0, 2.0, 8.0)]
    assert counts[0] > counts[1] > counts[2] > 0


def test_events_do_not_hang_on_whether_errors_are_asked_for():
    for (events, *_), (alone, *_) in zip(steps(2.0), steps(2.0, asks=False), strict=True):
        np.testing.assert_array_equal(events, alone)


def test_it_is_refused_where_it_would_do_nothing():
    assert DetectorConfig("esim", confidence=2.0).unused() == ("confidence",)
    assert DetectorConfig("irradiance", confidence=2.0).unused() == ()
    with pytest.raises(InputError, match="`confidence` is for the ideal sensor, but `sensor` is davis346"):
        check_sensor(DetectorConfig("irradiance", confidence=0.01), Specimen(load_sensor("davis346")))
    with pytest.raises(InputError, match=r"the float64 reference has no `confidence`: expected 0, got 0\.01"):
        ReferenceDetector(DetectorConfig("irradiance", confidence=0.01), 4, 3, ())


@pytest.mark.parametrize("value", [-1.0, 100.5, float("nan"), float("inf")])
def test_confidence_is_a_number_of_standard_errors(value):
    with pytest.raises(InputError, match=r"`confidence` must be (from 0 to 100|a finite number), got"):
        DetectorConfig("irradiance", confidence=value)
