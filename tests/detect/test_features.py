"""Which planes a detector regresses on, and that its kernels can be built before the first frame comes."""

from typing import Any

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detect.features import feature_names
from clsim.detector import Detector
from clsim.errors import InputError
from clsim.frames import RADIANCE, Frame
from clsim.opencl import workplace
from clsim.sensor import Specimen, load_sensor
from tests.detect.reference_scenes import make_frame, random_frames, run


def test_feature_choice_errors_name_the_plane():
    with pytest.raises(InputError, match=r"'Nz'.*R, G, B"):
        feature_names(DetectorConfig(features=("Nz",)), ("R", "G", "B"))
    with pytest.raises(InputError, match="'Samples'"):
        feature_names(DetectorConfig(features=("Samples",)), ("R", "G", "B", "Samples"))


@pytest.mark.parametrize("weights", [(0.0, 0.0, 0.0), (-0.1, 0.6, 0.5)])
def test_weights_that_leave_no_brightness_are_refused(weights):
    with pytest.raises(InputError, match="`luminance` must be weights that are not negative, and not all 0"):
        DetectorConfig(luminance=weights)


@pytest.mark.parametrize(
    ("luminance", "weights"), [("rec709", (0.2126, 0.7152, 0.0722)), ("rec601", (0.299, 0.587, 0.114))]
)
def test_each_colour_is_as_bright_as_its_standard_says(luminance: Any, weights: tuple[float, ...]) -> None:
    """ITU-R BT.709 and BT.601, of a red, a green and a blue pixel."""
    colours = Frame(np.eye(3, dtype=np.float32)[:, None].copy(), ("R", "G", "B"))
    detector = Detector(DetectorConfig(method="esim", luminance=luminance), 3, 1, colours.names)
    detector.step(colours)
    np.testing.assert_allclose(detector.level(), np.log([weights]), atol=1e-5)


@pytest.mark.parametrize(
    ("name", "least", "most", "step"),
    [
        ("window", 3, 21, 2), ("stride", 1, 3, 1), ("history", 1, 5, 1), ("box", 1, 21, 2),
        ("ridge", 0.0, 1.0, 1e-3), ("confidence", 0.0, 100.0, 1e-3),
    ],
)  # fmt: skip
def test_an_option_reaches_from_end_to_end_of_its_range(name: str, least: float, most: float, step: float) -> None:
    for value in (least, most):
        assert getattr(DetectorConfig(**{name: value}), name) == value
    for value in (least - step, most + step):
        with pytest.raises(InputError, match=f"^`{name}` must be"):
            DetectorConfig(**{name: value})


@pytest.mark.parametrize("rule", ["interpolated", "linear-light", "frame"])
@pytest.mark.parametrize(("method", "response"), [("esim", "ln"), ("esim", "lin-log"), ("wlr-esim", "ln")])
def test_it_is_told_at_which_thresholds_a_pixel_fires_just_where_it_fires_at_all_of_them(
    method: Any, response: Any, rule: Any
) -> None:
    """One pixel brightens by 2.5 thresholds, beside others that do not; so 2 events are its own crossings."""
    if rule == "linear-light" and response != "ln":
        return
    config = DetectorConfig(method=method, response=response, event_rule=rule, scale=0.03, threshold_on=0.1)
    brighter = np.zeros((5, 5))
    brighter[2, 2] = 0.25
    frames = [make_frame(brighter * k, k) for k in range(2)]
    events = run(Detector(config, 5, 5, frames[0].names), frames)
    assert (config.fires_at == (0.1, 0.2)) == (len(events) == 2) and config.fires_at in ((0.1, 0.2), None)


@pytest.mark.parametrize("value", [0.3, 0.7])
def test_a_plane_is_regressed_on_once_a_single_pixel_of_it_differs(value: float) -> None:
    """As where something small comes into view; until then it is left out."""
    frames = random_frames(3, count=3)
    for frame in frames:
        frame.plane("Nx")[...] = 0.5
    frames[2].plane("Nx")[6, 4] = value
    detector = Detector(DetectorConfig(method="wlr-esim", window=5), frames[0].width, frames[0].height, frames[0].names)
    known = []
    for frame in frames:
        detector.step(frame)
        known.append("Nx" in detector.features)
    assert known == [False, False, True] and "Ny" in detector.features


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


@pytest.mark.parametrize("gate", ["delta-r", "delta-r-exact", "published"])
def test_a_gate_that_sees_surfaces_alone_refuses_pictures(gate):
    """With the paper's gate a video had no events at all, and the threshold was blamed."""
    config = DetectorConfig(gate=gate)
    with pytest.raises(InputError, match=f"`gate` {gate} sees changes of surfaces.* expected radiance"):
        feature_names(config, RADIANCE)
    assert feature_names(config, (*RADIANCE, "Depth")) == ("Depth",)
    assert feature_names(DetectorConfig(gate="radiance"), RADIANCE) == ()
