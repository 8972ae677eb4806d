"""Launches that are split or merged are the same camera, with light that changes and everything on."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from clsim.sensor.pixel_stages import Defects, Noise, Refractory
from tests.sensor.benchtop import EVERYTHING, Benchtop, planes

RATES = replace(EVERYTHING, noise=replace(EVERYTHING.noise, shot=0.0))
SENSORS = {
    "shot noise": EVERYTHING,
    "shot noise, no rest": replace(EVERYTHING, refractory=Refractory()),
    "rates": RATES,
    # What presets have: pixels that stay calm are moved on together.
    "as presets": replace(
        RATES, noise=Noise(2.0, 2.0, spread_decades=0.2), leak=replace(RATES.leak, parasitic_hz_per_lux=0.0)
    ),
}
WIDTH, HEIGHT = 20, 6
TURNS_US = [round(k * 1e6 / 30) for k in range(7)]
"""Brightness is linear in between."""
LEVELS = np.random.default_rng(4).normal(0, 0.6, (7, HEIGHT, WIDTH)).cumsum(axis=0)
END_US = TURNS_US[-1]
BEGIN_US = 10**9
"""When runs that begin late do."""
FRONT_ERROR = 5e-5
"""Of what the front end gives [natural-log units]; it is allowed twenty times as much."""


def level_at(time_us):
    k = min(np.searchsorted(TURNS_US, time_us, side="right"), len(TURNS_US) - 1)
    share = (time_us - TURNS_US[k - 1]) / (TURNS_US[k] - TURNS_US[k - 1])
    return LEVELS[k - 1] + share * (LEVELS[k] - LEVELS[k - 1])


def shown(settings, times_us, begin_us=0):
    """Return the events, by pixel and time, of steps that end at these times, and what caused them."""
    bench = Benchtop(settings, WIDTH, HEIGHT)
    events = [bench.to(begin_us, LEVELS[0])]
    for t0, t1 in pairwise(times_us):
        turns = [k for k, turn in enumerate(TURNS_US) if t0 < turn < t1]
        rows = [[((TURNS_US[k] - t0) * 1000, LEVELS[k][y, x]) for k in turns] for y, x in np.ndindex(HEIGHT, WIDTH)]
        events.append(bench.to(begin_us + t1, level_at(t1), rows if turns else None))
    found = np.concatenate(events)
    order = np.lexsort((found["t"], found["x"], found["y"]))
    return found[order], np.concatenate(bench.causes)[order]


@cache
def frame_by_frame(name, begin_us=0):
    return shown(SENSORS[name], TURNS_US, begin_us)


def slope_at(events):
    """Return how fast brightness changes at each event [1/µs]."""
    slopes = abs(np.diff(LEVELS, axis=0)) / np.diff(TURNS_US)[:, None, None]
    k = np.searchsorted(TURNS_US[1:-1], events["t"] % BEGIN_US, side="right")
    return slopes[k, events["y"], events["x"]]


def check(found, expected, causes):
    """Raise AssertionError unless the same pixels fire alike, and within a µs, or what the front end may err by."""
    (events, their_causes), (others, other_causes) = found, expected
    assert set(causes) <= set(other_causes) and len(others) > 1000
    np.testing.assert_array_equal(events[["x", "y", "on"]], others[["x", "y", "on"]])
    np.testing.assert_array_equal(their_causes, other_causes)
    # Pixels that stay calm are moved on at once, by steps that a split changes.
    assert (abs(events["t"] - others["t"]) <= 1 + np.minimum(FRONT_ERROR / slope_at(others), 20)).all()


@pytest.mark.parametrize(
    "name", [each if each == "as presets" else pytest.param(each, marks=pytest.mark.slow) for each in SENSORS]
)
@hypothesis_settings(max_examples=6)
@example(splits={98126}, merged=False)
@example(splits={47500}, merged=False)
@given(splits=st.sets(st.integers(1, END_US - 1), max_size=12), merged=st.booleans())
def test_launches_may_be_split_and_merged_anywhere(name, splits, merged):
    times_us = sorted({0, END_US} | splits | (set() if merged else set(TURNS_US)))
    check(shown(SENSORS[name], times_us), frame_by_frame(name), {0, 1, 2})


@pytest.mark.parametrize("name", [pytest.param(each, marks=pytest.mark.slow) for each in SENSORS])
def test_a_pixel_fires_alike_at_every_frame_rate_where_brightness_is_a_line_between_frames(name):
    for fps in (120, 960):
        times_us = [round(k * 1e6 / fps) for k in range(round(0.2 * fps) + 1)]
        check(shown(SENSORS[name], times_us, BEGIN_US), frame_by_frame(name, BEGIN_US), {0, 1, 2})


@pytest.mark.parametrize("name", SENSORS)
def test_dead_pixels_are_silent_and_no_others_whatever_stages_are_on(name):
    """Hot ones, noise, leak and light itself: nothing fires there, and light does elsewhere."""
    bench = Benchtop(replace(SENSORS[name], defects=Defects(hot_share=0.5, dead_share=0.5)), 300)
    events = bench.along([0, 50_000, 100_000, 400_000], [0.0, 2.0, -2.0, -2.0])
    dead = np.isinf(planes(bench, "P")["ON"])
    assert 100 < dead.sum() < 200
    np.testing.assert_array_equal(np.bincount(events["x"], minlength=300) == 0, dead)
