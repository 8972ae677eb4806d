"""HDF5 in the layout of the DSEC data set: /events/t, x, y, p beside /ms_to_idx and /t_offset.

t is uint32 µs after t_offset, which is 0 unless the first event is late; ms_to_idx[m] is the index of the first event
at or after millisecond m. The chunks are not compressed, so that a chunk that fills slowly is overwritten in place with
the bytes it had and a few more; a compressed one would move at every flush, and a kill would cost all of it.

HDF5 crashes the process when its writes fail, on a full disk for instance. So it writes through a file object that
reports success, remembers the failure, and lets nothing more reach the file. That object also keeps what a flush
writes and passes it on in an order in which a kill at any point leaves a whole file: the lengths of the columns, which
HDF5 would write at any time, come after the rows that they promise.

Source: https://dsec.ifi.uzh.ch/data-format/
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events.batch import EventBatch, empty_batch
from clsim.events.filesink import FileSink, FlushPolicy, Limits, check_exists, unwritable
from clsim.events.filesource import CHUNK_EVENTS, EventSource, open_binary

LIMITS = Limits("HDF5 in DSEC layout", size=2**16, span_us=2**32 - 60_000_000)

_LATE_US = 60_000_000
_COLUMNS = {"t": np.dtype("<u4"), "x": np.dtype("<u2"), "y": np.dtype("<u2"), "p": np.dtype("u1")}
_CHUNK_ROWS = 1 << 14


class Hdf5Sink(FileSink):
    """Extends the columns and flushes the file."""

    def __init__(
        self,
        path: Path,
        width: int,
        height: int,
        flush: FlushPolicy,
        prepare: Callable[[Any], None] = lambda file: None,
    ) -> None:
        """Create the file with empty columns; raises InputError when it cannot be.

        ``prepare(file)`` creates what else the file shall hold; `append` fills it.
        """
        super().__init__(path, width, height, LIMITS, flush)
        try:
            self._medium = _Medium(path)
        except OSError as error:
            raise unwritable(path, error) from None
        self._file = h5py.File(self._medium, "w")
        group = self._file.create_group("events")
        group.attrs["width"], group.attrs["height"] = width, height
        for name, kind in _COLUMNS.items():
            group.create_dataset(name, (0,), kind, maxshape=(None,), chunks=(_CHUNK_ROWS,))
        self._file.create_dataset("ms_to_idx", (0,), "<u8", maxshape=(None,), chunks=(1 << 12,))
        self._file.create_dataset("t_offset", data=np.int64(0))
        prepare(self._file)
        self._file.flush()
        if self._medium.error:
            self._file.close()
            self._medium.close()
            raise unwritable(path, self._medium.error)
        self._medium.keep_order()
        self._rows = 0
        self._next_ms = 0
        self._offset_us: int | None = None

    def _store(self, events: EventBatch) -> None:
        if self._offset_us is None:
            first = int(events["t"][0])
            self._offset_us = first // 1000 * 1000 if first >= _LATE_US else 0
            self._file["t_offset"][()] = self._offset_us
        t = events["t"] - self._offset_us
        last = int(t[-1])
        end = self._rows + len(events)
        for name, values in (("t", t), ("x", events["x"]), ("y", events["y"]), ("p", events["on"])):
            column = self._file["events"][name]
            column.resize((end,))
            column[self._rows :] = values
        marks = np.arange(self._next_ms, last // 1000 + 1)
        index = self._file["ms_to_idx"]
        index.resize((self._next_ms + len(marks),))
        index[self._next_ms :] = self._rows + np.searchsorted(t, marks * 1000)
        self._next_ms += len(marks)
        self._rows = end
        self._commit()

    def append(self, rows: Mapping[str, npt.NDArray[Any]]) -> None:
        """Append rows to data sets of these names, and hand them and all events so far to the operating system.

        Raises SinkError when the medium fails.
        """
        self._check_open()
        self.flush()
        with self._noting_failures():
            for name, values in rows.items():
                dataset = self._file[name]
                start = len(dataset)
                dataset.resize(start + len(values), axis=0)
                dataset[start:] = values
            self._commit()

    def _commit(self) -> None:
        self._file.flush()
        self._medium.commit()
        self._medium.check()

    def _finish(self) -> None:
        self._file.close()
        try:
            self._medium.commit()
            self._medium.check()
        finally:
            self._medium.close()


class _Medium(io.RawIOBase):
    """The file object HDF5 writes through: never fails, but keeps the first ``error`` and writes nothing after it.

    After ``keep_order``, writes wait for ``commit``; reads see them all the same.
    """

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)
        self._position = 0
        self._size = 0
        self._waiting: list[tuple[int, bytes]] | None = None
        self._headers_end = 0
        self._committed_end = 0
        self.error: OSError | None = None

    def check(self) -> None:
        """Raise the error there was, or the one that the file is gone."""
        if self.error:
            raise self.error
        check_exists(self._descriptor)

    def keep_order(self) -> None:
        """From now on keep writes until ``commit``; what is in the file so far are the headers of the columns."""
        self._waiting = []
        self._headers_end = self._committed_end = self._size

    def commit(self) -> None:
        """Write what waits: new space, then the size of the file, then what points into it, the headers last."""
        for offset, data in sorted(_merged(self._waiting or []), key=self._turn):
            self._put(offset, data)
        if self._waiting is not None:
            self._waiting = []
        self._committed_end = self._size

    def _turn(self, piece: tuple[int, bytes]) -> tuple[int, int]:
        offset = piece[0]
        if offset >= self._committed_end:
            return 0, offset
        if offset >= self._headers_end:
            return 2, offset  # a node of the index stands before those that were split from it
        return (1 if offset == 0 else 3), offset

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._position = offset if whence == os.SEEK_SET else self._size + offset
        return self._position

    def readinto(self, out: Any) -> int:
        view = memoryview(out).cast("B")
        start = self._position
        count = max(0, min(len(view), self._size - start))
        stored = os.pread(self._descriptor, count, start)
        view[:count] = stored + bytes(count - len(stored))
        for offset, data in self._waiting or ():
            low, high = max(offset, start), min(offset + len(data), start + count)
            if low < high:
                view[low - start : high - start] = data[low - offset : high - offset]
        self._position += count
        return count

    def write(self, data: Any) -> int:
        content = bytes(memoryview(data).cast("B"))
        if self._waiting is None:
            self._put(self._position, content)
        else:
            self._waiting.append((self._position, content))
        self._position += len(content)
        self._size = max(self._size, self._position)
        return len(content)

    def _put(self, offset: int, data: bytes) -> None:
        view = memoryview(data)
        done = 0
        try:
            while done < len(view) and not self.error:
                done += os.pwrite(self._descriptor, view[done:], offset + done)
        except OSError as error:
            self.error = error

    def truncate(self, size: int | None = None) -> int:
        size = self._position if size is None else size
        try:
            # Space that the file is to grow by comes with the writes into it.
            if (not self.error and size < os.fstat(self._descriptor).st_size) or self._waiting is None:
                os.ftruncate(self._descriptor, size)
        except OSError as error:
            self.error = error
        self._size = size
        return size

    def close(self) -> None:
        if not self.closed:
            super().close()
            os.close(self._descriptor)


def _merged(pieces: list[tuple[int, bytes]]) -> list[tuple[int, bytes]]:
    """Join writes that overlap, the later over the earlier, so that the order of what is left does not matter."""
    regions: list[tuple[int, int, list[tuple[int, bytes]]]] = []
    for offset, data in sorted(pieces, key=lambda piece: piece[0]):
        end = offset + len(data)
        if regions and offset < regions[-1][1]:
            start, stop, members = regions[-1]
            members.append((offset, data))
            regions[-1] = (start, max(stop, end), members)
        else:
            regions.append((offset, end, [(offset, data)]))
    order = {id(data): number for number, (_, data) in enumerate(pieces)}
    result = []
    for start, stop, members in regions:
        region = bytearray(stop - start)
        for offset, data in sorted(members, key=lambda piece: order[id(piece[1])]):
            region[offset - start : offset - start + len(data)] = data
        result.append((start, bytes(region)))
    return result


def open_sink(path: Path, width: int, height: int, flush: FlushPolicy) -> Hdf5Sink:
    """Open a DSEC HDF5 writer."""
    return Hdf5Sink(path, width, height, flush)


def open_source(path: Path) -> EventSource:
    """Open an HDF5 file in DSEC layout."""
    open_binary(path).close()
    file = h5py.File(path, "r")
    columns = {name: file["events"][name] for name in _COLUMNS}
    offset = int(file["t_offset"][()]) if "t_offset" in file else 0
    width, height = (_side(file["events"].attrs.get(name)) for name in ("width", "height"))
    for column in columns.values():
        _need_filters(path, column)
    return EventSource(path, width, height, _read(file, columns, offset))


def _need_filters(path: Path, column: Any) -> None:
    """Load the compression plug-ins a column was written with."""
    options = column.id.get_create_plist()
    for index in range(options.get_nfilters()):
        if h5py.h5z.filter_avail(options.get_filter(index)[0]):
            continue
        try:
            import hdf5plugin  # noqa: F401, it registers its filters
        except ImportError:
            raise InputError(
                f"{path}: is compressed in a way that needs hdf5plugin; install it with: pip install 'clsim[hdf5]'"
            ) from None


def _side(attribute: Any) -> int | None:
    return None if attribute is None else int(attribute)


def _read(file: Any, columns: dict[str, Any], offset: int) -> Iterator[EventBatch]:
    with file:
        rows = min(len(column) for column in columns.values())
        for start in range(0, rows, CHUNK_EVENTS):
            stop = min(start + CHUNK_EVENTS, rows)
            events = empty_batch(stop - start)
            events["t"] = columns["t"][start:stop].astype(np.int64) + offset
            events["x"], events["y"] = columns["x"][start:stop], columns["y"][start:stop]
            events["on"] = columns["p"][start:stop] > 0
            yield events
