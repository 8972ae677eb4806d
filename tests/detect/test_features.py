"""Which planes a detector regresses on, and that its kernels can be built before the first frame comes."""

from typing import Any

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detect.features import feature_names
from clsim.detector import Detector
from clsim.errors import InputError
from clsim.opencl import workplace
from clsim.sensor import Specimen, load_sensor
from tests.detect.reference_scenes import random_frames


def test_feature_choice_errors_name_the_plane():
    with pytest.raises(InputError, match=r"'Nz'.*R, G, B"):
        feature_names(DetectorConfig(features=("Nz",)), ("R", "G", "B"))
    with pytest.raises(InputError, match="'Samples'"):
        feature_names(DetectorConfig(features=("Samples",)), ("R", "G", "B", "Samples"))


@pytest.mark.parametrize("weights", [(0.0, 0.0, 0.0), (-0.1, 0.6, 0.5)])
def test_weights_that_leave_no_brightness_are_refused(weights):
    with pytest.raises(InputError, match="`luminance` must be weights that are not negative, and not all 0"):
        DetectorConfig(luminance=weights)


def prepared(frames: list[Any], method: str, sensor: str | None = None) -> Detector:
    first = frames[0]
    specimen = None if sensor is None else Specimen(load_sensor(sensor))
    detector = Detector(DetectorConfig(method=method), first.width, first.height, first.names, specimen=specimen)
    detector.prepare()
    return detector


@pytest.mark.parametrize("method", ["esim", "irradiance", "esim-ad"])
def test_a_prepared_detector_fires_what_it_fires_anyway(method: str) -> None:
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
