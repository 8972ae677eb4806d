"""HDF5 in the layout of the DSEC data set: /events/t, x, y, p beside /ms_to_idx and /t_offset.

t is uint32 µs after t_offset, which is 0 unless the first event is late; ms_to_idx[m] is the index of the first event
at or after millisecond m. The chunks are not compressed, so that a chunk that fills slowly is overwritten in place with
the bytes it had and a few more; a compressed one would move at every flush, and a kill would cost all of it.

Source: https://dsec.ifi.uzh.ch/data-format/
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events.batch import CAUSES, LABEL_TYPES, EventBatch, Labels
from clsim.events.formats.columns import find_columns, from_columns
from clsim.events.formats.filesink import FileSink, FlushPolicy, Limits
from clsim.events.formats.filesource import CHUNK_EVENTS, CutShortError, EventSource, damaged, open_binary
from clsim.events.formats.tables.hdf5_growing import GrowingHdf5
from clsim.events.formats.tables.npy import of_array

LIMITS = Limits("HDF5 in DSEC layout", size=2**16, span_us=2**32 - 60_000_000)

_LATE_US = 60_000_000
_COLUMNS = {"t": np.dtype("<u4"), "x": np.dtype("<u2"), "y": np.dtype("<u2"), "p": np.dtype("u1")}
_CHUNK_ROWS = 1 << 14
_ECF = 0x8ECF
_OF_MVSEC = re.compile("/davis/(left|right)/events")
"""Tables of x, y, t [s] and p."""


class Hdf5Sink(FileSink):
    """Extends the columns and flushes the file."""

    def __init__(
        self,
        path: Path,
        width: int,
        height: int,
        flush: FlushPolicy,
        prepare: Callable[[Any], None] = lambda file: None,
        *,
        labels: Labels = (),
    ) -> None:
        """Create the file with empty columns; raises InputError when it cannot be.

        ``prepare(file)`` creates what else the file shall hold; `append` fills it. Each of ``labels`` is a
        column of ``events``; the attribute ``causes`` of ``events/cause`` names its numbers.
        """
        super().__init__(path, width, height, LIMITS, flush, labelled=labels)

        def columns(file: Any) -> None:
            group = file.create_group("events")
            group.attrs["width"], group.attrs["height"] = width, height
            for name, kind in _COLUMNS.items():
                group.create_dataset(name, (0,), kind, maxshape=(None,), chunks=(_CHUNK_ROWS,))
            for name in labels:
                kind = LABEL_TYPES[name]
                group.create_dataset(name, (0,), kind, maxshape=(None,), chunks=(_CHUNK_ROWS,))
            if "cause" in labels:
                group["cause"].attrs["causes"] = list(CAUSES)
            file.create_dataset("ms_to_idx", (0,), "<u8", maxshape=(None,), chunks=(1 << 12,))
            file.create_dataset("t_offset", data=np.int64(0))
            prepare(file)

        self._growing = GrowingHdf5(path, columns)
        self._rows = 0
        self._next_ms = 0
        self._offset_us: int | None = None

    def _store(self, events: EventBatch) -> None:
        if self._offset_us is None:
            first = int(events["t"][0])
            self._offset_us = first // 1000 * 1000 if first >= _LATE_US else 0
            self._growing.file["t_offset"][()] = self._offset_us
        t = events["t"] - self._offset_us
        marks = np.arange(self._next_ms, int(t[-1]) // 1000 + 1)
        rows = {
            "events/t": t,
            "events/x": events["x"],
            "events/y": events["y"],
            "events/p": events["on"],
            "ms_to_idx": self._rows + np.searchsorted(t, marks * 1000),
        }
        rows |= {f"events/{name}": events[name] for name in self.labelled}
        self._growing.append(rows)
        self._next_ms += len(marks)
        self._rows += len(events)

    def append(self, rows: Mapping[str, npt.NDArray[Any]]) -> None:
        """Append rows to data sets of these names, and hand them and all events so far to the operating system.

        Raises SinkError when the medium fails.
        """
        self._check_open()
        self.flush()
        with self._noting_failures():
            self._growing.append(rows)

    def _finish(self) -> None:
        self._growing.close()


def open_sink(path: Path, width: int, height: int, flush: FlushPolicy, labels: Labels = ()) -> Hdf5Sink:
    """Open a DSEC HDF5 writer, with columns for ``labels``."""
    return Hdf5Sink(path, width, height, flush, labels=labels)


def open_source(path: Path, labels: Labels = (), topic: str | None = None) -> EventSource:
    """Open an HDF5 file in DSEC layout; events that a kill left without ``labels`` are not read.

    Layouts of others, by what they have: event_utils' columns ``events/xs`` … with ts in seconds; v2e's ``events``
    ``[N, 4]`` of t, x, y, p; tables with named fields, such as OpenEB's ``CD/events``;
    columns in no group, as in the EDS data set; groups of cameras, as in MVSEC and M3ED, of which ``topic`` names one
    where there are several, such as ``/prophesee/left``.
    """
    open_binary(path).close()
    file = h5py.File(path, "r")
    found = _chosen(path, file, topic)
    if isinstance(found, h5py.Dataset):
        _need_filters(path, found)
        if found.dtype.names is None and not (found.ndim == 2 and found.shape[1] == 4):
            raise damaged(path, f"its events are {found.dtype} {list(found.shape)}; expected [N, 4] of t, x, y, p")
        return EventSource(path, *_size(file, found.parent), _read_table(file, found))
    names = find_columns(found)
    if names is None:
        raise damaged(path, f"its events have the columns {', '.join(found)[:80]}; expected t, x, y and p, each once")
    labelled = tuple(name for name, kind in LABEL_TYPES.items() if name in found and _is_column(found[name], kind))
    columns = {own: found[name] for own, name in names.items()}
    columns |= {name: found[name] for name in labels if name in labelled}
    offset = int(found.parent["t_offset"][()]) if "t_offset" in found.parent else 0
    for column in columns.values():
        if not isinstance(column, h5py.Dataset) or column.ndim != 1:
            raise damaged(path, f"its {column.name} is no column")
        _need_filters(path, column)
    # event_utils' own names, and its unit.
    in_seconds = set(names.values()) == {"ts", "xs", "ys", "ps"} and columns["t"].dtype.kind == "f"
    batches = _read(file, columns, labels, offset, in_seconds)
    return EventSource(path, *_size(file, found), batches, labelled=labelled, labels=labels)


def _chosen(path: Path, file: Any, topic: str | None) -> Any:
    """Return the group of columns, or the table, that has a file's events, or those of one camera."""
    if topic is None:
        unwrapped = file if find_columns(file) else None  # columns without a group around them
        found = file["CD/events"] if "CD/events" in file else file.get("events", unwrapped)
        if found is not None:
            return found
    cameras: list[str] = []

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Group):
            found = find_columns(item)
            known = found is not None and all(isinstance(item[each], h5py.Dataset) for each in found.values())
        else:
            known = name.endswith("events") and (bool(item.dtype.names) or item.shape[1:] == (4,))
        if known:
            cameras.append(f"/{name}")

    file.visititems(visit)
    told = ", ".join(cameras[:8])
    if not cameras:
        raise damaged(path, f"it holds {', '.join(file)[:80] or 'nothing'}; expected events/t, x, y, p")
    if topic is None and len(cameras) > 1:
        raise InputError(f"{path}: holds events of several cameras: {told}; name one of them: '{path}#{cameras[0]}'")
    if topic is not None and topic not in cameras:
        raise InputError(f"{path}: has no events in {topic}; expected one of {told}")
    return file[topic or cameras[0]]


def index_at(file: Any, time_us: int) -> int:
    """Return the index of the first event at or after a time [µs] of an open file in DSEC layout.

    Raises InputError where the file's index of milliseconds leads astray.
    """
    t, marks = file["events/t"], file["ms_to_idx"]
    time_us -= int(file["t_offset"][()]) if "t_offset" in file else 0
    if time_us <= 0 or not len(marks):
        return 0
    millisecond = time_us // 1000
    if millisecond >= len(marks):
        low, high = int(marks[-1]), len(t)
    else:
        low, high = int(marks[millisecond]), int(marks[millisecond + 1]) if millisecond + 1 < len(marks) else len(t)
    if 0 <= low <= high <= len(t):
        index = low + int(np.searchsorted(t[low:high], time_us))
        if (index == 0 or t[index - 1] < time_us) and (index == len(t) or t[index] >= time_us):
            return index
    raise InputError(f"{file.filename}: its ms_to_idx is not of its events, or they are out of order")


def _need_filters(path: Path, column: Any) -> None:
    """Load the compression plug-ins a column was written with."""
    options = column.id.get_create_plist()
    for index in range(options.get_nfilters()):
        number = options.get_filter(index)[0]
        if h5py.h5z.filter_avail(number):
            continue
        if number == _ECF:
            raise InputError(
                f"{path}: is compressed with Prophesee's ECF, which is not read here; expected it converted to .raw, "
                "such as with OpenEB's metavision_hdf5_to_raw or metavision_file_to_dat"
            )
        try:
            import hdf5plugin  # noqa: F401, it registers its filters
        except ImportError:
            raise InputError(
                f"{path}: is compressed in a way that needs hdf5plugin; install it with: pip install 'clsim[hdf5]'"
            ) from None


def _size(file: Any, group: Any) -> tuple[int | None, int | None]:
    """Return the sensor's width and height: event_utils tells rows and columns, others what is in the group."""
    if "width" in group.attrs and "height" in group.attrs:
        return int(group.attrs["width"]), int(group.attrs["height"])
    if all(getattr(group.get(side), "shape", None) == () for side in ("width", "height")):
        return int(group["width"][()]), int(group["height"][()])
    if "calib/resolution" in group:
        width, height = np.ravel(group["calib/resolution"]).tolist()
        return int(width), int(height)
    if "image_raw" in group:
        return group["image_raw"].shape[2], group["image_raw"].shape[1]
    if geometry := re.fullmatch(r"(\d+)x(\d+)", str(file.attrs.get("geometry", ""))):
        return int(geometry[1]), int(geometry[2])
    told = np.ravel(file.attrs.get("sensor_resolution", ()))
    return (int(told[1]), int(told[0])) if len(told) == 2 else (None, None)


def _is_column(item: Any, kind: str) -> bool:
    """Tell whether an item of a group is a column of this type."""
    return isinstance(item, h5py.Dataset) and item.ndim == 1 and item.dtype == np.dtype(kind)


def _read(file: Any, columns: dict[str, Any], labels: Labels, offset: int, in_seconds: bool) -> Iterator[EventBatch]:
    with file:
        rows, most = (end(len(column) for column in columns.values()) for end in (min, max))
        for start in range(0, rows, CHUNK_EVENTS):
            stop = min(start + CHUNK_EVENTS, rows)
            parts = {name: column[start:stop] for name, column in columns.items()}
            if in_seconds:
                parts["t"] = np.rint(parts["t"] * 1e6)
            events = from_columns(**parts, first_row=start)
            events["t"] += offset
            yield events
    if rows < most:
        raise CutShortError(f"at row {rows}, and some of its columns at row {most}")


def _read_table(file: Any, table: Any) -> Iterator[EventBatch]:
    of_mvsec = _OF_MVSEC.fullmatch(table.name) is not None
    with file:
        for start in range(0, len(table), CHUNK_EVENTS):
            rows = table[start : start + CHUNK_EVENTS]
            if of_mvsec:
                x, y, time_s, p = rows.T
                yield from_columns(np.rint(time_s * 1e6), x, y, p, first_row=start)
            else:
                yield of_array(rows, start)
