"""What a pixel with all stages but noise fires accounts for all that its front end gave it, and for all that leaked."""

import math
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from clsim.sensor import SensorSettings
from clsim.sensor.pixel_stages import Defects, Delay, FrontEnd, Leak, Refractory, Threshold
from clsim.sensor.reference.front import follow
from clsim.sensor.reference.pixel import fire
from tests.sensor.benchtop import Benchtop, planes

STEP_US = 4000
LUX = 100.0
FRONT = FrontEnd(dark_lux=2.0, receptor_hz_per_lux=3.0, follower_hz=1000.0)
REFERENCE = {"dark": 0.02, "receptor_s": 1 / (2 * math.pi * 300), "follower_s": 1 / (2 * math.pi * 1000)}
ALL_BUT_NOISE = SensorSettings(
    threshold=Threshold(mismatch=0.03),
    front_end=FRONT,
    leak=Leak(30.0, 0.25, parasitic_hz_per_lux=0.2),
    defects=Defects(hot_share=0.2, hot_hz=300.0, dead_share=0.1),
    delay=Delay(1e-6, 1e-6),
)
FRONT_ERROR = 1e-3
"""By which the front end may err [natural-log units]."""
BENT_LATE = 1.5e-3
"""The same within a piece that begins straight and bends later."""
PIXELS = 24
PATHS = st.lists(
    st.tuples(st.floats(-1.5, 1.5), st.lists(st.tuples(st.integers(1, 3_999_999), st.floats(-1.5, 1.5)), max_size=2)),
    min_size=1,
    max_size=4,
)


def points_of(path, step_us=STEP_US):
    """Return the times [s] and levels of a path of (level at the step's end, knots in it), which begins at 0."""
    points = [(0.0, 0.0)]
    for k, (level, knots) in enumerate(path):
        points += [((k * step_us + t * 1e-3) * 1e-6, knot) for t, knot in sorted(dict(knots).items())]
        points.append((step_us * (k + 1) * 1e-6, level))
    return points


def walk(bench, path, step_us=STEP_US):
    """Return the events along a path that all pixels see."""
    rows = [[sorted(dict(knots).items())] * bench.grid.width for _, knots in path]
    ends = [(step_us * (k + 1), level) for k, (level, _) in enumerate(path)]
    return np.concatenate([bench.to(end, level, row) for (end, level), row in zip(ends, rows, strict=True)])


def seen(bench):
    """Return what each pixel's front end gives now, from what it gave when its line began."""
    state, now_s = planes(bench, "S"), bench.time_us * 1e-6

    @cache
    def end(at, level, slope, receptor, follower):
        if at * 1e-9 >= now_s:
            return follower
        points = [(at * 1e-9, level), (now_s, level + slope * (now_s - at * 1e-9))]
        return follow(points, **REFERENCE, start=(receptor, follower))[-1][1]

    names = "INPUT_SINCE", "INPUT_LEVEL", "INPUT_SLOPE", "RECEPTOR", "FOLLOWER"
    return np.array([end(*each) for each in zip(*(state[name].tolist() for name in names), strict=True)])


def compared(bench):
    """Return what each pixel compares with its thresholds now."""
    state, now_ns = planes(bench, "S"), bench.time_us * 1000
    leaked = state.get("LEAK", 0.0) * (now_ns - state["SINCE"]) * 1e-9
    return np.where(state["SINCE"] > now_ns, 0.0, seen(bench) - state["REFERENCE"] + leaked)


def check_balance(path, step_us=STEP_US):
    """Raise AssertionError unless what fires along a path accounts for what the front end gave and what leaked."""
    bench = Benchtop(ALL_BUT_NOISE, PIXELS, lux=LUX)
    bench.to(0, 0.0)
    own, before = planes(bench, "P"), compared(bench)
    events = walk(bench, path, step_us)
    alive = np.isfinite(own["ON"])
    assert not (~alive[events["x"]]).any()
    on, off = (np.bincount(events["x"][events["on"] == rises], minlength=PIXELS)[alive] for rises in (True, False))
    points = points_of(path, step_us)
    filtered = follow(points, **REFERENCE)
    light_s = sum(
        (t1 - t0) * math.exp(a) * (math.expm1(b - a) / (b - a) if abs(b - a) > 1e-9 else 1.0)
        for (t0, a), (t1, b) in pairwise(points)
    )
    parasitic = ALL_BUT_NOISE.leak.parasitic_hz_per_lux * LUX * 0.2
    leaked = own["LEAK"] * points[-1][0] + own["LEAK_FACTOR"] * parasitic * light_s
    given = filtered[-1][1] - filtered[0][1] + leaked[alive]
    fired = own["ON"][alive] * on - own["OFF"][alive] * off
    left = (compared(bench) - before)[alive]
    # Exact but for pieces that the front end takes as linear; and what is left is less than a threshold, by as much.
    assert fired + left == pytest.approx(given, abs=2e-3)
    end = compared(bench)[alive]
    assert (end < own["ON"][alive] + FRONT_ERROR).all() and (end > -own["OFF"][alive] - FRONT_ERROR).all()


@pytest.mark.slow
@hypothesis_settings(max_examples=25)
@given(PATHS)
# A level that comes to a threshold within a piece, at whose end it is below again.
@example([(-1.35546875, [(32727, 0.0)]), (-1.3583683830556597, [(1, 0.0)]), (1.493525659143387, [])])
# Bright light that hardly changes, and lets much leak.
@example([(1.5, [(34012, 0.0)]), (1.5, [(34012, 0.0)]), (1.493525659143387, [])])
def test_thresholds_times_events_are_what_the_front_end_gave_and_what_leaked(path):
    check_balance(path)


@pytest.mark.parametrize(("step_us", "drift", "noise"), [(200, 0.003, 0.001), (500, -0.004, 0.0003)])
def test_pixels_that_mostly_stay_calm_account_for_all_of_it_too(step_us, drift, noise):
    moves = drift + noise * np.random.default_rng(5).normal(size=40)
    check_balance([(level, []) for level in moves.cumsum().tolist()], step_us)


@pytest.mark.parametrize("slope", [0.02, -0.05, 0.5])
def test_light_that_changes_slowly_lets_leak_what_it_should(slope):
    step_us = 100_000
    check_balance([(1.0 + slope * step_us * 1e-6 * k, []) for k in range(8)], step_us)


@hypothesis_settings(max_examples=25)
@given(PATHS, st.sampled_from([0.0, 700.0]))
# From 0 to -0 the slope is -0, and the next piece seemed to end infinitely long ago.
@example([(-1.0, [(2717918, 0.0)]), (-0.9, []), (-0.0, [(1, 0.0)])], 0.0)
# Where a piece begins the output is straight, and bends soon, since dark light makes the receptor slower.
@example([(-0.58203125, []), (-1.09375, [])], 0.0)
# The same, where it makes the last turn just reach a threshold.
@example([(-1.484375, []), (0.0, [(1, 1.25), (29022, -1.253)]), (-1.27734375, [])], 0.0)
def test_filtered_pixels_fire_as_the_reference_does(path, rest_us):
    bench = Benchtop(replace(SensorSettings(front_end=FRONT), refractory=Refractory(rest_us)), 1, lux=LUX)
    bench.to(0, 0.0)
    found = walk(bench, path)
    filtered = follow(points_of(path), **REFERENCE)
    if rest_us == 0:
        assert seen(bench)[0] == pytest.approx(filtered[-1][1], abs=1e-3)
    expected, _ = fire(filtered, 0.2, 0.25, rest_s=rest_us * 1e-6)
    if len(found) != len(expected):
        # A turn that just reaches a threshold, or does not: the reference of one a little higher or lower agrees.
        counts = [len(fire(filtered, 0.2 + d, 0.25 + d, rest_s=rest_us * 1e-6)[0]) for d in (-BENT_LATE, BENT_LATE)]
        assert min(counts) <= len(found) <= max(counts)
        return
    np.testing.assert_array_equal(found["on"], [on for _, on in expected])
    # By how much the front end may err, where it is that steep.
    slopes = np.abs(np.gradient(*np.array(filtered).T[::-1]))
    times = np.array([t for t, _ in expected])
    steep, at_release = (
        np.interp(after, [t for t, _ in filtered], slopes) for after in (times, times + rest_us * 1e-6)
    )
    errors = abs(found["t"] * 1e-6 - times)
    # An event that is early ends its rest early, where the level, which is the next reference, may be steep.
    carried = np.append(0.0, errors * at_release)[:-1] if rest_us else 0.0
    assert (errors < 1.5e-6 + (BENT_LATE + carried) / np.maximum(steep, 1.0)).all()
