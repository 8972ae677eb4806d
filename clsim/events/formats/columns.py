"""The one door for events that come as columns of numbers: arrays, archives, tables, text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events.batch import EventBatch, empty_batch

NAMES = {
    "t": ("t", "ts", "time", "times", "timestamp", "timestamps"),
    "x": ("x", "xs"),
    "y": ("y", "ys"),
    "p": ("p", "ps", "on", "pol", "polarity", "polarities"),
}
"""What the columns of events are called."""
_LATEST_US = 10**17
"""In the year 5138: what is later counts in another unit."""
_MOST_FALLS, _FEW_FALLS = 0.1, 10


class ColumnError(InputError):
    """Columns that hold no events; its text has column, row and value, and does not know the file."""


def from_columns(t: Any, x: Any, y: Any, p: Any, *, first_row: int = 0, **labels: Any) -> EventBatch:
    """Return one batch of columns of numbers, with fields for labels; the first is row ``first_row`` of its file.

    Columns are t [µs], x, y and p, which is 0 or -1 where brightness fell, and 1 where it rose. Floating point is taken
    where all numbers are whole.

    Raises:
        ColumnError: they are of different lengths, or hold what is no event; names column, row and value.
    """
    if len({len(column) for column in (t, x, y, p)}) > 1:
        raise ColumnError(f"its columns t, x, y, p have {len(t)}, {len(x)}, {len(y)}, {len(p)} rows; expected as many")
    events = empty_batch(len(t), tuple(labels))
    events["t"] = _whole("t", t, 0, _LATEST_US, "whole µs", first_row)
    for name, column in (("x", x), ("y", y)):
        events[name] = _whole(name, column, 0, 65535, "0 to 65535", first_row)
    polarity = _whole("p", p, -1, 1, "0 and 1, or -1 and 1", first_row)
    if (polarity == -1).any() and (polarity == 0).any():
        raise ColumnError("column p has both 0 and -1; expected 0 and 1, or -1 and 1")
    events["on"] = polarity > 0
    for name, column in labels.items():
        if column.dtype.kind not in "iub":
            raise ColumnError(f"column {name} has type {column.dtype}; expected whole numbers")
        events[name] = column
    return events


def find_columns(names: Iterable[str]) -> dict[str, str] | None:
    """Return what t, x, y and p are called among the names of columns; None where one is missing or there twice."""
    found: dict[str, str] = {}
    for name in names:
        word = name.strip().lower()
        for column, spellings in NAMES.items():
            if word in spellings:
                if column in found:
                    return None
                found[column] = name
    return found if len(found) == len(NAMES) else None


def named(columns: Mapping[str, Any], *, first_row: int = 0) -> EventBatch:
    """Return the batch of columns by their names; raises ValueError as `from_columns` does, or where one is missing."""
    found = find_columns(columns)
    if found is None:
        raise ColumnError(f"its columns are {', '.join(columns)}; expected t, x, y and p, each once")
    return from_columns(*(np.asarray(columns[found[name]]) for name in NAMES), first_row=first_row)


def check_unnamed(t: npt.NDArray[Any]) -> None:
    """Raise ValueError where the first of four columns without names can be no time, for it goes up and down."""
    falls = int(np.count_nonzero(t[1:] < t[:-1]))
    if falls > max(_MOST_FALLS * len(t), _FEW_FALLS):
        raise ColumnError(
            f"its columns have no names, and the first goes back in {falls} of {len(t)} rows; expected the columns "
            "t, x, y, p in this order"
        )


def _whole(
    name: str, column: npt.NDArray[Any], low: int, high: int, expected: str, first_row: int
) -> npt.NDArray[np.int64]:
    """Return a column as whole numbers within bounds."""
    if column.dtype.kind not in "iubf" or column.ndim != 1:
        raise ColumnError(f"column {name} is {column.dtype} {list(column.shape)}; expected a row of numbers")
    if column.dtype.kind == "b" or not len(column):
        return column.astype(np.int64)
    with np.errstate(invalid="ignore"):
        wrong = (column < low) | (column > high)
    if column.dtype.kind == "f":
        wrong |= ~(np.rint(column) == column)
    if wrong.any():
        row = int(np.argmax(wrong))
        value = column[row].item()
        size = column.dtype.itemsize
        hint = " (-1 without its sign)" if low == -1 and value in (255, 2 ** (8 * size) - 1, 2**32 - 1) else ""
        hint = " (seconds?)" if name == "t" and column.dtype.kind == "f" and 0 <= value < high else hint
        hint = " (nanoseconds?)" if name == "t" and value > high else hint
        raise ColumnError(f"column {name} has {value} in row {first_row + row}{hint}; expected {expected}")
    return column.astype(np.int64)
