"""What cannot work is named as Python spells it there, and as the command line spells it here."""

import dataclasses
import inspect
import os
import subprocess
import sys
from typing import get_args, get_type_hints

import pytest

from clsim.cli.commands.detect import detect
from clsim.cli.options.texts import told
from clsim.cli.spelling import CONFIG_KEYS, as_options
from clsim.detect.config import DetectorConfig
from clsim.errors import InputError
from clsim.live.options import LiveOptions

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
    "confidence": -1.0,
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
        ("`max_depth` must be at most `spp`, got 9", "--max-depth must be at most --spp, got 9"),
        ("`probe_spp` must be at most `spp`, got 9", "`probe_spp` must be at most --spp, got 9"),
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


def commands(group: object = None, prefix: tuple[str, ...] = ()) -> dict[tuple[str, ...], object]:
    """Return every command by the words that call it."""
    import typer.main

    from clsim.cli.app import app

    found: dict[tuple[str, ...], object] = {}
    for name, command in (group or typer.main.get_command(app)).commands.items():  # type: ignore[attr-defined]
        words = (*prefix, name)
        found |= commands(command, words) if hasattr(command, "commands") else {words: command}
    return found


def options(command: object) -> list[object]:
    return [parameter for parameter in command.params if parameter.param_type_name == "option"]  # type: ignore[attr-defined]


@pytest.mark.parametrize(("words", "most"), [(("live",), 15), (("render",), 14), (("detect",), 14), (("view",), 14)])
def test_few_options_stand_in_front(words: tuple[str, ...], most: int) -> None:
    plain = [option for option in options(commands()[words]) if option.rich_help_panel is None]  # type: ignore[attr-defined]
    assert len(plain) + 1 <= most, [option.opts for option in plain]  # and --help


def test_other_settings_of_a_run_are_keys_of_a_file() -> None:
    """Each field of a run is an option of `clsim live` or a key for ``--config``, and what stands apart is not much."""
    live = commands()[("live",)]
    named = {option.opts[0] for option in options(live)}  # type: ignore[attr-defined]
    fields = {field.name for field in dataclasses.fields(LiveOptions)} - {"scene", "files"}
    assert {name for name in fields if as_options(f"`{name}`") not in named} == CONFIG_KEYS
    assert len([option for option in options(live) if option.rich_help_panel is not None]) <= 25  # type: ignore[attr-defined]


def test_the_text_of_an_option_is_that_of_its_field() -> None:
    assert all(told(field.name) for field in dataclasses.fields(LiveOptions) if field.name != "files")
    assert (
        told("max_depth") == "Longest light path [edges]: 1 sees emitters only, 2 adds direct light, 3 one bounce. [8]"
    )
    assert told("spp").endswith(", at most. [the quality's]")
    assert told("governor") == "With --pace real, render less rather than fall behind. [yes]"
    assert told("loop").endswith("for ever or until --duration.")
    duration = "Simulated time [s], rounded to whole frames. Such as 2s. [the scene's motion, once]"
    assert told("duration_s", "Such as 2s.") == duration
    assert told("floor", default="the frames'") == "Smallest luminance after scaling. [the frames']"
    assert told("RecordedSensor.seed") == "Seed of the sensor's random numbers. [0]" != told("seed")


def test_one_name_means_one_thing() -> None:
    """An option of one name takes the same kind of value in every command."""
    kinds: dict[str, dict[object, list[str]]] = {}
    for words, command in commands().items():
        hints = get_type_hints(inspect.unwrap(command.callback))  # type: ignore[attr-defined]
        for option in options(command):
            kind = hints[option.name]  # type: ignore[attr-defined]
            values = {part for part in get_args(kind) if part is not type(None)} or {kind}
            kinds.setdefault(option.opts[0], {}).setdefault(frozenset(values), []).append(" ".join(words))  # type: ignore[attr-defined]
    # Frames go into one folder, events to any number of places; a choice may be smaller in one command.
    several = {
        name: found for name, found in kinds.items() if len(found) > 1 and name not in ("--out", "--view", "--gate")
    }
    assert several == {}
    assert kinds["--json"].keys() == {frozenset({bool})} and kinds["--resolution"].keys() == {frozenset({str})}
    assert "--width" not in kinds and "--height" not in kinds


def test_a_shell_completes_commands() -> None:
    asked = {"COMP_WORDS": "clsim li", "COMP_CWORD": "1", "_CLSIM_COMPLETE": "complete_bash"}
    command = [sys.executable, "-c", "from clsim.cli import main; main()"]
    told = subprocess.run(command, env=os.environ | asked, capture_output=True, text=True, timeout=60)
    assert told.stdout.split() == ["live"]
