"""How likely events are noise, in closed form."""

import math

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.events import EVENT_DTYPE
from clsim.live.significance import EVERY, Significance

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
