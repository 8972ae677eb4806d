"""The brightness a detector shows to people is the one its events come from."""

from typing import Any

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detect.reference import ReferenceDetector
from clsim.detector import Detector
from clsim.frames import Frame
from tests.detect.reference_scenes import random_frames


def with_reference(frames: list[Frame], **settings: Any) -> tuple[Detector, ReferenceDetector]:
    """Return a detector of such frames, and the reference of the same settings, in float64."""
    config, first = DetectorConfig(window=5, precision="float64", **settings), frames[0]
    size = (first.width, first.height, first.names)
    return Detector(config, *size), ReferenceDetector(config, *size)


@pytest.mark.parametrize("method", ["esim", "wlr-esim", "esim-ad", "irradiance"])
def test_level_is_the_references(method: str) -> None:
    frames = random_frames(4)
    detector, reference = with_reference(frames, method=method)
    assert np.isnan(detector.level()).all()
    for frame in frames:
        detector.step(frame)
        reference.step(frame)
        np.testing.assert_allclose(detector.level(), reference.level, atol=1e-5)
    detector.close()


def test_after_a_reset_the_history_is_that_of_the_new_start() -> None:
    frames = random_frames(4, count=5)
    detector, reference = with_reference(frames, method="wlr-esim", history=3)
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
    detector, reference = with_reference(frames, method="wlr-esim", history=3)
    for frame in frames:
        detector.step(frame)
        reference.step(frame)
        valid = np.isfinite(frame.planes).all(axis=0)
        np.testing.assert_allclose(detector.level()[valid], reference.level[valid], atol=1e-9)
    detector.close()
