"""What cannot work is named as Python spells it there, and as the command line spells it here."""

import inspect

import pytest

from clsim.cli.detect import detect
from clsim.cli.spelling import as_options
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
    option = as_options(str(refused.value)).split()[0]
    assert option in options and option[2:] in name.replace("_", "-")


@pytest.mark.parametrize(
    ("message", "printed"),
    [
        ("`probe_spp` must be at most `spp`, got 9", "--probe-spp must be at most --spp, got 9"),
        ("`duration_s` and `outputs` differ", "--duration and --out differ"),
        ("or `clsim detect` on recorded frames", "or `clsim detect` on recorded frames"),
        ("`threshold_on` must be positive", "--threshold must be positive"),
    ],
)
def test_fields_are_printed_as_options(message: str, printed: str) -> None:
    assert as_options(message) == printed


def test_python_users_read_fields() -> None:
    with pytest.raises(InputError, match=r"^`gate_scale` must be a positive number, got -1\.0$"):
        DetectorConfig(gate_scale=-1.0)
