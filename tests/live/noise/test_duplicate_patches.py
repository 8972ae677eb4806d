"""How much is noise where windows mix pixels: against whole pictures of two seeds."""

from __future__ import annotations

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detector import Detector
from clsim.frames import RADIANCE, Frame, rendered_planes
from clsim.frames.patches import Patches
from clsim.live.noise.duplicate_patches import DuplicatePatches, patches_for
from clsim.live.options import LiveOptions
from clsim.live.session import open_live
from clsim.opencl.device import choose_device
from clsim.score.matching import Sampling, one_to_one

WIDTH, HEIGHT, FRAMES, STEP_US = 120, 90, 8, 10_000
NAMES = rendered_planes(first_hit_rays=False).names


def pictures(seed):
    """Waves of brightness before surfaces that move, with noise: planes ``[FRAMES, C, HEIGHT, WIDTH]``."""
    random = np.random.default_rng(seed)
    surfaces = np.random.default_rng(0).uniform(0.2, 0.8, (len(NAMES), HEIGHT, WIDTH)).astype(np.float32)
    planes = np.stack([np.roll(surfaces, k, axis=2) for k in range(FRAMES)])
    x = np.arange(WIDTH)
    for k in range(FRAMES):
        light = np.exp(0.5 * np.sin(0.4 * (x - 3 * k)) + random.normal(0, 0.3, (HEIGHT, WIDTH)))
        for name in RADIANCE:
            planes[k, NAMES.index(name)] = light
    return planes


def detected(config, planes):
    detector = Detector(config, WIDTH, HEIGHT, NAMES)
    events = [detector.step(Frame(each, NAMES, time_us=k * STEP_US)).copy() for k, each in enumerate(planes)]
    detector.close()
    return np.concatenate(events)


@pytest.mark.parametrize(
    "config",
    [
        DetectorConfig("esim-ad", window=7, event_rule="frame"),
        DetectorConfig("esim-ad", window=5, gate="delta-r", event_rule="frame"),
        DetectorConfig("wlr-esim", window=5, stride=2),
    ],
    ids=lambda config: f"{config.method}, {config.gate}",
)
def test_the_share_is_that_of_two_whole_pictures_inside_the_patches(config):
    patches = patches_for(config, WIDTH, HEIGHT)
    assert patches is not None and len(patches.corners) > 1
    seeds = [pictures(seed) for seed in (1, 2)]
    meter = DuplicatePatches(config, patches, NAMES, choose_device())
    for k in range(FRAMES):
        seen = np.stack([each[k].reshape(len(NAMES), -1)[:, patches.pixels(WIDTH)] for each in seeds])
        meter.take(seen.reshape(2, -1, *patches.shape), k * STEP_US)
    inside = np.zeros(WIDTH * HEIGHT, bool)
    inside[patches.pixels(WIDTH)[patches.inside().reshape(-1)]] = True
    events = [detected(config, each) for each in seeds]
    events = [each[inside[each["y"] * np.int64(WIDTH) + each["x"]]] for each in events]
    pairs = len(one_to_one(*events, Sampling(WIDTH, HEIGHT, 1e6 / STEP_US), 25_000))
    total = sum(map(len, events))
    assert total > 100 and meter.noise_share is not None
    assert meter.noise_share == pytest.approx(1 - 2 * pairs / total, abs=4 / total)


def test_a_new_pass_restarts():
    config = DetectorConfig("wlr-esim", window=3)
    patches = Patches(10, ((0, 0),), 2)
    meter = DuplicatePatches(config, patches, NAMES, choose_device())
    planes = np.full((2, len(NAMES), 10, 10), 0.5, np.float32)
    for time_us, light in ((0, 1.0), (STEP_US, 1.0), (0, 9.0), (STEP_US, 9.0)):
        planes[:, [NAMES.index(name) for name in RADIANCE]] = light
        meter.take(planes, time_us)
    assert meter.noise_share is None and meter._events == 0
    planes[:, [NAMES.index(name) for name in RADIANCE]] = 1.0
    meter.take(planes, 2 * STEP_US)
    assert meter.noise_share == 0.0 and meter._events >= 2 * 6 * 6


@pytest.mark.slow
def test_windowed_methods_tell_how_much_is_noise():
    summary = open_live(
        LiveOptions("two-boxes", method="esim-ad", frame_count=8, fps=120.0, resolution=(173, 130), spp=16)
    ).run()
    assert summary.noise_share is not None and 0.05 < summary.noise_share < 0.4


def test_a_picture_that_is_too_small_tells_nothing():
    assert patches_for(DetectorConfig("esim-ad"), 23, 40) is None
    assert patches_for(DetectorConfig("esim-ad"), 24, 40) is not None
