"""DAT, Prophesee's older format: 8 bytes an event, t in 32 bits, x and y in 14 bits each, polarity in 4.

The clock begins anew after 71 minutes, which is counted. Version 1 has x in 9 bits, y in 8, polarity in 1.

Source: https://docs.prophesee.ai/stable/data/file_formats/dat.html
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from clsim.errors import InputError
from clsim.events.batch import EventBatch, empty_batch
from clsim.events.formats.filesink import ByteFile, FileSink, FlushPolicy, Limits
from clsim.events.formats.filesource import CHUNK_EVENTS, CutShortError, EventSource, damaged, open_binary
from clsim.events.formats.laps import Laps

LIMITS = Limits("DAT", size=2**14, end_us=2**32)

_EVENT_CD, _EVENT_BYTES = 12, 8
_MOST_HEADER_LINES, _LONGEST_HEADER_LINE = 1000, 10_000


class DatSink(FileSink):
    """Writes records."""

    def __init__(self, path: Path, width: int, height: int, flush: FlushPolicy) -> None:
        """Create the file with its header; raises InputError when it cannot be."""
        super().__init__(path, width, height, LIMITS, flush)
        header = f"% Data file containing CD events.\n% Version 2\n% Height {height}\n% Width {width}\n"
        self._file = ByteFile(path, header.encode() + bytes([_EVENT_CD, _EVENT_BYTES]))

    def _store(self, events: EventBatch) -> None:
        words = np.empty((len(events), 2), "<u4")
        words[:, 0] = events["t"]
        words[:, 1] = events["x"] | events["y"].astype("<u4") << 14 | events["on"].astype("<u4") << 28
        self._file.write(words.data)

    def _finish(self) -> None:
        self._file.close()


def open_sink(path: Path, width: int, height: int, flush: FlushPolicy) -> DatSink:
    """Open a DAT writer."""
    return DatSink(path, width, height, flush)


def open_source(path: Path) -> EventSource:
    """Open a DAT file of change-detection events, of version 2 or 1."""
    fields: dict[str, int] = {}
    with open_binary(path) as file:
        if file.read(1) != b"%":
            raise damaged(path, "expected a header of lines that begin with %")
        file.seek(0)
        for _ in range(_MOST_HEADER_LINES):
            start = file.tell()
            line = file.readline(_LONGEST_HEADER_LINE)
            if not line.startswith(b"%"):
                break
            if found := re.search(rb"% *(Width|Height|Version) (\d{1,5})\s*$", line):
                fields[found[1].decode().lower()] = int(found[2])
        file.seek(start)
        head = file.read(2)
        start = file.tell()
    if len(head) < 2:
        raise damaged(path, "it ends within its header")
    if head[0] not in (0, _EVENT_CD) or head[1] != _EVENT_BYTES:
        raise damaged(
            path, f"it holds events of type {head[0]} of {head[1]} bytes; expected change-detection events (0 or 12, 8)"
        )
    version = fields.get("version", 1)
    if version not in (1, 2):
        raise InputError(f"{path}: is DAT of version {version}; expected 1 or 2")
    return EventSource(path, fields.get("width") or None, fields.get("height") or None, _read(path, start, version))


def _read(path: Path, start: int, version: int) -> Iterator[EventBatch]:
    x_bits, y_bits, on_at = (14, 14, 28) if version == 2 else (9, 8, 17)
    laps = Laps(1 << 32)
    with open_binary(path) as file:
        file.seek(start)
        while data := file.read(_EVENT_BYTES * CHUNK_EVENTS):
            words = np.frombuffer(data[: len(data) // _EVENT_BYTES * _EVENT_BYTES], "<u4").reshape(-1, 2)
            events = empty_batch(len(words))
            events["t"] = laps.unroll(words[:, 0].astype(np.int64))
            events["x"] = words[:, 1] & ((1 << x_bits) - 1)
            events["y"] = words[:, 1] >> x_bits & ((1 << y_bits) - 1)
            events["on"] = words[:, 1] >> on_at & (0xF if version == 2 else 1)
            yield events
            if len(data) % _EVENT_BYTES:
                raise CutShortError("within an event")
