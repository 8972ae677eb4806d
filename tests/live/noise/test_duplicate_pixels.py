"""The noise share by duplicate pixels: against other code that fires and matches events."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from clsim.bench.tradeoff.mismatch import Levels, fire
from clsim.detect.config import DetectorConfig
from clsim.live.noise.duplicate_sampling import ENOUGH, WITHIN_US, DuplicatePixels
from clsim.score.matching import Sampling, one_to_one

ON, OFF = 0.2, 0.3
CONFIG = DetectorConfig(threshold_on=ON, threshold_off=OFF, scale=2.0, floor=0.5)
STEP_US = 8_333
PIXELS = 40


def noise_share(replicas, step_us=STEP_US):
    """Of log luminances ``[2, T, PIXELS]``."""
    duplicates = DuplicatePixels(CONFIG)
    for k in range(replicas.shape[1]):
        duplicates.take(np.exp(replicas[:, k]).astype(np.float32), k * step_us)
    return duplicates.noise_share


def fired(levels, step_us=STEP_US):
    image = np.log(np.maximum(CONFIG.scale * np.exp(levels).astype(np.float32), CONFIG.floor)).astype(np.float32)
    thresholds = np.empty((2, 1, PIXELS))
    thresholds[0], thresholds[1] = ON, OFF
    return fire(Levels(image[:, None], np.arange(len(levels)) * step_us), thresholds)


@settings(max_examples=25)
@given(st.integers(0, 1 << 30), st.sampled_from([0.0, 0.02, 0.1, 0.5]), st.sampled_from([STEP_US, 1_000]))
def test_the_share_is_that_of_events_that_an_optimal_match_leaves_alone(seed, noise, step_us):
    random = np.random.default_rng(seed)
    scene = random.normal(0, 0.15, (30, PIXELS)).cumsum(0) - 1
    replicas = scene + noise * random.normal(0, 1, (2, 30, PIXELS))
    events = [fired(replica, step_us) for replica in replicas]
    pairs = len(one_to_one(*events, Sampling(PIXELS, 1, 1e6 / step_us), WITHIN_US))
    total = sum(map(len, events))
    assert noise_share(replicas, step_us) == pytest.approx(1 - 2 * pairs / total, abs=4 / total)


def test_few_events_tell_nothing():
    rising = np.linspace(-1, -1 + 0.99 * ON * (ENOUGH // 2), 12)[None, :, None]
    one_pixel = np.where(np.arange(PIXELS) == 0, rising, -1.0).repeat(2, axis=0)
    assert noise_share(one_pixel) is None
    assert noise_share(np.where(np.arange(PIXELS) < 2, rising, -1.0).repeat(2, axis=0)) == 0.0


@pytest.mark.parametrize("seam_us", [0, 2 * STEP_US])
def test_a_new_pass_restarts(seam_us):
    """A jump at a loop's seam is no event of either replicate, nor is one where the governor changes the samples."""
    duplicates = DuplicatePixels(CONFIG)
    for time_us, first in ((0, 1.0), (STEP_US, 1.0), (seam_us, 9.0), (seam_us + STEP_US, 9.0)):
        if first == 9.0 and time_us == 2 * STEP_US:
            duplicates.restart()
        duplicates.take(np.tile(np.float32([first, 1.0])[:, None], PIXELS), time_us)
    assert duplicates.noise_share is None


def test_events_are_forgotten_once_they_are_compared():
    duplicates = DuplicatePixels(CONFIG)
    for k in range(400):
        duplicates.take(np.full((2, PIXELS), 1.0 + k % 2, np.float32), k * STEP_US)
    assert max(len(replica.fired) for replica in duplicates._replicas) <= 1_000_000 // STEP_US + 1
    assert duplicates.noise_share == 0.0


def test_a_tiny_threshold_takes_no_more_memory_than_the_pixels_have_events():
    """A pixel has 1000 events in a step at most, as the ideal sensor's have."""
    duplicates = DuplicatePixels(DetectorConfig(threshold_on=1e-30, threshold_off=1e-6))
    for k in range(18):
        duplicates.take(np.full((2, PIXELS), 1.0 + k % 2, np.float32), k * 1_000)
        assert sum(len(stamps) for replica in duplicates._replicas for _, stamps in replica.fired) <= 1 << 20
    assert duplicates.noise_share == 0.0
    assert duplicates._events == 2 * PIXELS * 1000 * 17


def test_light_that_is_no_number_is_no_event():
    luminance = np.exp(np.cumsum(np.full((12, PIXELS), 1.01 * ON), axis=0)).astype(np.float32)
    clear, spoilt = DuplicatePixels(CONFIG), DuplicatePixels(CONFIG)
    for k, seen in enumerate(luminance):
        bad = seen.copy()
        bad[3:5] = np.nan if k == 0 else seen[3:5]
        bad[7:9] = np.inf if k == 5 else seen[7:9]
        clear.take(np.tile(seen, (2, 1)), k * STEP_US)
        spoilt.take(np.tile(bad, (2, 1)), k * STEP_US)
    assert clear.noise_share == spoilt.noise_share == 0.0
    assert clear._events - spoilt._events == 2 * 2  # of the first step of two pixels
