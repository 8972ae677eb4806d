"""`clsim detect` with what runs in numpy, and with chosen features."""

import json

import numpy as np
import pytest

from clsim.events.files import open_source
from clsim.frames.exr import ExrWriter
from tests.detect.reference_scenes import FEATURES, random_frames


@pytest.fixture
def folder(tmp_path):
    """Four frames with variance planes."""
    from clsim.frames import Frame

    writer = ExrWriter(tmp_path / "frames")
    for frame in random_frames(1, height=9, width=11):
        names = ("R", "G", "B", *FEATURES)
        extra = np.full((len(names), 9, 11), 1e-3, np.float32)
        planes = np.concatenate([frame.planes, extra])
        writer.write(Frame(planes, (*frame.names, *(f"Variance.{n}" for n in names)), frame.time_us, frame.index))
    return tmp_path / "frames"


def detect(clsim, folder, *options):
    out = folder.parent / "events.csv"
    outcome = clsim("detect", folder, "--out", out, "--window", 5, "--threshold", 0.1, "--json", *options)
    assert outcome.status == 0, outcome.stderr
    events = np.concatenate(list(open_source(out)))
    return json.loads(outcome.stdout), events


OPTIONS = [("gate", "delta-r-exact"), ("gate", "published"), ("bandwidth", "tsvd"), ("bandwidth", "optimised")]


@pytest.mark.parametrize(("option", "value"), OPTIONS)
def test_numpy_does_what_no_kernel_does(clsim, folder, option, value):
    """The events are those of the reference with that option, and not those of the default."""
    from clsim.detect.config import DetectorConfig
    from clsim.detect.reference import ReferenceDetector
    from clsim.frames.exr import ExrSequence

    summary, events = detect(clsim, folder, f"--{option}", value)
    config = DetectorConfig(window=5, threshold_on=0.1, threshold_off=0.1, **{option: value})
    source = ExrSequence(folder)
    reference = ReferenceDetector(config, source.width, source.height, source.names)
    expected = np.concatenate([reference.step(frame) for frame in source])
    np.testing.assert_array_equal(events, expected)
    assert summary["solved_share"] == pytest.approx(reference.stats.solved_share)
    _, plain = detect(clsim, folder)
    assert len(plain) > 0 and not np.array_equal(plain, events)


def test_luminance_is_regressed_on_request(clsim, folder):
    """As `Detector` does it; the frames' variance is read for --shrink, which changes the events again."""
    from clsim.detect.config import DetectorConfig
    from clsim.detector import Detector
    from clsim.frames.exr import ExrSequence

    found = [detect(clsim, folder)[1]]
    for options in ({"regress": "linear"}, {"regress": "linear", "shrink": 1.5}):
        config = DetectorConfig(window=5, threshold_on=0.1, threshold_off=0.1, **options)
        source = ExrSequence(folder)
        detector = Detector(config, source.width, source.height, source.names)
        expected = np.concatenate([detector.step(frame) for frame in source])
        given = [text for name, value in options.items() for text in (f"--{name}", value)]
        found.append(detect(clsim, folder, *given)[1])
        np.testing.assert_array_equal(found[-1], expected)
    assert len({events.tobytes() for events in found}) == 3


def test_options_that_the_method_has_no_use_for_are_named(clsim, folder):
    command = ("detect", folder, "--out", folder.parent / "x.csv", "--window", 5, "--history", 2)
    said = [clsim(*command, *more).stderr for more in ((), ("--method", "esim", "--gate", "delta-r"))]
    assert "has no use for" not in said[0]
    assert "clsim: --method esim has no use for --window, --gate, --history" in " ".join(said[1].split())


def test_shrink_without_what_it_needs_is_refused(clsim, folder):
    outcome = clsim("detect", folder, "--out", folder.parent / "x.csv", "--shrink", 1.5)
    assert outcome.status == 2 and "--shrink needs --regress linear" in outcome.stderr


def test_features_by_name(clsim, folder):
    _, some = detect(clsim, folder, "--features", "Depth,Nx")
    _, everything = detect(clsim, folder)
    assert not np.array_equal(some, everything)
    wrong = clsim("detect", folder, "--out", folder.parent / "x.csv", "--features", "Depth,Wetness")
    assert wrong.status == 2 and "--features: 'Wetness' is unknown" in wrong.stderr


def test_missing_variances_are_named(clsim, tmp_path):
    writer = ExrWriter(tmp_path / "frames")
    for frame in random_frames(1, count=2):
        writer.write(frame)
    outcome = clsim("detect", tmp_path / "frames", "--out", tmp_path / "x.csv", "--bandwidth", "tsvd")
    assert outcome.status == 2 and "'Variance.R'" in outcome.stderr


def test_a_kept_window_gate_with_a_chosen_bandwidth_is_refused(clsim, folder):
    outcome = clsim("detect", folder, "--out", folder.parent / "x.csv", "--gate", "published", "--bandwidth", "tsvd")
    assert outcome.status == 2 and "--gate published needs --bandwidth fixed" in outcome.stderr
