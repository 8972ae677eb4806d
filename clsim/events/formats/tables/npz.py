"""NPZ: numpy arrays t, x, y, p (and width, height) in one compressed archive, written and read piece by piece."""

from __future__ import annotations

import contextlib
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.events.batch import EVENT_DTYPE, EventBatch
from clsim.events.formats.columns import find_columns, from_columns
from clsim.events.formats.filesink import ByteFile, FileSink, FlushPolicy, Limits, PartFile
from clsim.events.formats.filesource import CHUNK_EVENTS, EventSource, damaged, open_binary
from clsim.events.formats.tables.npy import of_array

LIMITS = Limits("NPZ", size=2**16)

_COLUMNS = {"t": "t", "x": "x", "y": "y", "p": "on"}


class NpzSink(FileSink):
    """Gathers events in one temporary file, packs them in a second, and names that at close.

    An array's length comes first in the archive, so it cannot be written before the last event is known.
    """

    def __init__(self, path: Path, width: int, height: int, flush: FlushPolicy) -> None:
        """Create the temporary file; raises InputError when it cannot be."""
        super().__init__(path, width, height, LIMITS, flush)
        self._part = PartFile(path)
        self._events = ByteFile(self._part.part.with_suffix(".events"))

    def _store(self, events: EventBatch) -> None:
        self._events.write(events.view(np.uint8).data)

    def _finish(self) -> None:
        self._events.close()
        try:
            if not self._failed:
                self._pack()
                self._part.complete()
        finally:
            self._part.discard()
            self._events.path.unlink(missing_ok=True)

    def _pack(self) -> None:
        count = self._events.size // EVENT_DTYPE.itemsize
        events = np.memmap(self._events.path, EVENT_DTYPE, "r", shape=(count,)) if count else np.empty(0, EVENT_DTYPE)
        with zipfile.ZipFile(self._part.part, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            for name, field in _COLUMNS.items():
                _store_array(archive, name, events[field])
            for name, side in (("width", self.width), ("height", self.height)):
                _store_array(archive, name, np.array(side))


def _store_array(archive: zipfile.ZipFile, name: str, array: npt.NDArray[Any]) -> None:
    entry = zipfile.ZipInfo(f"{name}.npy")  # without the time of day: the same events give the same bytes
    entry.compress_type = zipfile.ZIP_DEFLATED
    with archive.open(entry, "w", force_zip64=True) as member:
        head = {"descr": np.lib.format.dtype_to_descr(array.dtype), "fortran_order": False, "shape": array.shape}
        np.lib.format.write_array_header_1_0(member, head)
        for start in range(0, array.size, CHUNK_EVENTS):
            member.write(np.ascontiguousarray(array.reshape(-1)[start : start + CHUNK_EVENTS]).tobytes())


def open_sink(path: Path, width: int, height: int, flush: FlushPolicy) -> NpzSink:
    """Open an NPZ writer; ``flush`` only bounds its memory, since nothing can be read before the end."""
    return NpzSink(path, width, height, flush)


def open_source(path: Path) -> EventSource:
    """Open an NPZ file with arrays t, x, y and p, or of the names that others give these; or with one array of fields.

    One array of events, with such names for its fields, is what N-ImageNet has.
    """
    open_binary(path).close()
    with zipfile.ZipFile(path) as archive:
        held = [name.removesuffix(".npy") for name in archive.namelist()]
        found = find_columns(held)
        if found is None and len(held) == 1:
            return EventSource(path, None, None, _read_one(path, held[0]))
        if found is None:
            raise damaged(path, f"it has the arrays {', '.join(held)[:80]}; expected t, x, y and p, each once")
        width, height = (_read_side(archive, name) for name in ("width", "height"))
    return EventSource(path, width, height, _read(path, found))


def _read_one(path: Path, name: str) -> Iterator[EventBatch]:
    with zipfile.ZipFile(path) as archive, archive.open(f"{name}.npy") as member:
        shape, dtype = _read_head(member)
        if dtype.names is None or len(shape) != 1:
            raise ValueError(
                f"its array {name} is of {dtype} {list(shape)}; expected fields t, x, y, p, or four arrays"
            )
        for start in range(0, shape[0], CHUNK_EVENTS):
            rows = min(CHUNK_EVENTS, shape[0] - start)
            data = member.read(rows * dtype.itemsize)
            if len(data) < rows * dtype.itemsize:
                raise ValueError(f"its array {name} ends early")
            yield of_array(np.frombuffer(data, dtype), start)


def _read_side(archive: zipfile.ZipFile, name: str) -> int | None:
    if f"{name}.npy" not in archive.namelist():
        return None
    with archive.open(f"{name}.npy") as member:
        shape, dtype = _read_head(member)
        if shape != () or dtype.kind not in "iu":
            raise ValueError(f"its {name} is no whole number")
        return int(np.frombuffer(member.read(dtype.itemsize), dtype)[0])


def _read(path: Path, names: dict[str, str]) -> Iterator[EventBatch]:
    with contextlib.ExitStack() as stack:
        archive = stack.enter_context(zipfile.ZipFile(path))
        members = {name: stack.enter_context(archive.open(f"{names[name]}.npy")) for name in _COLUMNS}
        heads = {name: _read_head(member) for name, member in members.items()}
        shapes = {shape for shape, _ in heads.values()}
        if len(shapes) != 1 or len(next(iter(shapes))) != 1:
            raise ValueError(f"its arrays t, x, y, p have shapes {sorted(shapes)}; expected one length")
        (count,) = next(iter(shapes))
        for start in range(0, count, CHUNK_EVENTS):
            rows = min(CHUNK_EVENTS, count - start)
            columns = []
            for name, member in members.items():
                dtype = heads[name][1]
                data = member.read(rows * dtype.itemsize)
                if len(data) < rows * dtype.itemsize:
                    raise ValueError(f"its array {name} ends early")
                columns.append(np.frombuffer(data, dtype))
            yield from_columns(*columns, first_row=start)


def _read_head(member: Any) -> tuple[tuple[int, ...], np.dtype[Any]]:
    version = np.lib.format.read_magic(member)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(member)
    if any(kind.kind not in "iubf" for kind in _kinds(dtype)):
        raise ValueError(f"its array has type {dtype}; expected numbers")
    return shape, dtype


def _kinds(dtype: np.dtype[Any]) -> list[np.dtype[Any]]:
    return [dtype] if dtype.fields is None else [field[0] for field in dtype.fields.values()]
