"""TOML in and out."""

from __future__ import annotations

import importlib
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from clsim.errors import InputError
from clsim.values import toml_problem


def read_toml(path: Path) -> dict[str, Any]:
    """Read a file; raises InputError where it is not there or no TOML."""
    tomllib: Any = importlib.import_module("tomllib" if sys.version_info >= (3, 11) else "tomli")
    text = ""
    try:
        text = path.read_text(encoding="utf-8-sig")
        told: dict[str, Any] = tomllib.loads(text)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected a file in TOML") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{path}: is no TOML ({toml_problem(text, error)})") from None
    return told


def to_toml(scene: Mapping[str, Any]) -> str:
    """Return a table as TOML, one key of the top level a line."""
    plain = [f"{_key(key)} = {_value(each)}" for key, each in scene.items() if not isinstance(each, Mapping)]
    tables = [
        "\n".join([f"\n[{_key(key)}]", *(f"{_key(name)} = {_value(value)}" for name, value in each.items())])
        for key, each in scene.items()
        if isinstance(each, Mapping)
    ]
    return "\n".join([*plain, *tables]) + "\n"


def _key(key: str) -> str:
    return key if key.replace("_", "").replace("-", "").isalnum() and key.isascii() else _value(key)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        if not math.isfinite(value):
            raise InputError(f"{value} is no number for a scene")
        return repr(value)
    if isinstance(value, str):
        text = value.replace("\\", "\\\\").replace('"', '\\"')
        return '"' + "".join(c if c >= " " and c != "\x7f" else f"\\u{ord(c):04X}" for c in text) + '"'
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(key)} = {_value(each)}" for key, each in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    raise InputError(f"{value!r} cannot stand in a scene")
