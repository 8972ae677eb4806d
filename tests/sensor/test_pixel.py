"""Thresholds, leak, noise rates, defects, rest and delay against closed forms and a float64 reference."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from scipy import stats

from clsim.events import CAUSES
from clsim.opencl.workplace import _read
from clsim.sensor import IdealPixels, SensorSettings, Thresholds, pixel
from clsim.sensor.pixel_stages import Delay, Refractory, Threshold
from clsim.sensor.reference.pixel import fire
from tests.sensor.benchtop import SPLITS, Benchtop, intervals_us, planes, rates, with_stages

ON, OFF = 0.2, 0.25


def test_leak_fires_on_events_at_its_rate_from_phases_that_differ():
    bench = Benchtop(with_stages(leak={"hz": 4.0}), 1000)
    bench.to(0, 0.0)
    events = bench.to(10_000_000, 0.0)
    assert events["on"].all() and set(np.concatenate(bench.causes)) == {CAUSES.index("leak")}
    # One threshold at its rate: all intervals are alike (a stamp is a whole µs), and no first burst.
    assert set(intervals_us(events)) <= {249_999, 250_000, 250_001}
    first = np.array([events["t"][events["x"] == x].min() for x in range(1000)])
    assert stats.kstest(first / 250_000, "uniform").pvalue > 1e-3


def test_leaks_that_noise_takes_back_begin_as_they_go_on():
    # Of waits for noise of 2 + 2 Hz, each holds as many leaks of 2 Hz as whole half seconds: 4 / (e^2 - 1) a second.
    settings = with_stages(leak={"hz": 2.0}, noise={"on_hz": 2.0, "off_hz": 2.0})
    bench = Benchtop(settings, 20_000)
    bench.to(0, 0.0)
    for _ in range(2):
        on, off = rates(bench.to(bench.time_us + 100_000, 0.0), 20_000, 0.1)
        assert on == pytest.approx(2 + 4 / math.expm1(2), rel=0.06) and off == pytest.approx(2, rel=0.07)


def test_a_falling_ramp_slower_than_the_leak_still_fires_on():
    # 4 Hz of 0.2 is 0.8 ln/s; 0.5 of it is taken away.
    bench = Benchtop(with_stages(leak={"hz": 4.0}), 200)
    bench.to(0, 0.0)
    events = bench.to(20_000_000, -10.0)
    on, off = rates(events, 200, 20.0)
    assert off == 0 and on == pytest.approx(0.3 / ON, abs=1 / 20)


def test_leak_rates_are_lognormal():
    bench = Benchtop(with_stages(leak={"hz": 50.0, "spread_decades": 0.25}), 3000)
    events = bench.along([0, 2_000_000, 4_000_000], [0.0, 0.0, 0.0])
    decades = np.log10(np.bincount(events["x"], minlength=3000) / 4.0)
    assert np.mean(decades) == pytest.approx(math.log10(50), abs=0.02)
    assert np.std(decades) == pytest.approx(0.25, abs=0.01)


def test_light_adds_to_the_leak():
    bench = Benchtop(with_stages(leak={"hz": 1.0, "parasitic_hz_per_lux": 0.05}), 1000)
    bench.to(0, 0.0)
    assert rates(bench.to(2_000_000, 0.0), 1000, 2.0)[0] == pytest.approx(6, abs=0.1)  # 100 lux
    level = math.log(2)
    bench.to(2_000_001, level)
    assert rates(bench.to(4_000_000, level), 1000, 2.0)[0] == pytest.approx(11, abs=0.1)
    assert (bench.causes[1] == CAUSES.index("leak")).all() and (bench.causes[3] == CAUSES.index("leak")).mean() > 0.95
    # While light changes, so does the leak, and what has leaked stays so: up and down by half a threshold, which alone
    # fires nothing.
    slow = Benchtop(with_stages(leak={"hz": 1.0, "parasitic_hz_per_lux": 0.05}), 500)
    slow.to(0, 0.0)
    events = slow.along([10_000 * k for k in range(1, 201)], [0.05 * (0, 1, 2, 1)[k % 4] for k in range(1, 201)])
    lux = 100 * np.expm1(0.1) / 0.1
    assert rates(events, 500, 2.0)[0] == pytest.approx(1 + 0.05 * lux, rel=0.03)
    assert (np.concatenate(slow.causes) == CAUSES.index("leak")).mean() > 0.9


def test_noise_rates_are_poisson():
    bench = Benchtop(with_stages(noise={"on_hz": 30.0, "off_hz": 10.0}), 2000)
    bench.to(0, 0.0)
    events = np.concatenate([bench.to(t, 0.0) for t in range(100_000, 1_000_001, 100_000)])
    on, off = rates(events, 2000, 1.0)
    assert on == pytest.approx(30, abs=4 * math.sqrt(30 / 2000)) and off == pytest.approx(
        10, abs=4 * math.sqrt(10 / 2000)
    )
    counts = np.bincount(events["x"], minlength=2000)
    assert counts.var() / counts.mean() == pytest.approx(1, abs=0.15)
    waits = intervals_us(events)
    # Of all intervals in a second the long ones are cut off: those below 50 ms are not.
    assert stats.kstest(waits[waits < 50_000] / 1e6, stats.truncexpon(b=0.05 * 40, scale=1 / 40).cdf).pvalue > 1e-3
    assert set(np.concatenate(bench.causes)) == {CAUSES.index("shot")}


def test_noise_rates_follow_light():
    # Level 0 is 100 lux: halfway, in the log, between 10 and 1000.
    settings = with_stages(noise={"on_hz": (40.0, 20.0), "off_hz": (20.0, 0.0), "lux": (10.0, 1000.0)})
    for level, expected in ((-5.0, (40, 20)), (0.0, (30, 10)), (5.0, (20, 0))):
        bench = Benchtop(settings, 2000)
        bench.to(0, level)
        assert rates(bench.to(1_000_000, level), 2000, 1.0) == pytest.approx(expected, abs=0.6)


def test_thresholds_differ_from_pixel_to_pixel_and_stay():
    # The share of pixels that a step reaches is the distribution of thresholds.
    for step, share in ((0.17, stats.norm.cdf(-1)), (0.2, 0.5), (0.23, stats.norm.cdf(1))):
        bench = Benchtop(with_stages(threshold={"mismatch": 0.03}), 4000)
        bench.to(0, 0.0)
        fired = set(bench.to(1000, step)["x"])
        assert len(fired) / 4000 == pytest.approx(share, abs=0.03)
        bench.to(2000, 0.0)
        again = Benchtop(with_stages(threshold={"mismatch": 0.03}), 4000)
        again.to(0, 1.0)
        assert set(again.to(3000, 1.0 + step)["x"]) == fired


def test_on_a_ramp_the_mean_of_pixels_is_of_their_thresholds_and_not_of_the_mean_threshold():
    # E[N] = (g T / θ)(1 + σ² / θ²), and half an event less for what is left at the end.
    bench = Benchtop(with_stages(threshold={"mismatch": 0.02}), 4000)
    bench.to(0, 0.0)
    events = bench.to(1_000_000, 80.0)
    assert len(events) / 4000 == pytest.approx(80 / ON * (1 + (0.02 / ON) ** 2) - 0.5, rel=0.005)


def test_a_hot_pixel_rests_too():
    # 1 / (rest + threshold / leak), 100 Hz of the nominal threshold.
    settings = with_stages(defects={"hot_share": 1.0, "hot_hz": 100.0, "hot_spread_decades": 0.0})
    bench = Benchtop(replace(settings, refractory=Refractory(500.0)), 100)
    bench.to(0, 0.0)
    assert set(intervals_us(bench.to(1_000_000, 0.0))) <= {10_499, 10_500, 10_501}


def test_work_items_of_another_size_are_the_same_camera(monkeypatch):
    found = []
    for chunk in (64, 24):
        monkeypatch.setattr(pixel, "_CHUNK", chunk)
        bench = Benchtop(BUSY, 41, 30)
        found.append(bench.along([0, 100_000, 200_000], [0.0, 1.0, -1.0]))
    assert len(found[0]) > 5000
    np.testing.assert_array_equal(*found)


def test_what_pixels_keep_for_ever_is_drawn_apart():
    settings = with_stages(
        threshold={"mismatch": 0.02},
        leak={"hz": 2.0, "spread_decades": 0.2},
        noise={"on_hz": 1.0, "off_hz": 1.0, "spread_decades": 0.2},
        defects={"hot_share": 0.3, "hot_hz": 1e-9},
    )
    own = planes(Benchtop(settings, 4000), "P")
    names = ("ON", "OFF", "LEAK", "RATE_WAIT", "HOT")
    between = np.corrcoef([own[name] for name in names])
    assert abs(between[~np.eye(len(names), dtype=bool)]).max() < 5 / math.sqrt(4000)


def test_no_threshold_is_less_than_a_tenth_of_the_nominal_one():
    own = planes(Benchtop(with_stages(threshold={"mismatch": 0.2}), 4000), "P")
    assert own["ON"].min() == pytest.approx(0.1 * ON) and own["OFF"].min() == pytest.approx(0.1 * OFF)


def test_no_two_draws_share_a_number():
    # Of one pixel and time they would be one number: noise that passes one threshold would pass the other.
    first = {name: int(number) for name, number in re.findall(r"#define DRAW_(\w+) +(\d+)", _read("sensor/random.clh"))}
    numbers = [at + k for name, at in first.items() for k in range(3 if name.startswith("PASSAGE") else 1)]
    assert len(numbers) > 15 and len(numbers) == len(set(numbers)) and max(numbers) == first["ARRIVAL"]


def test_a_pixel_is_the_same_in_an_image_of_another_size():
    settings = with_stages(
        threshold={"mismatch": 0.05}, defects={"hot_share": 0.05, "dead_share": 0.05, "hot_hz": 50.0}
    )
    found = []
    for width, height in ((40, 30), (64, 31)):
        bench = Benchtop(settings, width, height)
        bench.to(0, 0.0)
        events = bench.to(100_000, 1.0)
        found.append(events[(events["x"] < 40) & (events["y"] < 30)])
    np.testing.assert_array_equal(*found)
    other = Benchtop(settings, 40, 30, seed=2)
    other.to(0, 0.0)
    assert not np.array_equal(other.to(100_000, 1.0), found[0])


def test_hot_and_dead_pixels_are_as_many_as_said():
    settings = with_stages(defects={"hot_share": 0.02, "hot_hz": 100.0, "hot_spread_decades": 0.1, "dead_share": 0.05})
    bench = Benchtop(settings, 200, 100)
    bench.to(0, 0.0)
    events = bench.to(1_000_000, 0.0)
    counts = np.zeros((100, 200), int)
    np.add.at(counts, (events["y"], events["x"]), 1)
    hot = (counts > 0).sum()
    # A pixel that is both is dead.
    assert abs(hot - 20_000 * 0.02 * 0.95) < 4 * math.sqrt(400)
    assert np.median(counts[counts > 0]) == pytest.approx(100, rel=0.05)
    assert np.log10(counts[counts > 0]).std() == pytest.approx(0.1, rel=0.2)
    assert set(np.concatenate(bench.causes)) == {CAUSES.index("hot")}
    silent = 20_000 - len(np.unique(bench.to(1_010_000, 1.0)[["x", "y"]]))
    assert abs(silent - 1000) < 4 * math.sqrt(1000)


LEVELS = st.lists(st.floats(-2, 2), min_size=1, max_size=6)
KNOTTED = st.lists(
    st.tuples(st.floats(-2, 2), st.lists(st.tuples(st.integers(1, 3_999_999), st.floats(-2, 2)), max_size=3)),
    min_size=1,
    max_size=5,
)


@hypothesis_settings(max_examples=40)
@given(KNOTTED)
def test_events_account_for_all_change_of_brightness_and_all_leak(steps):
    # θ_on N_on - θ_off N_off is what brightness rose by and the reference leaked, within a threshold of either kind:
    # the leak's phase is not known.
    bench = Benchtop(with_stages(leak={"hz": 300.0}), 3)
    bench.to(0, 0.0)
    on = off = np.zeros(3)
    for k, (level, knots) in enumerate(steps):
        row = sorted(dict(knots).items())
        events = bench.to(4000 * (k + 1), level, [row, [], row])
        on = on + np.bincount(events["x"][events["on"]], minlength=3)
        off = off + np.bincount(events["x"][~events["on"]], minlength=3)
    change = steps[-1][0] + 300.0 * ON * 4e-3 * len(steps)
    balance = ON * on - OFF * off - change
    assert (balance > -ON).all() and (balance < ON + OFF).all()


RESTING = replace(with_stages(), refractory=Refractory(500.0), delay=Delay(1e-9, 0.0))


def test_a_ramp_fires_once_a_threshold_and_rest():
    bench = Benchtop(RESTING, 1)
    bench.to(0, 0.0)
    events = bench.to(100_100, 20.02)  # 0.2 ln/ms
    assert intervals_us(events) == pytest.approx(1500, abs=1) and len(events) == 67


def test_a_real_pixel_walks_knots():
    # Up to 1.1 and back within a step: neither end shows it.
    bench = Benchtop(RESTING, 3)
    bench.to(0, 0.0)
    events = bench.to(4000, 0.0, [[], [(1_000_000, 1.1)], [(2_000_000, 0.3), (2_000_001, 0.3)]])
    told = [[(int(e["t"]), bool(e["on"])) for e in events if e["x"] == x] for x in range(3)]
    # After 182 µs, and, at the release, from 0.75 on after as much; then down from 1.1 with the release before the top.
    assert told[0] == [] and told[2] == [(1334, True), (3834, False)]
    expected, _ = fire([(0.0, 0.0), (1e-3, 1.1), (4e-3, 0.0)], ON, OFF, rest_s=500e-6)
    assert [on for _, on in told[1]] == [on for _, on in expected] == [True, True, False, False]
    assert [t for t, _ in told[1]] == [math.ceil(t * 1e6) for t, _ in expected]


@pytest.mark.parametrize("sign", [1, -1], ids=["ON", "OFF"])
def test_a_flash_is_capped_and_counted(sign):
    # 30 ln/ms in two parts of each step: 1000 events of a pixel are written, and the others counted.
    sizes = dict(zip(("on", "off")[::sign], (1e-3, 7e-4), strict=True))
    bench = Benchtop(replace(SensorSettings(), threshold=Threshold(mismatch=1e-12)), 130, **sizes)
    bench.to(0, 0.0)
    flash = np.zeros(130)
    flash[[64, 129]] = sign * 0.9005, sign * 3.0005
    events = bench.to(1000, flash, [*[[]] * 129, [(500_000, sign * 1.5002)]])
    fired = bench.fired
    assert np.bincount(events["x"], minlength=130)[[63, 64, 65, 129]].tolist() == [0, 900, 0, 1000]
    assert fired.capped == 2000 and fired.most_crossings == 3000 and fired.many_crossings == 2
    # Nothing is owed.
    assert len(bench.to(2000, flash)) == 0 and (events["on"] == (sign > 0)).all()


def test_no_pixel_fires_faster_than_its_rest_allows():
    bench = Benchtop(RESTING, 4)
    bench.to(0, 0.0)
    waits = intervals_us(bench.along([50_000, 100_000], [900.0, -900.0]))
    assert waits.min() >= 500 and waits.mean() < 520


@pytest.mark.parametrize(("latency_us", "mean_us", "deviation_us"), [(100.0, 100.0, 10.0), (0.0, 3.99, 5.84)])
def test_events_are_late_by_latency_and_jitter(latency_us, mean_us, deviation_us):
    """Where jitter is all there is, half of it is cut off: no event comes before its cause."""
    bench = Benchtop(replace(RESTING, delay=Delay(latency_us, 10.0)), 4000)
    late = bench.along([0, 953, 2000], [0.0, 0.20013, 0.20013])["t"] - 952.4
    assert len(late) == 4000
    assert late.mean() - 0.5 == pytest.approx(mean_us, abs=0.7) and late.std() == pytest.approx(deviation_us, abs=0.5)


@hypothesis_settings(max_examples=40)
@given(LEVELS, st.sampled_from([0.0, 0.8]), st.booleans())
def test_kernels_fire_as_the_reference_does(levels, leak, rests):
    settings = with_stages(leak={"hz": leak / ON}) if leak else with_stages()
    bench = Benchtop(replace(settings, refractory=RESTING.refractory, delay=RESTING.delay) if rests else settings, 1)
    bench.to(0, 0.0)
    # The reference is known after an event, which this ramp has.
    fired = bench.to(1_000_000, -2.0)["t"][-1]
    times_us = [1_000_000 + 4000 * (k + 1) for k in range(len(levels))]
    found = bench.along(times_us, levels)
    rest_s = 500e-6 if rests else 0.0
    begin_s = fired * 1e-6 + rest_s
    points = [(begin_s, -2.0 * begin_s), (1.0, -2.0)]
    points += [(t * 1e-6, level) for t, level in zip(times_us, levels, strict=True)]
    less, expected, more = (fire(points, ON + d, OFF + d, leak=leak, rest_s=rest_s)[0] for d in (-1e-6, 0, 1e-6))
    # Where brightness turns or stays at a threshold, rounding decides.
    assume([on for _, on in less] == [on for _, on in more])
    assume(all(abs(early - late) < 1e-5 for (early, _), (late, _) in zip(less, more, strict=True)))
    assert abs(len(found) - len(expected)) <= 1
    for event, (seconds, on) in zip(found, expected, strict=False):
        assert bool(event["on"]) == on and -1.5 <= event["t"] - seconds * 1e6 <= 2.5


BUSY = replace(
    with_stages(
        threshold={"mismatch": 0.03},
        leak={"hz": 3.0, "spread_decades": 0.3},
        noise={"on_hz": 4.0, "off_hz": 6.0, "spread_decades": 0.2},
        defects={"hot_share": 0.05, "dead_share": 0.05},
    ),
    refractory=Refractory(500.0),
    delay=Delay(30.0, 10.0),
)


@pytest.mark.parametrize("begin_us", [pytest.param(0, marks=pytest.mark.slow), 10**9])
def test_what_noise_fires_is_the_same_bits_at_every_frame_rate(begin_us):
    found = {}
    for name, times_us in SPLITS.items():
        bench = Benchtop(BUSY, 30, 20)
        found[name] = bench.along([begin_us + t for t in times_us], [0.3] * len(times_us)), np.concatenate(bench.causes)
    events, causes = found["30 fps"]
    assert len(events) > 2000 and set(causes) == {1, 2, 3}
    for other, other_causes in found.values():
        np.testing.assert_array_equal(other, events)
        np.testing.assert_array_equal(other_causes, causes)


def test_after_a_thousand_seconds_pixels_are_as_exact_as_at_once():
    times_us, levels = [0, 20_000, 40_000], [0.0, 1.5, -0.7]
    told = []
    for begin_us in (0, 10**9):
        events = Benchtop(RESTING, 5).along([begin_us + t for t in times_us], levels)
        told.append([(int(e["t"]) - begin_us, int(e["x"]), bool(e["on"])) for e in events])
    assert told[0] == told[1] and len(told[0]) > 50


def test_steps_on_the_way_change_nothing_where_brightness_is_a_line():
    whole = Benchtop(BUSY, 30, 20)
    parts = Benchtop(BUSY, 30, 20)
    times_us = SPLITS["at random"]
    one = whole.along([0, 400_000], [0.0, 2.0])
    many = parts.along(times_us, [2.0 * t / 400_000 for t in times_us])
    assert len(one) == len(many) > 4000
    one, many = (np.sort(each, order=["y", "x", "t"]) for each in (one, many))
    np.testing.assert_array_equal(one["on"], many["on"])
    assert abs(one["t"] - many["t"]).max() <= 1


def test_without_stages_a_pixel_fires_as_the_ideal_one_does():
    generator = np.random.default_rng(5)
    bench = Benchtop(SensorSettings(), 200)
    ideal = IdealPixels(bench.place, Thresholds(ON, OFF))
    real_events, ideal_events = [], []
    step = bench.pixels.step

    def both(path):
        ideal_events.append(ideal.step(path).events)
        return step(path)

    bench.pixels.step = both
    for k in range(10):
        rows = [
            sorted((int(t), float(v)) for t, v in zip(*generator.uniform(1, 4e6, (2, n)), strict=True))
            for n in generator.integers(0, 3, 200)
        ]
        rows = [[(t, v / 4e6) for t, v in row] for row in rows]
        real_events.append(bench.to(4000 * k, generator.uniform(-1, 1, 200), rows if k else None))
    real, expected = (np.sort(np.concatenate(each), order=["x", "t"]) for each in (real_events, ideal_events))
    assert len(real) == len(expected) > 5000
    np.testing.assert_array_equal(real[["x", "on"]], expected[["x", "on"]])
    assert abs(real["t"] - expected["t"]).max() <= 1


def test_pixels_that_fire_very_often_take_memory_for_themselves_alone():
    bench = Benchtop(with_stages(), 640, 100)
    bench.to(0, 0.0)
    level = np.zeros((100, 640))
    level[50, 100:164] = 100.0
    events = bench.to(1000, level)
    assert set(np.bincount(events["x"], minlength=640)[100:164]) <= {499, 500} and (events["y"] == 50).all()
    room = bench.pixels._room
    assert room.max() >= 16_000 and room.sum() <= 5 * (len(events) + 64 * len(room))


def test_what_is_busy_in_turn_runs_once_a_step_when_each_has_had_its_room(monkeypatch):
    bench = Benchtop(with_stages(), 640, 100)
    launches = []
    launch = bench.pixels._launch
    monkeypatch.setattr(bench.pixels, "_launch", lambda *given: launches.append(given) or launch(*given))
    bench.to(0, 0.0)
    level = np.zeros((100, 640))
    for k in range(1, 9):
        level[10 + 40 * (k % 2), 100:164] = 4.0 * (k % 4 < 2)
        bench.to(1000 * k, level)
    assert len(launches) == 9 + 2
    assert bench.pixels._room.sum() <= 1 << 20
