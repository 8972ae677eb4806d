"""A device whose memory the host does not share, as a GPU's: here the processor, treated as if it were one."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detector import Detector
from clsim.opencl.device import choose_device
from clsim.sensor import Specimen, load_sensor
from tests.detect.reference_scenes import random_frames


@pytest.mark.parametrize(
    ("method", "sensor"),
    [
        ("esim", None),
        ("esim", "davis346"),
        *(pytest.param(name, None, marks=pytest.mark.slow) for name in ("irradiance", "esim-ad")),
    ],
)
def test_events_are_those_of_a_device_that_shares_it(method, sensor):
    """From frames in one place, which is written anew between steps, as in a ring."""
    frames = random_frames(1, count=5, height=17, width=23)
    frames[3].planes[:] = frames[2].planes  # nothing fires
    own = choose_device()
    found = []
    for device in (own, dataclasses.replace(own, is_cpu=not own.is_cpu)):
        specimen = None if sensor is None else Specimen(load_sensor(sensor), 3, 100.0)
        config = DetectorConfig(method=method, window=5, threshold_on=0.15, threshold_off=0.12)
        detector = Detector(config, 23, 17, frames[0].names, device=device, specimen=specimen)
        slot = frames[0].copy()
        events = []
        for frame in frames:
            slot.planes[...] = frame.planes
            slot.time_us, slot.index = frame.time_us, frame.index
            events.append(detector.step(slot).copy())
        found.append((events, detector.level(), detector.interest(), detector.stats))
        detector.close()
        detector.close()
    (shared, level, interest, stats), (apart, own_level, own_interest, own_stats) = found
    for one, other in zip(shared, apart, strict=True):
        np.testing.assert_array_equal(one, other)
    assert stats == own_stats and stats.events > 500
    np.testing.assert_array_equal(level, own_level)
    np.testing.assert_array_equal(interest.to_on, own_interest.to_on)
