"""The one place that reads what users give: values by the types that dataclasses declare, from Python or from JSON."""

from __future__ import annotations

import gzip
import math
import os
import re
import sys
import types
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from difflib import get_close_matches
from functools import cache
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from clsim.errors import InputError

Options = TypeVar("Options")

_LARGEST_WHOLE = (1 << 64) - 1
_LONGEST_SHOWN = 200


def toml_problem(text: str, error: Exception) -> str:
    """Return what a reader of TOML found wrong, on one line, and what to write if that is a number's point."""
    said = str(error).splitlines()[0]
    place = re.search(r"\(at line (\d+), column (\d+)\)", said)
    if place is None:
        return said
    line, column = text.split("\n")[int(place[1]) - 1], int(place[2]) - 1
    bare = re.match(r"[+-]?\.\d", line[column:]) or re.match(r"\d\.(?!\d)", line[max(column - 1, 0) :])
    return f"{said}; a number needs a digit before and after its point, as 0.1" if bare else said


def read_text(path: Path, most_bytes: int, expected: str, name: str | None = None) -> str:
    """Return the text of a user's file, which is ``expected``; ``name`` is what messages call it, if not by its path.

    Raises:
        InputError: it cannot be read, is larger than ``most_bytes``, or is no UTF-8.
    """
    name = name or str(path)
    try:
        if path.suffix == ".gz":
            data = unzipped(path, most_bytes)
        else:
            with path.open("rb") as file:
                data = file.read(most_bytes + 1)
        if len(data) > most_bytes:
            raise InputError(f"{name}: is larger than {most_bytes >> 20} MiB, expected {expected}")
        return data.decode("utf-8-sig").replace("\r\n", "\n")
    except OSError as error:
        raise InputError(f"{name}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{name}: is not UTF-8 text (byte {error.start})") from None


def unzipped(path: Path, most_bytes: int) -> bytes:
    """Return what a file of gzip holds, and at most one byte more than ``most_bytes``: a small file may hold a lot.

    Raises:
        OSError: it cannot be read.
        InputError: it is damaged.
    """
    try:
        with gzip.open(path) as file:
            return file.read(most_bytes + 1)
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise InputError(f"{path}: is damaged, or is no gzip file ({error})") from None


def hint(name: str, known: Iterable[str]) -> str:
    """Return what to write instead of a name that is not known: the one that it looks like, or any."""
    known = list(known)
    close = get_close_matches(name, known, 1)
    return f"did you mean {close[0]!r}?" if close else f"expected one of {', '.join(known)}"


def from_plain(kind: type[Options], plain: Mapping[str, Any]) -> Options:
    """Return the dataclass ``kind`` with the values of ``plain``; what is not in it keeps its default.

    Raises:
        InputError: a key is unknown, one without a default is missing, or the dataclass refuses a value.
    """
    known = {field.name: field for field in fields(kind)}  # type: ignore[arg-type]
    for key in plain:
        if key not in known:
            raise InputError(f"there is no option {_shown(key)}; {hint(str(key), known)}")
    for name, field in known.items():
        if name not in plain and field.default is MISSING and field.default_factory is MISSING:
            raise InputError(f"`{name}` is missing")
    return kind(**plain)


_hints: Callable[[Any], dict[str, Any]] = cache(get_type_hints)


def read_fields(options: Any) -> None:
    """Put what `read_value` makes of them in place of the fields of a frozen dataclass; for its ``__post_init__``."""
    kinds = _hints(type(options))
    for name in (field.name for field in fields(options)):
        object.__setattr__(options, name, read_value(name, getattr(options, name), kinds[name]))


def read_value(name: str, value: Any, kind: Any) -> Any:
    """Return the value of a parameter as one of the declared type ``kind``.

    Numbers of numpy count as Python's, paths as text, lists as tuples, and one value as a tuple of it where there may
    be any number.

    Raises:
        InputError: it is none, or a number that is not finite.
    """
    try:
        return _reader(kind)(_without_numpy(value))
    except TypeError:
        raise InputError(f"`{name}` must be {_words(kind)}, got {_shown(value)}") from None


def _without_numpy(value: Any) -> Any:
    """Return Python's number or list in place of one of numpy, which is not loaded for that."""
    if type(value) in _PLAIN:  # most are, and simulators that are driven read some in each step
        return value
    numpy = sys.modules.get("numpy")
    return value.tolist() if numpy is not None and isinstance(value, numpy.ndarray | numpy.generic) else value


@cache
def _reader(kind: Any) -> Callable[[Any], Any]:
    """Return what makes a value of Python one of ``kind``, and raises TypeError where it is none."""
    if kind in _READERS:
        return _READERS[kind]
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return _reader_of_any(tuple(map(_reader, parts)))
    if origin is Literal:
        return _reader_of_words(parts)
    if origin is tuple and parts[1:] == (...,):
        return _reader_of_many(_reader(parts[0]))
    if origin is tuple:
        return _reader_of_each(tuple(map(_reader, parts)))
    return _reader_of_class(kind)


def _reader_of_any(readers: tuple[Callable[[Any], Any], ...]) -> Callable[[Any], Any]:
    def read(value: Any) -> Any:
        for reader in readers:
            try:
                return reader(value)
            except TypeError:
                continue
        raise TypeError

    return read


def _reader_of_words(words: tuple[str, ...]) -> Callable[[Any], Any]:
    def read(value: Any) -> Any:
        if isinstance(value, str) and value in words:
            return str(value)
        raise TypeError

    return read


def _reader_of_many(reader: Callable[[Any], Any]) -> Callable[[Any], Any]:
    def read(value: Any) -> Any:
        return tuple(reader(_without_numpy(item)) for item in (value if isinstance(value, list | tuple) else (value,)))

    return read


def _reader_of_each(readers: tuple[Callable[[Any], Any], ...]) -> Callable[[Any], Any]:
    def read(value: Any) -> Any:
        if not isinstance(value, list | tuple) or len(value) != len(readers):
            raise TypeError
        return tuple(reader(_without_numpy(item)) for reader, item in zip(readers, value, strict=True))

    return read


def _reader_of_class(kind: Any) -> Callable[[Any], Any]:
    def read(value: Any) -> Any:
        if is_dataclass(kind) and isinstance(value, Mapping):
            return from_plain(kind, value)  # type: ignore[arg-type]
        if isinstance(value, kind):
            return value
        raise TypeError

    return read


def _read_number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, Real):
        raise TypeError
    try:
        number = float(value)
    except OverflowError:
        raise TypeError from None
    if not math.isfinite(number):
        raise TypeError
    return number


def _read_whole(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, Integral) or abs(int(value)) > _LARGEST_WHOLE:
        raise TypeError
    return int(value)


def _read_truth(value: Any) -> bool:
    if isinstance(value, bool):
        return value
    raise TypeError


def _read_text(value: Any) -> str:
    text = os.fspath(value)
    if not isinstance(text, str) or "\0" in text:
        raise TypeError
    try:
        os.fsencode(text)
    except UnicodeEncodeError:  # half a character
        raise TypeError from None
    return text


_READERS = {float: _read_number, int: _read_whole, bool: _read_truth, str: _read_text}


def _words(kind: Any) -> str:
    """Return what values of a type look like, None apart: who gives a value means one."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(_words(part) for part in parts if part is not types.NoneType))
    if origin is Literal:
        return f"one of {', '.join(parts)}"
    if origin is tuple and parts[1:] != (...,):
        return f"a list of {len(parts)} {_NAMES[parts[0]][1]}"
    if origin is tuple:
        return f"a list of {_NAMES[parts[0]][1]}"
    return _NAMES[kind][0] if kind in _NAMES else f"{kind.__name__} or its fields by name"


_PLAIN = frozenset({bool, int, float, str, types.NoneType})
_NAMES = {
    float: ("a finite number", "finite numbers"),
    int: ("a whole number", "whole numbers"),
    bool: ("true or false", "truths"),
    str: ("a text", "texts"),
}


def _shown(value: Any) -> str:
    try:
        text = repr(value)
    except Exception:  # some objects have no repr, and some whole numbers too many digits
        return f"one of type {type(value).__name__}"
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}…"
