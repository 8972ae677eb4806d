"""A numpy array of events in a file of its own: with names for its fields, or rows of t [µs], x, y, p. Only read."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.events.batch import EventBatch
from clsim.events.formats.columns import check_unnamed, from_columns, named
from clsim.events.formats.filesource import CHUNK_EVENTS, EventSource, damaged, open_binary


def open_source(path: Path) -> EventSource:
    """Open a ``.npy`` file."""
    open_binary(path).close()
    array = np.load(path, mmap_mode="r", allow_pickle=False)
    if array.dtype.names is None and not (array.ndim == 2 and array.shape[1] == 4):
        raise damaged(
            path,
            f"it is an array of {array.dtype} {list(array.shape)}; expected one with fields t, x, y, p, or [N, 4] of "
            "t, x, y, p in this order",
        )
    return EventSource(path, None, None, _read(array))


def _read(array: npt.NDArray[Any]) -> Iterator[EventBatch]:
    rows = array.reshape(-1) if array.dtype.names is not None else array
    for start in range(0, len(rows), CHUNK_EVENTS):
        yield of_array(np.asarray(rows[start : start + CHUNK_EVENTS]), start)


def of_array(rows: npt.NDArray[Any], first_row: int) -> EventBatch:
    """Return the events of an array with fields, or ``[n, 4]`` of t, x, y, p; raises ValueError for what is none."""
    if rows.dtype.names is not None:
        return named({name: rows[name] for name in rows.dtype.names}, first_row=first_row)
    events = from_columns(*rows.T, first_row=first_row)
    check_unnamed(events["t"])
    return events
