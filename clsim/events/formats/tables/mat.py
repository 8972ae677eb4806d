"""Files of MATLAB with events: variables or the fields of a struct called t, x, y and p, or so. Only read.

Files of version 7.3 are HDF5. MATLAB counts pixels from 1 where its user did: nothing in a file tells, so that x and y
are taken as they are.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.events.batch import EventBatch
from clsim.events.formats.columns import NAMES, find_columns, from_columns
from clsim.events.formats.filesource import CHUNK_EVENTS, EventSource, damaged, open_binary

_HEADER_BYTES = 128
_MATRIX, _COMPRESSED = 14, 15
_KINDS = (1, 2, 3, 4, 5, 6, 7, 9, 12, 13, _MATRIX, 16, 17, 18)
_HDF5_AT, _HDF5_MAGIC = 512, b"\x89HDF\r\n\x1a\n"


def open_source(path: Path) -> EventSource:
    """Open a ``.mat`` file; it is held in memory."""
    with open_binary(path) as file:
        file.seek(_HDF5_AT)
        is_hdf5 = file.read(len(_HDF5_MAGIC)) == _HDF5_MAGIC
    variables = _hdf5(path) if is_hdf5 else _matlab(path)
    columns = _find(variables)
    if columns is None:
        told = ", ".join(sorted(variables)[:12]) or "none"
        raise damaged(path, f"its variables are {told}; expected t, x, y and p, or one struct of these")
    return EventSource(path, None, None, _read(columns))


def _read(columns: Mapping[str, npt.NDArray[Any]]) -> Iterator[EventBatch]:
    if len({column.size for column in columns.values()}) > 1:
        raise ValueError(f"its columns have {', '.join(f'{n} {c.size}' for n, c in columns.items())} rows")
    for start in range(0, columns["t"].size, CHUNK_EVENTS):
        yield from_columns(*(columns[name][start : start + CHUNK_EVENTS] for name in NAMES), first_row=start)


def _find(variables: Mapping[str, Any]) -> dict[str, npt.NDArray[Any]] | None:
    """Return the columns among variables, or within the only struct that has them, whatever it is called."""
    found = dict(_structs(variables))
    if len(found) > 1:
        raise ValueError(f"{', '.join(sorted(found))[:80]} each hold events; expected one of them alone")
    return next(iter(found.values()), None)


def _structs(variables: Mapping[str, Any], within: str = "") -> Iterator[tuple[str, dict[str, npt.NDArray[Any]]]]:
    """Yield the columns among variables, or those of structs within that have them, by where they are."""
    found = find_columns(variables)
    if found is not None:
        columns = {name: np.asarray(variables[found[name]]) for name in NAMES}
        if all(column.dtype.kind in "iubf" for column in columns.values()):
            yield within, {name: column.reshape(-1) for name, column in columns.items()}
            return
    for name, value in variables.items():
        if isinstance(value, Mapping):
            yield from _structs(value, f"{within}.{name}" if within else name)


def _matlab(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat

    data = path.read_bytes()
    order = {b"IM": "<", b"MI": ">"}.get(data[126:_HEADER_BYTES])
    if order is not None:  # version 5
        data = data[:_HEADER_BYTES] + _inflated(data[_HEADER_BYTES:], order)
    found = loadmat(io.BytesIO(data), simplify_cells=True)
    return {name: value for name, value in found.items() if not name.startswith("__")}


def _inflated(data: bytes, order: str) -> bytes:
    """Return elements without compression; raises ValueError where they lie in no order: SciPy ends the process then.

    Source: MathWorks, MAT-File Format, version 5.
    """
    plain = []
    for kind, body, whole in _elements(data, order):
        if kind == _COMPRESSED:  # one other
            ((kind, body, whole),) = _elements(zlib.decompress(body), order)
        _check(kind, body, order)
        plain.append(whole)
    return b"".join(plain)


def _check(kind: int, body: bytes, order: str) -> None:
    if kind not in _KINDS:
        raise ValueError(f"an element of kind {kind}")
    if kind == _MATRIX:
        for inner, part, _ in _elements(body, order):
            _check(inner, part, order)


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes, bytes]]:
    """Yield the kind of each element, what it holds, and all of it."""
    at = 0
    while at < len(data):
        if at + 8 > len(data):
            raise ValueError("it ends within an element")
        kind, size = struct.unpack_from(f"{order}II", data, at)
        start, follows = at + 8, at + 8 + size + (0 if kind == _COMPRESSED else -size % 8)
        if kind >> 16:  # of up to 4 bytes, within its own head
            kind, size, start, follows = kind & 0xFFFF, kind >> 16, at + 4, at + 8
        if start + size > min(follows, len(data)):
            raise ValueError("an element ends beyond what it lies in")
        yield kind, data[start : start + size], data[at:follows]
        at = follows


def _hdf5(path: Path) -> dict[str, Any]:
    import h5py

    def read(group: Any) -> dict[str, Any]:
        return {
            name: read(item) if isinstance(item, h5py.Group) else item[()]
            for name, item in group.items()
            if name != "#refs#" and (isinstance(item, h5py.Group) or item.dtype.kind in "iubf")
        }

    with h5py.File(path, "r") as file:
        return read(file)
