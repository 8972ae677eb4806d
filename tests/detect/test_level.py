"""The brightness a detector shows to people is the one its events come from."""

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detect.reference import ReferenceDetector
from clsim.detector import Detector
from tests.detect.reference_scenes import random_frames


@pytest.mark.parametrize("method", ["esim", "wlr-esim", "esim-ad", "irradiance"])
def test_level_is_the_references(method: str) -> None:
    frames = random_frames(4)
    size = (frames[0].width, frames[0].height, frames[0].names)
    config = DetectorConfig(method=method, window=5, precision="float64")
    detector, reference = Detector(config, *size), ReferenceDetector(config, *size)
    assert np.isnan(detector.level()).all()
    for frame in frames:
        detector.step(frame)
        reference.step(frame)
        np.testing.assert_allclose(detector.level(), reference.level, atol=1e-5)
    detector.close()


def test_after_a_reset_the_history_is_that_of_the_new_start() -> None:
    frames = random_frames(4, count=5)
    size = (frames[0].width, frames[0].height, frames[0].names)
    config = DetectorConfig(method="wlr-esim", window=5, history=3, precision="float64")
    detector, reference = Detector(config, *size), ReferenceDetector(config, *size)
    for frame in frames[:3]:
        detector.step(frame)
    detector.reset()
    for frame in frames[3:]:
        detector.step(frame)
        reference.step(frame)
        np.testing.assert_allclose(detector.level(), reference.level, atol=1e-9)
    detector.close()


def test_pixels_that_were_no_number_a_frame_ago_are_not_in_the_history() -> None:
    frames = random_frames(4, count=5)
    frames[1].plane("Nx")[2:5, 3:6] = np.nan
    size = (frames[0].width, frames[0].height, frames[0].names)
    config = DetectorConfig(method="wlr-esim", window=5, history=3, precision="float64")
    detector, reference = Detector(config, *size), ReferenceDetector(config, *size)
    for frame in frames:
        detector.step(frame)
        reference.step(frame)
        valid = np.isfinite(frame.planes).all(axis=0)
        np.testing.assert_allclose(detector.level()[valid], reference.level[valid], atol=1e-9)
    detector.close()
