"""The OpenCL detector against F1 figures that an independent prototype measured on recorded frames."""

from pathlib import Path

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detector import Detector
from clsim.frames.exr import ExrSequence
from clsim.score import score

FRAMES = Path(__file__).resolve().parents[3] / "shared" / "frames" / "two-boxes"
ALLOWED_F1 = 0.01
"""How far below the prototype's figure F1 may be: it had another solver."""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not FRAMES.is_dir(), reason="the recorded two-boxes frames are not on this machine"),
]

SEQUENCES = ("8spp", "32spp", "common-8spp")
ROWS = [
    ({"method": "esim"}, (0.437, 0.495, 0.831)),
    ({"method": "wlr-esim"}, (0.786, 0.912, 0.921)),
    ({"gate": "delta-r"}, (0.819, 0.902, 0.909)),
    ({"gate": "radiance"}, (0.806, 0.913, 0.922)),
    ({"gate": "radiance", "window": 9, "history": 3}, (0.844, 0.923, 0.917)),
    ({"gate": "radiance", "history": 3}, (0.870, 0.924, 0.924)),
]


def detect(sequence, **options):
    source = ExrSequence(FRAMES / sequence, fps=60)
    config = DetectorConfig(event_rule="frame", threshold_on=0.14, threshold_off=0.14, **options)
    detector = Detector(config, source.width, source.height, source.names)
    return np.concatenate([detector.step(frame) for frame in source])


@pytest.fixture(scope="module")
def reference():
    return detect("common-1024spp", method="esim")


@pytest.mark.parametrize(("options", "prototype"), ROWS, ids=lambda v: str(v) if isinstance(v, dict) else "")
def test_f1_reaches_the_prototype(reference, options, prototype):
    for sequence, expected in zip(SEQUENCES, prototype, strict=True):
        assert score(detect(sequence, **options), reference, 96, 96, 60).f1 >= expected - ALLOWED_F1, sequence
