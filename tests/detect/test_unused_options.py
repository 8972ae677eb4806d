"""Options are called unused just where they change no event; gates that need old windows refuse live frames."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detect.reference import ReferenceDetector
from clsim.detector import Detector, recorded_detector
from clsim.errors import InputError
from clsim.frames import Frame
from tests.detect.reference_scenes import random_frames, run

BASES = {
    "esim": {},
    "irradiance": {},
    "wlr-esim": {},
    "esim-ad": {},
    "esim-ad delta-r": {"gate": "delta-r"},
    "esim-ad published": {"gate": "published"},
}
REFUSED = [("esim-ad published", option) for option in ("regress", "shrink", "bandwidth")]
CHANGES = {
    "gate": {"gate": "delta-r"},
    "gate_scale": {"gate_scale": 0.3},
    "box": {"box": 9},
    "event_rule": {"event_rule": "frame"},
    "threshold_on": {"threshold_on": 0.15, "threshold_off": 0.15},
    "window": {"window": 3},
    "stride": {"stride": 2},
    "history": {"history": 3},
    "kernel": {"kernel": "epanechnikov"},
    "bandwidth": {"bandwidth": "optimised"},
    "bandwidth_h": {"bandwidth_h": 0.4},
    "ridge": {"ridge": 0.5},
    "regress": {"regress": "linear"},
    "shrink": {"regress": "linear", "shrink": 0.5},
    "response": {"response": "lin-log"},
    "luminance": {"luminance": "rec601"},
    "scale": {"scale": 4e-3},
    "floor": {"floor": 0.05},
    "features": {"features": ("Nx",)},
}


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    """Coloured frames with every plane that a method may ask for."""
    result = []
    for frame in random_frames(3, count=5, noise=0.2, step=1.0):
        frame.planes[:3] *= 0.1
        frame.plane("Variance.Luminance")[:] *= 0.1**2
        frame.planes[0] *= np.linspace(0.5, 1.5, frame.height, dtype=np.float32)[:, None] + 0.1 * frame.index
        size = (frame.height, frame.width)
        more = {"Emission": 0.0, "Samples": 4.0, **{f"Variance.{name}": 1e-3 for name in frame.names[:-1]}}
        planes = [frame.planes, *(np.full((1, *size), value, np.float32) for value in more.values())]
        result.append(Frame(np.concatenate(planes), (*frame.names, *more), frame.time_us, frame.index))
    return result


@pytest.fixture(scope="module")
def events(frames: list[Frame]) -> Callable[[DetectorConfig], np.ndarray]:
    """Return the events of a configuration, found once."""
    size = frames[0].width, frames[0].height
    return cache(lambda config: run(ReferenceDetector(config, *size, frames[0].names), frames))


@pytest.mark.parametrize(("base", "option"), [pair for pair in product(BASES, CHANGES) if pair not in REFUSED])
def test_an_unused_option_is_one_that_changes_nothing(
    base: str, option: str, events: Callable[[DetectorConfig], np.ndarray]
) -> None:
    plain = DetectorConfig(method=base.split()[0], window=7, threshold_on=0.1, threshold_off=0.1, **BASES[base])
    if option == "shrink":
        plain = replace(plain, regress="linear")
    change = CHANGES[option]
    if option == "gate" and plain.gate == change["gate"]:
        change = {"gate": "published"}
    changed = replace(plain, **change)
    assert len(events(plain))
    assert (option in changed.unused()) == np.array_equal(events(plain), events(changed))


@pytest.mark.parametrize(("base", "option"), REFUSED)
def test_an_option_that_cannot_work_is_refused(base: str, option: str) -> None:
    with pytest.raises(InputError, match=r"^`gate` published needs `(regress` log|bandwidth` fixed)"):
        DetectorConfig(method="esim-ad", **BASES[base], **CHANGES[option])


def test_defaults_are_no_unused_options() -> None:
    for method in ("esim", "irradiance", "wlr-esim", "esim-ad"):
        assert DetectorConfig(method=method).unused() == ()


def test_who_has_no_use_for_an_option_is_the_gate_where_there_is_one() -> None:
    assert DetectorConfig(method="esim-ad", gate="delta-r").who() == "`gate` delta-r"
    assert DetectorConfig(method="wlr-esim", gate="delta-r").who() == "`method` wlr-esim"


@pytest.mark.parametrize("gate", ["delta-r-exact", "published"])
def test_gates_that_keep_old_windows_work_on_recorded_frames_alone(gate):
    frames = random_frames(15, count=3)
    size = (frames[0].width, frames[0].height, frames[0].names)
    plain = DetectorConfig(window=5, threshold_on=0.15, threshold_off=0.12)
    config = replace(plain, gate=gate)
    with pytest.raises(InputError, match="needs old windows"):
        Detector(config, *size)
    recorded = recorded_detector(config, *size)
    np.testing.assert_array_equal(run(recorded, frames), run(ReferenceDetector(config, *size), frames))
    assert recorded.stats.events > 0
    recorded.close()
    assert isinstance(recorded_detector(plain, *size), Detector)
