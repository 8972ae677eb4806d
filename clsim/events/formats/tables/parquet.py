"""Parquet: columns t, x, y, p in row groups compressed with Zstandard; small, for archives and data frames."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from clsim.events.batch import CAUSES, LABEL_TYPES, EventBatch, Labels
from clsim.events.formats.columns import find_columns, from_columns
from clsim.events.formats.filesink import FileSink, FlushPolicy, Limits, PartFile
from clsim.events.formats.filesource import CHUNK_EVENTS, EventSource, damaged, open_binary

LIMITS = Limits("Parquet", size=2**16)

# A row group is only ever full.
_ROW_GROUP = FlushPolicy(events=1 << 19, interval_us=math.inf)


class ParquetSink(FileSink):
    """Writes row groups under a temporary name; the file has its name when it is complete."""

    def __init__(self, path: Path, width: int, height: int, *, labels: Labels = ()) -> None:
        """Create the temporary file, with columns for ``labels``; raises InputError when it cannot be."""
        super().__init__(path, width, height, LIMITS, _ROW_GROUP, labelled=labels)
        arrow = _pyarrow()
        self._part = PartFile(path)
        columns = [("t", arrow.int64()), ("x", arrow.uint16()), ("y", arrow.uint16()), ("p", arrow.bool_())]
        metadata = {"width": str(width), "height": str(height)}
        columns += [(name, arrow.from_numpy_dtype(LABEL_TYPES[name])) for name in labels]
        if "cause" in labels:
            metadata["causes"] = ",".join(CAUSES)
        self._schema = arrow.schema(columns, metadata=metadata)
        self._arrow = arrow
        self._writer = arrow.parquet.ParquetWriter(self._part.part, self._schema, compression="zstd")

    def _store(self, events: EventBatch) -> None:
        columns = [np.ascontiguousarray(events[name]) for name in events.dtype.names or ()]
        self._writer.write_table(self._arrow.table(columns, schema=self._schema))

    def _finish(self) -> None:
        try:
            self._writer.close()
            if not self._failed:
                self._part.complete()
        finally:
            self._part.discard()


def open_sink(path: Path, width: int, height: int, flush: FlushPolicy, labels: Labels = ()) -> ParquetSink:
    """Open a Parquet writer; ``flush`` does not apply, since nothing can be read before the end.

    Each of ``labels`` is a column; the file's metadata name the numbers of causes.
    """
    return ParquetSink(path, width, height, labels=labels)


def open_source(path: Path, labels: Labels = ()) -> EventSource:
    """Open a Parquet file with columns t, x, y and p, however others name these, and those of ``labels``."""
    open_binary(path).close()
    arrow = _pyarrow()
    file = arrow.parquet.ParquetFile(path)
    types = {field.name: field.type for field in file.schema_arrow}
    labelled = tuple(name for name, kind in LABEL_TYPES.items() if types.get(name) == arrow.from_numpy_dtype(kind))
    found = find_columns(types)
    if found is None:
        raise damaged(path, f"it has the columns {', '.join(types)[:80]}; expected t, x, y and p, each once")
    metadata = file.schema_arrow.metadata or {}
    width, height = (int(metadata[name]) if name in metadata else None for name in (b"width", b"height"))
    return EventSource(path, width, height, _read(file, found, labels), labelled=labelled, labels=labels)


def _read(file: Any, names: dict[str, str], labels: Labels) -> Iterator[EventBatch]:
    wanted = names | {name: name for name in labels}
    row = 0
    with file:
        for table in file.iter_batches(CHUNK_EVENTS, columns=list(wanted.values())):
            columns = {name: table.column(own).to_numpy(zero_copy_only=False) for name, own in wanted.items()}
            yield from_columns(**columns, first_row=row)
            row += len(table)


def _pyarrow() -> Any:
    import pyarrow.parquet

    return pyarrow
