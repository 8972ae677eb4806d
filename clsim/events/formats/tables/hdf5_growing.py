"""HDF5 files that grow, and of which a kill leaves what was handed over.

HDF5 crashes the process when its writes fail, on a full disk for instance. So it writes through a file object that
reports success, remembers the failure, and lets nothing more reach the file. That object also keeps what a flush
writes and passes it on in an order in which a kill at any point leaves a whole file: the lengths of the columns, which
HDF5 would write at any time, come after the rows that they promise.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from clsim.events.formats.filesink import check_exists, unwritable
from clsim.events.formats.tables.deflate import shuffled_and_deflated


class GrowingHdf5:
    """A file of data sets that rows are appended to; none is created after the start.

    Attributes:
        file: h5py's.
    """

    def __init__(self, path: Path, prepare: Callable[[Any], None]) -> None:
        """Create the file, and in it what ``prepare(file)`` creates; raises InputError when it cannot be."""
        try:
            self._medium = _Medium(path)
        except OSError as error:
            raise unwritable(path, error) from None
        self.file = h5py.File(self._medium, "w")
        prepare(self.file)
        self.file.flush()
        if self._medium.error:
            self.file.close()
            self._medium.close()
            raise unwritable(path, self._medium.error)
        self._medium.keep_order()
        self._columns: dict[str, _Column] = {}

    def append(self, rows: Mapping[str, npt.NDArray[Any]]) -> None:
        """Append rows to data sets of these names, and hand them to the operating system; raises OSError."""
        for name, values in rows.items():
            if name not in self._columns:
                self._columns[name] = _Column(self.file[name])
            if len(values):
                self._columns[name].append(values)
        self.file.flush()
        self._medium.commit()
        self._medium.check()

    def close(self) -> None:
        """Complete the file and release it; raises OSError when the medium fails."""
        self.file.close()
        try:
            self._medium.commit()
            self._medium.check()
        finally:
            self._medium.close()


def compressed(file: Any, name: str, shape: tuple[int, ...], kind: str) -> Any:
    """Create a data set of rows of that shape, each of which is a compressed chunk."""
    return file.create_dataset(
        name, (0, *shape), kind, maxshape=(None, *shape), chunks=(1, *shape), compression="gzip", shuffle=True
    )


class _Column:
    """A data set that rows are appended to, by HDF5's own calls: h5py's take ten times as long for a few rows."""

    def __init__(self, dataset: Any) -> None:
        self._id, self._dtype, self._rows = dataset.id, dataset.dtype, len(dataset)
        self._packed = dataset.shuffle  # a chunk a row, as `compressed` creates them

    def append(self, values: npt.NDArray[Any]) -> None:
        start, values = self._rows, np.ascontiguousarray(values, self._dtype)
        self._rows += len(values)
        self._id.set_extent((self._rows, *values.shape[1:]))
        corner = (0,) * (values.ndim - 1)
        if self._packed:
            for number, row in enumerate(values, start):
                self._id.write_direct_chunk((number, *corner), shuffled_and_deflated(row))
            return
        place = self._id.get_space()
        place.select_hyperslab((start, *corner), values.shape)
        self._id.write(h5py.h5s.create_simple(values.shape), place, values)


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
