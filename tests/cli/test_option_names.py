"""What cannot work is named as the command line spells it."""

import inspect

import pytest

from clsim.cli.detect import detect
from clsim.detect.config import DetectorConfig
from clsim.errors import InputError

WRONG = {
    "method": "v2e",
    "gate": "open",
    "event_rule": "none",
    "kernel": "box",
    "bandwidth": "wide",
    "response": "log",
    "regress": "cubic",
    "luminance": "rec2020",
    "precision": "float16",
    "threshold_on": 0.0,
    "threshold_off": float("nan"),
    "floor": 1e-40,
    "bandwidth_h": 0.0,
    "gate_scale": -1.0,
    "scale": float("inf"),
    "window": 12,
    "stride": 4,
    "history": 9,
    "box": 2,
    "ridge": 2.0,
    "shrink": 1.5,
}


@pytest.mark.parametrize("name", WRONG)
def test_options_of_the_detector(name: str) -> None:
    options = {f"--{parameter.replace('_', '-')}" for parameter in inspect.signature(detect).parameters}
    with pytest.raises(InputError) as refused:
        DetectorConfig(**{name: WRONG[name]})
    option = str(refused.value).split()[0]
    assert option in options and option[2:] in name.replace("_", "-")
