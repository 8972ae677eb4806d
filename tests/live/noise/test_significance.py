"""How likely events are noise, in closed form."""

import math

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.events import EVENT_DTYPE
from clsim.live.noise.significance import EVERY, Significance

ON, OFF = 0.2, 0.3


class Knows:
    """A detector of a pixel in a row for each error."""

    def __init__(self, *errors):
        self.errors = None if errors == (None,) else np.array([errors], np.float32)
        self.asked = 0

    def error(self):
        self.asked += 1
        return self.errors


def events_at(*columns, on):
    events = np.zeros(len(columns), EVENT_DTYPE)
    events["x"], events["on"] = columns, on
    return events


def share_of(detector, events):
    judged = Significance(DetectorConfig("irradiance", threshold_on=ON, threshold_off=OFF))
    for _ in range(EVERY):
        judged.watch(detector, events)
    return judged.noise_share


@pytest.mark.parametrize("z", [0.1, 1.0, 2.5])
def test_the_chance_is_that_of_normal_noise_beyond_the_threshold(z):
    for on, size in ((True, ON), (False, OFF)):
        assert share_of(Knows(size / z), events_at(0, on=on)) == pytest.approx(math.erfc(z / math.sqrt(2)), abs=1e-3)


def test_pixels_without_an_error_or_a_value_are_sure():
    assert share_of(Knows(0.0, np.nan, 1e3), events_at(0, 1, 2, 2, on=True)) == pytest.approx(0.5, abs=1e-3)


def test_a_few_frames_are_judged_and_where_nobody_knows_none():
    detector = Knows(0.1)
    share_of(detector, events_at(0, on=True))
    assert detector.asked == 1
    assert share_of(Knows(None), events_at(0, on=True)) is None
    assert share_of(Knows(0.1), events_at(on=True)) is None


class Sees:
    """A detector of 62 pixels, of which the first and the last are among those that are judged as ideal pixels."""

    def __init__(self, first_error, last_error):
        self.errors = np.full((2, 31), np.nan, np.float32)
        self.errors[0, 0], self.errors[1, 30] = first_error, last_error
        self.levels = np.zeros((2, 31), np.float32)

    def error(self):
        return self.errors

    def level(self):
        return self.levels


def test_with_a_real_sensor_the_events_of_ideal_pixels_are_judged():
    """One rises by three ON thresholds, the other falls by one OFF threshold; what the sensor fires does not count."""
    detector = Sees(ON / 1.0, OFF / 2.0)
    judged = Significance(DetectorConfig("irradiance", threshold_on=ON, threshold_off=OFF), ideal=False)
    detector.levels[0, 0] = np.nan
    for first, last in ((np.nan, 0.0), (1.0, 0.0), (1.0 + 3.1 * ON, 0.0), (1.0 + 3.1 * ON, -1.1 * OFF)):
        detector.levels[0, 0], detector.levels[1, 30] = first, last
        judged.watch(detector, events_at(3, 4, 5, on=True))
    chances = [math.erfc(z / math.sqrt(2)) for z in (1.0, 1.0, 1.0, 2.0)]
    assert judged.noise_share == pytest.approx(np.mean(chances), abs=1e-3)


def test_after_a_new_beginning_ideal_pixels_take_the_next_frame_for_a_first_one():
    detector = Sees(0.1, 0.1)
    judged = Significance(DetectorConfig("irradiance", threshold_on=ON, threshold_off=OFF), ideal=False)
    judged.watch(detector, events_at(on=True))
    judged.restart()
    detector.levels += 1.0
    judged.watch(detector, events_at(on=True))
    assert judged.noise_share is None
