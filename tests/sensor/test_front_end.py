"""Receptor, source follower and dark floor against closed forms. 0 is the level of 100 lux."""

import math
import time
from dataclasses import replace

import numpy as np
import pytest

from clsim.sensor import SensorSettings
from clsim.sensor.lab import Lab
from clsim.sensor.pixel_stages import FrontEnd, Refractory
from tests.sensor.benchtop import Benchtop, intervals_us

# Both poles and a floor, of which the tests make what they do not ask for as good as absent.
FAST_HZ, DARKLESS = 1e7, 1e-9


def front(receptor_hz_per_lux=FAST_HZ, follower_hz=FAST_HZ, dark_lux=DARKLESS):
    return SensorSettings(front_end=FrontEnd(dark_lux, receptor_hz_per_lux, follower_hz))


def first_us(settings, level, step, **thresholds):
    """Return when a pixel that rests under ``level`` first fires after a step [µs], in steps of 2 ms."""
    bench = Benchtop(settings, 1, **thresholds)
    bench.to(0, level)
    events = [bench.to(2000, level + step, [[(1, level + step)]])]
    while not len(np.concatenate(events)) and bench.time_us < 1_000_000:
        events.append(bench.to(bench.time_us + 2000, level + step))
    event = np.concatenate(events)[0]
    return int(event["t"]), bool(event["on"])


def test_a_follower_delays_a_step_by_its_closed_form():
    tau_us = 1e6 / (2 * math.pi * 100)
    for step in (0.25, 0.5, 1.0, 2.0):
        expected = tau_us * math.log(step / (step - 0.2))
        assert first_us(front(follower_hz=100.0), 0.0, step)[0] == pytest.approx(expected, rel=0.005, abs=1)


def test_a_receptor_follows_rises_faster_than_falls():
    # 1 Hz per lux at 100 lux: a time constant of 1.59 ms; twice the light has half, and half the light twice of it.
    tau_us = 1e6 / (2 * math.pi * 100)
    settings, thresholds = front(receptor_hz_per_lux=1.0), {"on": 0.2, "off": 0.2}
    up, down = (first_us(settings, 0.0, step, **thresholds) for step in (math.log(2), -math.log(2)))
    assert up == (pytest.approx(0.2250 * tau_us, rel=0.005), True)
    assert down == (pytest.approx(0.5009 * tau_us, rel=0.005), False)
    # Ten times, large signal: what a linear filter misses.
    k = 10.0
    on = tau_us / k * math.log((1 - 1 / k) / (math.exp(-0.2) - 1 / k))
    off = tau_us * k * math.log((k - 1) / (k - math.exp(0.2)))
    assert first_us(settings, 0.0, math.log(k), **thresholds)[0] == pytest.approx(on, rel=0.01, abs=1)
    assert first_us(settings, 0.0, -math.log(k), **thresholds)[0] == pytest.approx(off, rel=0.01)


def test_latency_falls_with_light_until_the_follower_limits():
    settings = front(receptor_hz_per_lux=1.0, follower_hz=1000.0)
    levels = np.log([0.01, 0.1, 1e4, 1e5])  # in units of 100 lux
    late = [first_us(settings, level, 0.4)[0] for level in levels]
    assert late[0] / late[1] == pytest.approx(10, rel=0.1)
    limit = 1e6 / (2 * math.pi * 1000) * math.log(0.4 / 0.2)
    assert late[2] == pytest.approx(limit, rel=0.05) and late[3] == pytest.approx(limit, abs=2)


@pytest.mark.parametrize(
    "frequency_hz", [pytest.param(20.0, marks=pytest.mark.slow), 100.0, pytest.param(250.0, marks=pytest.mark.slow)]
)
def test_a_sine_fires_as_often_as_its_amplitude_after_the_filter_allows(frequency_hz):
    # 2 A |H| / θ - 1 ON events a cycle, on average over phases; thresholds alike. 64 phases, 128 points a cycle.
    theta, amplitude, cycles, points = 0.05, 0.5, 3, 128
    bench = Benchtop(front(follower_hz=100.0), 64, on=theta, off=theta)
    phases = np.arange(64) / 64
    times_us = np.round(np.arange(cycles * points + 1) / points / frequency_hz * 1e6).astype(int)
    counts = 0
    for time_us in times_us:
        events = bench.to(int(time_us), amplitude * np.sin(2 * np.pi * (time_us * 1e-6 * frequency_hz + phases)))
        counts += int(events["on"].sum()) if time_us > times_us[points] else 0
    gain = (1 + (frequency_hz / 100) ** 2) ** -0.5
    assert counts / 64 / (cycles - 1) == pytest.approx(2 * amplitude * gain / theta - 1, rel=0.02, abs=0.3)


def test_a_filter_delays_a_ramp_and_keeps_its_rate():
    settings = replace(front(follower_hz=100.0), refractory=Refractory(500.0))
    bench = Benchtop(settings, 1)
    bench.to(0, 0.0)
    # 100 ln/s: a threshold every 2 ms and a rest.
    events = bench.to(100_000, 10.0)
    waits = intervals_us(events)
    assert waits[5:] == pytest.approx(2500, abs=2)
    # The first one waits for the filter: g (t - tau (1 - exp(-t / tau))) = 0.2.
    tau, t = 1 / (2 * math.pi * 100), events["t"][0] * 1e-6
    assert 100 * (t - tau * (1 - math.exp(-t / tau))) == pytest.approx(0.2, rel=0.01)


def test_a_dark_floor_hides_small_contrast():
    # 10 lux of dark current under 100 lux: a step of contrast (e^θ - 1)(1 + 1/10) is the least that fires.
    least = (math.exp(0.2) - 1) * 1.1
    for contrast, fires in ((0.98 * least, False), (1.02 * least, True)):
        bench = Benchtop(front(dark_lux=10.0), 1)
        bench.to(0, 0.0)
        assert (len(bench.to(10_000, math.log1p(contrast))) > 0) == fires


def test_a_filtered_pixel_fires_at_the_same_times_whatever_the_frame_rate():
    # Brightness is a line; what the filters make of it must not hang on where frames lie.
    settings = replace(front(1.0, 200.0, 1.0), refractory=Refractory(300.0))
    found = []
    for steps in (1, 6, 48, 131):
        bench = Benchtop(settings, 16)
        bench.to(0, 0.0)
        slopes = np.linspace(-3, 3, 16)
        events = np.concatenate(
            [bench.to(100_000 * k // steps, slopes * (100_000 * k // steps) / 1e5) for k in range(1, steps + 1)]
        )
        found.append(np.sort(events, order=["x", "t"]))
    for events in found[1:]:
        assert len(events) == len(found[0]) > 80
        assert abs(events["t"] - found[0]["t"]).max() <= 1


def test_light_that_hardly_changes_costs_no_more_than_light_that_does_not():
    bench = Benchtop(front(receptor_hz_per_lux=1.0, follower_hz=1000.0), 16)
    bench.along([0, 1000], [0.0, 0.1])
    began = time.process_time()
    events = bench.along([10_000_000, 20_000_000], [0.1 + 1e-16, 0.1 - 1e-16])
    assert len(events) == 0 and time.process_time() - began < 1.0


def test_parts_of_a_microsecond_of_a_rest_add_up() -> None:
    """Light rises by a threshold in 0.2 µs: a pixel fires again so soon after each rest."""
    lab = Lab(SensorSettings(refractory=Refractory(20.25)), 1)
    lab.to(0, 0.0)
    times_us = lab.to(1000, 1000.0).events["t"]
    assert np.diff(times_us).mean() == pytest.approx(20.45, abs=0.05)
