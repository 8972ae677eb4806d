"""Sensors by name, and from files of the user's own."""

from __future__ import annotations

import importlib
import os
import sys
from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path
from typing import Any

from clsim.errors import InputError
from clsim.sensor.settings import SensorSettings
from clsim.values import from_plain, toml_problem

ALIASES = {"imx636": "gen4.1"}
"""Names of one chip."""
LARGEST_FILE = 1 << 20


def preset_names() -> tuple[str, ...]:
    """Return the names of the sensors that come with clsim."""
    found = (entry.name for entry in (files("clsim.sensor") / "presets").iterdir())
    return tuple(sorted([name.removesuffix(".toml") for name in found if name.endswith(".toml")] + list(ALIASES)))


def load_sensor(sensor: str) -> SensorSettings:
    """Return a sensor by the name of a preset, or from a TOML file.

    A file has a table for each stage of `SensorSettings`, with its numbers, all of which may be left out; ``base``
    names the preset or file that says the rest.

    Raises:
        InputError: there is none, or it says what cannot be.
    """
    name = sensor.lower()
    if name in preset_names():
        resource = files("clsim.sensor") / "presets" / f"{ALIASES.get(name, name)}.toml"
        return _settings(name, _parsed(name, resource.read_bytes()))
    path = Path(sensor)
    if path.suffix.lower() != ".toml":
        close = get_close_matches(name, preset_names(), 1)
        hint = f"did you mean {close[0]}?" if close else f"expected one of {', '.join(preset_names())}, or a .toml file"
        raise InputError(f"`sensor`: there is no sensor {sensor!r}; {hint}")
    return _settings(path.stem, _read(path, []), str(path))


def _read(path: Path, on_the_way: list[Path]) -> dict[str, Any]:
    """Return a file's tables over those of its base."""
    if any(os.path.realpath(path) == os.path.realpath(each) for each in on_the_way):
        raise InputError(f"{path}: is its own `base`")
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_FILE + 1)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    if len(data) > LARGEST_FILE:
        raise InputError(f"{path}: is larger than {LARGEST_FILE} bytes, expected a sensor's few numbers")
    tables = _parsed(str(path), data)
    base = tables.pop("base", None)
    if base is None:
        return tables
    if not isinstance(base, str):
        raise InputError(f"{path}: `base` must be a preset's name or a file, got {base!r}")
    if base.lower() in preset_names():
        resource = files("clsim.sensor") / "presets" / f"{ALIASES.get(base.lower(), base.lower())}.toml"
        below = _parsed(base, resource.read_bytes())
    else:
        below = _read(path.parent / base, [*on_the_way, path])
    below.pop("name", None)
    return below | {
        key: {**below[key], **value} if isinstance(value, dict) and isinstance(below.get(key), dict) else value
        for key, value in tables.items()
    }


def _parsed(place: str, data: bytes) -> dict[str, Any]:
    tomllib: Any = importlib.import_module("tomllib" if sys.version_info >= (3, 11) else "tomli")
    text = ""
    try:
        text = data.decode("utf-8-sig")
        parsed: dict[str, Any] = tomllib.loads(text)
    except UnicodeDecodeError:
        raise InputError(f"{place}: is no text in UTF-8") from None
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(f"{place}: is no TOML ({toml_problem(text, error)})") from None
    return parsed


def _settings(name: str, tables: dict[str, Any], place: str | None = None) -> SensorSettings:
    try:
        return from_plain(SensorSettings, {"name": name, **tables})
    except InputError as error:
        raise InputError(f"{place or name}: {error}") from None
