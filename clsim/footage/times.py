"""Lists of times of frames, from files and from programs."""

from __future__ import annotations

import operator
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from clsim.errors import InputError
from clsim.footage import TimeUnit

_PER_US: dict[str, tuple[int, int]] = {"s": (1_000_000, 1), "ms": (1000, 1), "us": (1, 1), "ns": (1, 1000)}
_LARGEST_FILE = 1 << 30
_LATEST_US = 1 << 62
_NUMBER = re.compile(r"[+-]?(\d+)?(?:\.(\d*))?(?:[eE]([+-]?\d{1,3}))?")


def read_times_us(path: str | Path, unit: TimeUnit) -> list[int]:
    """Read times of frames [µs] from a ``.npy`` array, or from text whose lines begin with a time.

    What follows a time after a space or comma, such as a file's name, and lines that begin with ``#`` are passed over.
    Text is read exactly: no digit is lost to floating point.

    Raises:
        InputError: the file cannot be read, a line has no time, or times do not rise.
    """
    path = Path(path)
    try:
        if path.stat().st_size > _LARGEST_FILE:
            raise InputError(f"{path}: is too large for a list of times")
        if path.suffix.lower() == ".npy":
            times = _of_array(path, unit)
        else:
            text = path.read_text(encoding="utf-8-sig", errors="replace")
            if "\0" in text:
                raise InputError(f"{path}: is no text; expected times of frames, one a line, or a .npy array")
            told = [
                (k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")
            ]
            times = [_of_line(path, k, line, unit) for k, line in told]
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected times of frames") from None
    if not times:
        raise InputError(f"{path}: holds no times; expected one a line")
    check_rising(times, str(path))
    return times


def check_rising(times_us: list[int], where: str) -> None:
    """Raise InputError unless times are not negative and each is later than the one before; ``where`` names them."""
    if times_us[0] < 0:
        raise InputError(f"{where}: the first time is {times_us[0]} µs, expected 0 or later")
    for k, (before, after) in enumerate(pairwise(times_us), 1):
        if after <= before:
            raise InputError(f"{where}: frame {k} is at {after} µs, expected later than {before} µs of the one before")


def read_time_us(value: Any, index: int) -> int:
    """Return what a program gives as the time of a frame, rounded to whole µs.

    Raises:
        InputError: it is no number, or one of numpy's times, whose unit would be lost.
    """
    try:
        if getattr(getattr(value, "dtype", None), "kind", None) in ("m", "M"):
            raise TypeError
        try:
            time_us = operator.index(value)
        except TypeError:
            time_us = round(float(value))
        if abs(time_us) < _LATEST_US:
            return time_us
    except (TypeError, ValueError, OverflowError):
        pass
    raise InputError(f"`times_us` must be numbers of µs, got {value!r} for frame {index}")


def _of_array(path: Path, unit: TimeUnit) -> list[int]:
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise InputError(f"{path}: is no array of numbers ({str(error).splitlines()[0]})") from None
    if array.dtype.kind not in "iuf" or array.ndim != 1:
        raise InputError(f"{path}: is an array of {array.dtype} {list(array.shape)}, expected one row of times")
    multiply, divide = _PER_US[unit]
    if array.dtype.kind == "f":
        scaled = array.astype(np.float64) * multiply / divide
        if not (np.abs(scaled) < _LATEST_US).all():
            raise InputError(f"{path}: holds a time that is not finite or too late")
        return [int(value) for value in np.rint(scaled)]
    return [round(int(value) * multiply / divide) if divide > 1 else int(value) * multiply for value in array]


def _of_line(path: Path, number: int, line: str, unit: TimeUnit) -> int:
    word = re.split(r"[\s,;]", line.strip(), maxsplit=1)[0]
    match = _NUMBER.fullmatch(word)
    if match is None or not (match[1] or match[2]) or len(word) > 60:
        raise InputError(f"{path}: line {number} begins with {word[:40]!r}, expected a time in {unit}")
    digits = (match[1] or "") + (match[2] or "")
    multiply, divide = _PER_US[unit]
    power = int(match[3] or 0) - len(match[2] or "")
    top, below = int(digits) * multiply, divide
    if abs(power) > 60:
        raise InputError(f"{path}: line {number} begins with {word[:40]!r}, which is no time of a frame")
    top, below = (top * 10**power, below) if power >= 0 else (top, below * 10**-power)
    time_us = (2 * top + below) // (2 * below) * (-1 if word.startswith("-") else 1)
    if abs(time_us) >= _LATEST_US:
        raise InputError(f"{path}: line {number} has the time {word[:40]} {unit}, which is too late")
    return time_us
