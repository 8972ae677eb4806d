"""The same brightness through the published equations of v2e (Hu, Liu, Delbruck, CVPRW 2021), by frames, and here."""

import math

import numpy as np
import pytest
from scipy import stats

from clsim.sensor.lab import Lab
from tests.sensor.benchtop import intervals_us, rates, with_stages
from tests.sensor.fit.test_fit import events

THRESHOLD, SPREAD, PIXELS = 0.2, 0.03, 1000


def v2e(levels, step_s, *, leak_hz=0.0, noise_hz=0.0, spread=SPREAD):
    """Return the events of pixels that all see one level a frame; ``noise_hz`` is the rate of each polarity."""
    random = np.random.default_rng(0)
    on, off = np.maximum(random.normal(THRESHOLD, spread, (2, PIXELS)), 0.01)
    memory, found = np.full(PIXELS, levels[0]), []
    if leak_hz:  # phases apart, which v2e leaves to its first seconds
        memory = memory - random.uniform(0, 1, PIXELS) * on
    for frame, level in enumerate(levels[1:], 1):
        memory = memory - step_s * leak_hz * on
        moved = level - memory
        ups, downs = np.floor(np.maximum(moved, 0) / on), np.floor(np.maximum(-moved, 0) / off)
        memory = memory + ups * on - downs * off
        drawn = random.uniform(size=PIXELS)
        noisy = drawn < noise_hz * step_s * THRESHOLD / on, drawn > 1 - noise_hz * step_s * THRESHOLD / off
        memory = np.where(noisy[0] | noisy[1], level, memory)
        for counts, polarity in ((ups + noisy[0], True), (downs + noisy[1], False)):
            at = np.repeat(np.arange(PIXELS), counts.astype(int))
            if len(at):
                found.append(events(np.full(len(at), round(frame * step_s * 1e6)), at, polarity))
    return np.concatenate(found)


def ours(levels, step_s, spread=SPREAD, **stages):
    lab = Lab(with_stages(threshold={"on": THRESHOLD, "off": THRESHOLD, "mismatch": spread}, **stages), PIXELS)
    return np.concatenate([lab.to(round(k * step_s * 1e6), level).events for k, level in enumerate(levels)])


def at_frames(found, step_s):
    """Return events with the times that frames would give them."""
    frame_us, stamped = round(step_s * 1e6), found.copy()
    stamped["t"] = -(-found["t"] // frame_us) * frame_us
    return stamped


def test_a_signal_fires_as_often_and_as_often_up_as_down():
    step_s, seconds = 1e-3, 2.0
    levels = np.sin(2 * math.pi * 2 * step_s * np.arange(round(seconds / step_s) + 1))
    theirs, here = v2e(levels, step_s), ours(levels, step_s)
    assert rates(here, PIXELS, seconds) == pytest.approx(rates(theirs, PIXELS, seconds), rel=0.02)
    assert stats.ks_2samp(intervals_us(at_frames(here, step_s)), intervals_us(theirs)).statistic < 0.02


def test_noise_and_leak_fire_at_their_rates_with_their_intervals():
    step_s, seconds = 5e-3, 10.0
    levels = np.zeros(round(seconds / step_s) + 1)
    # Thresholds all alike: over those that differ v2e leaks at one rate, and a camera does not.
    theirs = v2e(levels, step_s, leak_hz=2.0, noise_hz=1.0, spread=1e-9)
    here = ours(levels[::100], 100 * step_s, 1e-9, leak={"hz": 2.0}, noise={"on_hz": 1.0, "off_hz": 1.0})
    assert rates(here, PIXELS, seconds) == pytest.approx(rates(theirs, PIXELS, seconds), rel=0.05)
    # By how much intervals would have to be moved to be theirs, in the mean: less than a frame.
    assert stats.wasserstein_distance(intervals_us(here), intervals_us(theirs)) < 1e6 * step_s


@pytest.mark.slow
def test_noise_of_v2e_hangs_on_its_frames_and_ours_does_not():
    found = []
    for step_s in (1e-3, 1 / 30):
        levels = np.zeros(round(2 / step_s) + 1)
        theirs = sum(rates(v2e(levels, step_s, noise_hz=50.0, spread=1e-9), PIXELS, 2.0))
        here = sum(rates(ours(levels, step_s, noise={"on_hz": 50.0, "off_hz": 50.0}), PIXELS, 2.0))
        found.append((theirs, here))
    (fine, ours_fine), (coarse, ours_coarse) = found
    assert fine == pytest.approx(100, rel=0.02) and [ours_fine, ours_coarse] == pytest.approx([100, 100], rel=0.02)
    # An event of a polarity and frame, and no more: 60 at 30 frames a second.
    assert coarse == pytest.approx(60, rel=0.01)
