"""Batches from four columns of numbers, as data frames and archives keep them."""

from __future__ import annotations

from typing import Any

from clsim.events.batch import EventBatch, empty_batch


def from_columns(t: Any, x: Any, y: Any, p: Any) -> EventBatch:
    """Return one batch of four columns of numbers; raises ValueError for coordinates that are none."""
    for name, column in (("t", t), ("x", x), ("y", y), ("p", p)):
        if column.dtype.kind not in "iub":
            raise ValueError(f"column {name} has type {column.dtype}; expected whole numbers")
    for name, column in (("x", x), ("y", y)):
        if len(column) and not 0 <= int(column.min()) <= int(column.max()) < 65536:
            raise ValueError(f"column {name} leaves the range 0 to {65535}")
    events = empty_batch(len(t))
    events["t"], events["x"], events["y"], events["on"] = t, x, y, p > 0
    return events
