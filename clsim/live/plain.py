"""Dataclasses of options to plain values, as JSON holds them, and back."""

from __future__ import annotations

import types
from collections.abc import Mapping
from dataclasses import MISSING, asdict, fields, is_dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from clsim.errors import InputError

Options = TypeVar("Options")


def to_plain(options: Any) -> dict[str, Any]:
    """Return the fields of a dataclass by name; paths are texts, and dataclasses within are dicts."""
    return {key: str(value) if isinstance(value, Path) else value for key, value in asdict(options).items()}


def from_plain(kind: type[Options], plain: Mapping[str, Any]) -> Options:
    """Return the dataclass ``kind`` with the values of ``plain``; what is not in it keeps its default.

    Raises:
        InputError: a key is unknown, one without a default is missing, or a value is of another type.
    """
    hints = get_type_hints(kind)
    known = {field.name: field for field in fields(kind)}  # type: ignore[arg-type]
    for key in plain:
        if key not in known:
            close = get_close_matches(key, known, 1)
            hint = f"did you mean {close[0]!r}?" if close else f"expected one of {', '.join(known)}"
            raise InputError(f"there is no option {key!r}; {hint}")
    for name, field in known.items():
        if name not in plain and field.default is MISSING and field.default_factory is MISSING:
            raise InputError(f"`{name}` is missing")
    values = {}
    for key, value in plain.items():
        try:
            values[key] = _read(hints[key], value)
        except TypeError:
            raise InputError(f"`{key}` must be {_words(hints[key])}, got {value!r}") from None
    return kind(**values)


def _read(kind: Any, value: Any) -> Any:
    """Return a value of JSON as one of ``kind``; raises TypeError where it is none."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        for part in parts:
            try:
                return _read(part, value)
            except TypeError:
                continue
    elif origin is Literal:
        if value in parts and type(value) in {type(part) for part in parts}:
            return value
    elif origin is tuple:
        if isinstance(value, list | tuple):
            items = parts[:1] * len(value) if parts[1:] == (...,) else parts
            if len(items) == len(value):
                return tuple(map(_read, items, value))
    elif is_dataclass(kind):
        if isinstance(value, Mapping):
            return from_plain(cast(type[Any], kind), value)
    elif kind is float:
        if isinstance(value, int | float) and not isinstance(value, bool):
            return float(value)
    elif isinstance(value, kind) and (kind is bool or not isinstance(value, bool)):
        return value
    raise TypeError


def _words(kind: Any) -> str:
    """Return what values of a type look like in JSON."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(map(_words, parts)))
    if origin is Literal:
        return f"one of {', '.join(map(repr, parts))}"
    if origin is tuple:
        return "a list of texts" if parts[1:] == (...,) else f"a list of {len(parts)} numbers"
    names = {float: "a number", int: "a whole number", bool: "true or false", str: "a text", Path: "a text"}
    return names.get(kind, "null" if kind is types.NoneType else "an object")
