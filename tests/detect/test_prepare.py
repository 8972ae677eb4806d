"""A detector whose kernels are built before the first frame comes, while that is rendered."""

from typing import Any

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detector import Detector
from clsim.opencl import workplace
from clsim.sensor import Specimen, load_sensor
from tests.detect.reference_scenes import random_frames


def prepared(frames: list[Any], method: str, sensor: str | None = None) -> Detector:
    first = frames[0]
    specimen = None if sensor is None else Specimen(load_sensor(sensor))
    detector = Detector(DetectorConfig(method=method), first.width, first.height, first.names, specimen=specimen)
    detector.prepare()
    return detector


@pytest.mark.parametrize("method", ["esim", "irradiance", "esim-ad"])
def test_it_fires_what_it_fires_anyway(method: str) -> None:
    frames = random_frames(5)
    detector, first = prepared(frames, method), frames[0]
    detector.prepare()
    other = Detector(DetectorConfig(method=method), first.width, first.height, first.names)
    found = [[each.step(frame) for frame in frames] for each in (detector, other)]
    assert sum(map(len, found[0])) > 0
    for one, another in zip(*found, strict=True):
        np.testing.assert_array_equal(one, another)


@pytest.mark.parametrize("sensor", [None, "davis346"])
def test_no_kernel_is_built_once_frames_come(monkeypatch: pytest.MonkeyPatch, sensor: str | None) -> None:
    frames = random_frames(3)
    detector = prepared(frames, "esim", sensor)
    monkeypatch.setattr(workplace, "_build", None)
    for frame in frames:
        detector.step(frame)
    assert detector.stats.frames == len(frames)
