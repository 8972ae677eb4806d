"""Noise of the pixel itself against what is known of level crossings of an Ornstein-Uhlenbeck process."""

import math
from dataclasses import replace

import numpy as np
import pytest

from clsim.events import CAUSES
from clsim.sensor import SensorSettings
from clsim.sensor.pixel_stages import FrontEnd, Leak, Noise, Refractory, Threshold
from clsim.sensor.reference.front import follow
from tests.sensor.benchtop import EVERYTHING, SPLITS, Benchtop, planes

FOLLOWER_HZ = 100.0
TAU_S = 1 / (2 * math.pi * FOLLOWER_HZ)
THETA = 0.2

LEVEL_STEP = {2.0: 0.33944, 2.5: 0.13973, 3.0: 0.045089, 3.5: 0.010920, 4.0: 0.0019797, 5.0: 2.8419e-5}
"""Events of both polarities per time constant, where the reference moves by the threshold, from its ratio to σ.

By mean exit times from between a reference's neighbours, weighted by how often each is the reference."""
FIRST_PASSAGE = {2.0: 0.30615, 2.5: 0.12988, 3.0: 0.047410, 3.5: 0.013564, 4.0: 0.0028941, 5.0: 5.3996e-5}
"""1 / the mean time to either threshold from a reference that noise has set, in time constants (Siegert 1951)."""


def noisy(ratio, rest_us=0.0):
    settings = SensorSettings(front_end=FrontEnd(follower_hz=FOLLOWER_HZ), noise=Noise(shot=THETA / ratio))
    return replace(settings, refractory=Refractory(rest_us)) if rest_us else settings


def watch(settings, pixels, seconds, steps=20, level=0.0):
    """Return the events of pixels under constant light, after 60 ms in which the references settle, and the bench.

    Light goes to ``level`` at first: where all pixels fire then, noise has set their references.
    """
    bench = Benchtop(settings, pixels, on=THETA, off=THETA)
    bench.along([0, 20_000, 60_000], [0.0, level, level])
    times_us = [60_000 + round(seconds * 1e6 * (k + 1) / steps) for k in range(steps)]
    return bench.along(times_us, [level] * steps), bench


def some_slow(*ratios):
    """Return those that are in the tables, of which these are quick."""
    return [each if each in ratios else pytest.param(each, marks=pytest.mark.slow) for each in LEVEL_STEP]


@pytest.mark.parametrize("ratio", some_slow(2.0, 3.0))
def test_noise_fires_at_the_rate_of_level_crossings(ratio):
    seconds = {2.0: 0.3, 2.5: 0.3, 3.0: 0.6, 3.5: 1.0, 4.0: 3.0, 5.0: 150.0}[ratio]
    pixels = {4.0: 6000, 5.0: 4500}.get(ratio, 1500)
    events, bench = watch(noisy(ratio), pixels, seconds)
    per_tau = len(events) / pixels / seconds * TAU_S
    assert len(events) > 10_000
    assert per_tau == pytest.approx(LEVEL_STEP[ratio], rel=5 / math.sqrt(len(events)))
    assert events["on"].mean() == pytest.approx(0.5, abs=0.02)
    assert set(np.concatenate(bench.causes)) == {CAUSES.index("shot")}


def test_there_is_no_burst_when_pixels_begin():
    bench = Benchtop(noisy(2.0), 3000, on=THETA, off=THETA)
    events = bench.along([0, 20_000, 40_000], [0.0, 0.0, 0.0])
    early, late = (events["t"] <= 1000).sum(), (events["t"] > 39_000).sum()
    assert late > 300 and early == pytest.approx(late, rel=0.3) and events["t"].min() >= 1


def opposite(x, on):
    """Return the share of events of another polarity than the one before of the same pixel, and of how many."""
    same_pixel = x[1:] == x[:-1]
    return (on[1:] != on[:-1])[same_pixel].mean(), int(same_pixel.sum())


def test_successive_noise_events_are_mostly_of_opposite_polarity():
    events, _ = watch(noisy(2.5), 1500, 0.15)
    order = np.lexsort((events["t"], events["x"]))
    assert opposite(events["x"][order], events["on"][order])[0] == pytest.approx(0.75, abs=0.02)


def sampled(ratio, rest, pixels=1000, settling=40, length=100, step=0.005):
    """Return pixels and polarities of events by samples of an Ornstein-Uhlenbeck process, by pixel and time.

    Times are in time constants. What crosses between samples and comes back is made up for by a threshold that lies
    nearer by 0.5826 standard deviations of a step (Broadie, Glasserman and Kou 1997).
    """
    generator = np.random.default_rng(7)
    decay, resting_steps = math.exp(-step), round(rest / step)
    nearer = ratio - 0.5826 * math.sqrt(2 * step)
    noise, reference = generator.normal(size=pixels), np.zeros(pixels)
    released, found = np.zeros(pixels, int), []
    for k in range(round((settling + length) / step)):
        noise = decay * noise + math.sqrt(1 - decay**2) * generator.normal(size=pixels)
        if resting_steps:
            reference = np.where(released == k, noise, reference)
        fires = np.flatnonzero((abs(noise - reference) >= nearer) & (released <= k))
        rises = noise[fires] > reference[fires]
        reference[fires] += np.where(rises, ratio, -ratio)
        released[fires] = k + resting_steps
        if k * step >= settling:
            found += [(int(x), k, bool(on)) for x, on in zip(fires, rises, strict=True)]
    events = np.array(sorted(found))
    return events[:, 0], events[:, 2]


@pytest.mark.slow
@pytest.mark.parametrize("rest", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("ratio", [2.0, 2.5])
def test_noise_fires_as_often_and_to_and_fro_as_in_a_simulation_by_samples(ratio, rest):
    events, _ = watch(noisy(ratio, rest * TAU_S * 1e6), 2000, 100 * TAU_S)
    order = np.lexsort((events["t"], events["x"]))
    share, pairs = opposite(events["x"][order], events["on"][order])
    x, on = sampled(ratio, rest)
    wanted, their_pairs = opposite(x, on)
    error = math.sqrt(wanted * (1 - wanted) * (1 / pairs + 1 / their_pairs))
    assert share == pytest.approx(wanted, abs=4 * error) and error < 0.006
    assert len(events) / 2000 == pytest.approx(len(x) / 1000, rel=0.05)


@pytest.mark.parametrize("ratio", some_slow(2.0))
def test_with_a_long_rest_noise_fires_at_the_rate_of_first_passages(ratio):
    # The rest is long enough for the noise to forget: 8 time constants. Pixels whose reference noise has set far out
    # fire early: the rate is that of means only over many waits, or when those that all pixels began with are over.
    rest_s = 8 * TAU_S
    pixels, seconds, from_s = {
        2.0: (1000, 1, 0),
        2.5: (1000, 1, 0),
        3.0: (1000, 1.5, 0),
        3.5: (1000, 4, 0),
        4.0: (300, 18, 0),
        5.0: (1000, 600, 300),
    }[ratio]
    events, _ = watch(noisy(ratio, rest_s * 1e6), pixels, seconds, level=1.0)
    found = np.count_nonzero(events["t"] > 60_000 + 1e6 * from_s)
    wait_s = pixels * (seconds - from_s) / found - rest_s
    assert found > 4000
    assert TAU_S / wait_s == pytest.approx(FIRST_PASSAGE[ratio], rel=0.05)


@pytest.mark.parametrize("begin_us", [pytest.param(0, marks=pytest.mark.slow), 10**9])
def test_noise_is_the_same_bits_at_every_frame_rate(begin_us):
    found = []
    for times_us in SPLITS.values():
        bench = Benchtop(EVERYTHING, 30, 10)
        events = bench.along([begin_us + t for t in times_us], [0.3] * len(times_us))
        found.append((events, np.concatenate(bench.causes)))
    assert len(found[0][0]) > 2000 and set(found[0][1]) == {1, 2, 3}
    for events, causes in found[1:]:
        np.testing.assert_array_equal(events, found[0][0])
        np.testing.assert_array_equal(causes, found[0][1])


@pytest.mark.slow
def test_variance_falls_with_light_and_the_rate_peaks_between_dark_and_bright():
    # In the dark the receptor is slow, in the light there is little noise.
    settings = SensorSettings(front_end=FrontEnd(0.01, 3.0, 300.0), noise=Noise(shot=0.07))
    rates = []
    for lux in (0.1, 3.0, 30.0, 100.0, 1000.0):
        bench = Benchtop(settings, 1000, on=THETA, off=THETA)
        bench.to(0, math.log(lux / 100))
        rates.append(len(bench.along([200_000, 400_000], [math.log(lux / 100)] * 2)) / 1000 / 0.4)
    assert np.argmax(rates) in (1, 2, 3) and rates[-1] < 0.1 * max(rates) > rates[0]
    # n = 1 / (1 + tau_follower / tau_receptor) of the dark's variance, at 100 lux, as a lone follower's noise of that
    # variance: the two have one correlation time, of which rates are in units.
    sigma = 0.07 / math.sqrt(1 + 100.01 * 3.0 / 300.0)
    tau_s = (1 / 300.0 + 1 / (3.0 * 100.01)) / (2 * math.pi)
    alone = SensorSettings(front_end=FrontEnd(follower_hz=1 / (2 * math.pi * tau_s)), noise=Noise(shot=sigma))
    bench = Benchtop(alone, 1000, on=THETA, off=THETA)
    bench.to(0, 0.0)
    assert rates[3] == pytest.approx(len(bench.along([200_000, 400_000], [0.0] * 2)) / 1000 / 0.4, rel=0.1)


V2E = {2.039: 0.965, 2.478: 0.442, 3.013: 0.121}
"""Rate of ON events over bandwidth, by threshold over σ: v2e's media/noise_event_rate_simulation.xlsx."""


@pytest.mark.slow
@pytest.mark.parametrize("ratio", V2E)
def test_noise_fires_about_as_often_as_v2e_found(ratio):
    # v2e's table is from a simulation with samples of finite distance, which miss crossings: it is up to 15 % too low.
    events, _ = watch(noisy(ratio), 1500, 0.6)
    per_hz = events["on"].sum() / 1500 / 0.6 / FOLLOWER_HZ
    assert V2E[ratio] < per_hz < 1.16 * V2E[ratio]


@pytest.mark.slow
def test_noise_against_light_has_the_shape_that_was_measured():
    # Of an unnamed camera, by the arrays of IEBCS (0.1 lux: 5.0 Hz ON, 3.7 Hz OFF of a median pixel, a quarter of a
    # decade of spread; 161 lux and 3 klux: 0.1 Hz ON, and 0.2 % and none of the pixels with an OFF event).
    settings = SensorSettings(
        threshold=Threshold(0.2, 0.2, mismatch=0.022),
        front_end=FrontEnd(0.1, 300.0, 30.0),
        noise=Noise(shot=0.11),
        leak=Leak(0.1, 0.25),
    )
    for lux, seconds in ((0.1, 20), (161.0, 60), (3000.0, 60)):
        bench = Benchtop(settings, 900, on=THETA, off=THETA)
        level = math.log(lux / 100)
        bench.along([0, 1_000_000], [level] * 2)
        events = bench.along([1_000_000 + seconds * 200_000 * k for k in range(1, 6)], [level] * 5)
        on, off = (np.bincount(events["x"][events["on"] == up], minlength=900) / seconds for up in (True, False))
        if lux == 0.1:
            assert np.median(on) == pytest.approx(5.0, rel=0.3) and np.median(off) == pytest.approx(3.7, rel=0.3)
            assert (on + off > 0).all() and 0.15 < np.std(np.log10(on + off)) < 0.35
        else:
            assert np.median(on) == pytest.approx(0.1, rel=0.2) and (off > 0).mean() < 0.003


def test_a_step_amid_noise_is_late_by_a_jitter_that_theory_gives():
    # σ τ / (s - θ): noise over how steep the filter's output is where it crosses.
    sigma, step = 0.01, 0.5
    bench = Benchtop(noisy(THETA / sigma), 3000, on=THETA, off=THETA)
    bench.along([0, 20_000], [0.0, 0.0])
    events = bench.to(30_000, step, [[(1, step)]] * 3000)
    first_us = np.full(3000, np.inf)
    np.minimum.at(first_us, events["x"], events["t"] - 20_000.0)
    assert first_us.mean() == pytest.approx(1e6 * TAU_S * math.log(step / (step - THETA)), rel=0.01)
    assert first_us.std() == pytest.approx(1e6 * sigma * TAU_S / (step - THETA), rel=0.1)


def test_a_flash_amid_noise_fires_when_the_front_end_follows_it():
    # Three thousand times the light within a ns: the front end moves much within each µs. The noise is next to none.
    front_end, level = FrontEnd(2.0, 0.3, FOLLOWER_HZ), 8.0
    bench = Benchtop(SensorSettings(front_end=front_end, noise=Noise(shot=1e-9)), 1, on=THETA, off=THETA)
    bench.to(0, 0.0)
    events = bench.to(30_000, level, [[(1, level)]])
    assert events["on"].all() and len(events) == math.floor(math.log((math.exp(level) + 0.02) / 1.02) / THETA)
    points = [(0.0, 0.0), (1e-9, level), (2e-4, level), (0.03, level)]
    times_s, given = zip(*follow(points, dark=0.02, receptor_s=1 / (2 * math.pi * 30), follower_s=TAU_S), strict=True)
    crossed = math.log(1.02) + THETA * np.arange(1, len(events) + 1)
    np.testing.assert_allclose(events["t"], 1e6 * np.interp(crossed, given, times_s), rtol=1e-3, atol=1)


@pytest.mark.parametrize("lux", [None, 10.0, 300.0])
def test_noise_has_its_variance_and_forgets_at_its_pace(lux):
    # Seen in the pixels' state: no event can be told from it. Behind a receptor of 0.3 Hz for each lux, the follower
    # passes 1 / (1 + tau_follower / tau_receptor) of the dark's variance, which lasts tau_follower + tau_receptor.
    ratio, pixels, tau_s, sigma = 20.0, 4000, TAU_S, THETA / 20.0
    settings, level = noisy(ratio), 0.0
    slot_us = settings.noise.slot_us(TAU_S)
    if lux is not None:
        settings = replace(settings, front_end=FrontEnd(2.0, 0.3, FOLLOWER_HZ))
        receptor_hz, level = 0.3 * (lux + 2.0), math.log(lux / 100)
        sigma /= math.sqrt(1 + receptor_hz / FOLLOWER_HZ)
        tau_s += 1 / (2 * math.pi * receptor_hz)
    bench = Benchtop(settings, pixels, on=THETA, off=THETA)

    def noise_at(slot):
        bench.to(slot * slot_us, level)
        return planes(bench, "S")["NEXT_NOISE"]

    noise_at(0)
    first = noise_at(50)
    assert first.var() == pytest.approx(sigma**2, rel=4 * math.sqrt(2 / pixels))
    for slots in (1, 2, 4, 20):
        later = noise_at(50 + slots)
        correlation = np.mean(first * later) / sigma**2
        assert correlation == pytest.approx(math.exp(-slots * slot_us * 1e-6 / tau_s), abs=4 / math.sqrt(pixels))
        assert later.var() == pytest.approx(sigma**2, rel=4 * math.sqrt(2 / pixels))


@pytest.mark.slow
def test_noise_leaves_the_net_rate_of_a_leak():
    settings = replace(noisy(2.5), leak=Leak(10.0))
    events, _ = watch(settings, 1000, 1.0)
    net = 2 * int(events["on"].sum()) - len(events)
    assert len(events) > 20_000 and net / 1000 == pytest.approx(10, abs=0.3)
