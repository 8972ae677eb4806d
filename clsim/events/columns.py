"""Batches from four columns of numbers, as data frames and archives keep them."""

from __future__ import annotations

from typing import Any

from clsim.events.batch import EventBatch, empty_batch


def from_columns(t: Any, x: Any, y: Any, p: Any, **labels: Any) -> EventBatch:
    """Return one batch of columns of numbers, with fields for labels; raises ValueError for what are none."""
    for name, column in (("t", t), ("x", x), ("y", y), ("p", p), *labels.items()):
        if column.dtype.kind not in "iub":
            raise ValueError(f"column {name} has type {column.dtype}; expected whole numbers")
    for name, column in (("x", x), ("y", y)):
        if len(column) and not 0 <= int(column.min()) <= int(column.max()) < 65536:
            raise ValueError(f"column {name} leaves the range 0 to {65535}")
    events = empty_batch(len(t), tuple(labels))
    events["t"], events["x"], events["y"], events["on"] = t, x, y, p > 0
    for name, column in labels.items():
        events[name] = column
    return events
