"""A numpy array of events in a file of its own: with names for its fields, or rows of t [µs], x, y, p. Only read.

EVIMO2 has three files in a folder instead, with t in seconds; the one with the times stands for all.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.events.batch import EventBatch
from clsim.events.formats.columns import check_unnamed, from_columns, named
from clsim.events.formats.filesource import CHUNK_EVENTS, EventSource, damaged, open_binary

_OF_EVIMO2 = "dataset_events_t.npy"


def open_source(path: Path) -> EventSource:
    """Open a ``.npy`` file."""
    open_binary(path).close()
    array = np.load(path, mmap_mode="r", allow_pickle=False)
    if path.name == _OF_EVIMO2 and array.ndim == 1 and array.dtype.kind == "f":
        return EventSource(path, None, None, _read_evimo2(path, array))
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


def _read_evimo2(path: Path, times_s: npt.NDArray[Any]) -> Iterator[EventBatch]:
    pixels, polarities = (_beside(path, name) for name in ("dataset_events_xy.npy", "dataset_events_p.npy"))
    if pixels.shape != (len(times_s), 2) or polarities.shape != (len(times_s),):
        raise damaged(
            path,
            f"it has {len(times_s)} times, but dataset_events_xy.npy is {list(pixels.shape)} and dataset_events_p.npy "
            f"{list(polarities.shape)}",
        )
    for start in range(0, len(times_s), CHUNK_EVENTS):
        part = slice(start, start + CHUNK_EVENTS)
        t = np.rint(times_s[part].astype(np.float64) * 1e6)
        yield from_columns(t, pixels[part, 0], pixels[part, 1], polarities[part], first_row=start)


def _beside(path: Path, name: str) -> npt.NDArray[Any]:
    open_binary(path.with_name(name)).close()
    array: npt.NDArray[Any] = np.load(path.with_name(name), mmap_mode="r", allow_pickle=False)
    return array


def of_array(rows: npt.NDArray[Any], first_row: int) -> EventBatch:
    """Return the events of an array with fields, or ``[n, 4]`` of t, x, y, p; raises ValueError for what is none."""
    if rows.dtype.names is not None:
        return named({name: rows[name] for name in rows.dtype.names}, first_row=first_row)
    events = from_columns(*rows.T, first_row=first_row)
    check_unnamed(events["t"])
    return events
