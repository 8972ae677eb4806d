"""Text as v2e and ESIM write it: one event a line, ``t x y p``; ``.csv`` puts commas between and a header on top.

t is in whole µs by default; in seconds with six exact decimals on request (never through a float: at 1000 s a float32
steps by 61 µs).
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

from clsim.errors import InputError
from clsim.events.batch import EventBatch, empty_batch
from clsim.events.filesink import ByteFile, FileSink, FlushPolicy, Limits
from clsim.events.filesource import EventSource, damaged, open_binary

LIMITS = Limits("text", size=2**16)
_CHUNK_BYTES = 1 << 21


class TextSink(FileSink):
    """Writes lines."""

    def __init__(self, path: Path, width: int, height: int, flush: FlushPolicy, time_unit: str) -> None:
        """Create the file; raises InputError when it cannot be, or for a ``time_unit`` other than "us" or "s"."""
        if time_unit not in ("us", "s"):
            raise InputError(f'{path}: time unit "{time_unit}" is unknown; expected "us" or "s"')
        super().__init__(path, width, height, LIMITS, flush)
        self._seconds = time_unit == "s"
        separator = "," if path.suffix == ".csv" else " "
        self._line = separator.join(["%d.%06d" if self._seconds else "%d", "%d", "%d", "%d"]) + "\n"
        self._file = ByteFile(path, b"t,x,y,p\n" if separator == "," else b"")

    def _store(self, events: EventBatch) -> None:
        times = np.divmod(events["t"], 1_000_000) if self._seconds else (events["t"],)
        table = np.stack([*times, events["x"], events["y"], events["on"]], axis=1, dtype=np.int64)
        self._file.write((self._line * len(events) % tuple(table.ravel().tolist())).encode())

    def _finish(self) -> None:
        self._file.close()


def open_sink(path: Path, width: int, height: int, flush: FlushPolicy, time_unit: str = "us") -> TextSink:
    """Open a text writer; ``time_unit`` is "us" or "s"."""
    return TextSink(path, width, height, flush, time_unit)


def open_source(path: Path) -> EventSource:
    """Open a text file: ``t x y p`` between spaces, tabs or commas, t in seconds if it has a decimal point, else in µs.

    Lines that begin with ``#`` and a header of names are skipped; p counts as on where it is 1.
    """
    open_binary(path).close()
    return EventSource(path, None, None, _read(path))


def _read(path: Path) -> Iterator[EventBatch]:
    with open_binary(path) as file:
        line = 1
        seconds: bool | None = None
        for block in _whole_lines(path, file):
            body = block.replace(b",", b" ")
            if line == 1 and not re.search(rb"[0-9#]", body.split(b"\n", 1)[0]):
                body = b"#" + body  # a header of names
            if seconds is None:
                first = next(
                    (row for row in body.splitlines() if row.strip() and not row.lstrip().startswith(b"#")), b""
                )
                if first:
                    seconds = any(sign in first.split()[0] for sign in (b".", b"e", b"E"))
            if seconds is not None:
                yield _parse(path, body, seconds, line)
            line += block.count(b"\n")


def _whole_lines(path: Path, file: BinaryIO) -> Iterator[bytes]:
    """Yield blocks of whole lines; a last line that a kill tore (no newline and fewer than four fields) is left out."""
    rest = b""
    while data := file.read(_CHUNK_BYTES):
        data = rest + data
        end = data.rfind(b"\n") + 1
        if not end and len(data) >= _CHUNK_BYTES:
            raise damaged(path, "it has no lines")
        if end:
            yield data[:end]
        rest = data[end:]
    if len(rest.replace(b",", b" ").split()) >= 4:
        yield rest


def _parse(path: Path, body: bytes, seconds: bool, line: int) -> EventBatch:
    kind = np.dtype([("t", "f8" if seconds else "i8"), ("x", "i4"), ("y", "i4"), ("p", "i1")])
    if not body.strip():
        return empty_batch()
    try:
        with warnings.catch_warnings():
            # Older numpy only warns where it reads "nan" as an integer.
            warnings.simplefilter("error", DeprecationWarning)
            table = np.loadtxt(io.BytesIO(body), kind, comments="#", ndmin=1, encoding="latin-1")
    except (ValueError, DeprecationWarning) as error:
        raise InputError(f"{path}: {error} (rows counted from line {line}); expected lines of t x y p") from None
    if not len(table):
        return empty_batch()
    if min(table["x"].min(), table["y"].min()) < 0 or max(table["x"].max(), table["y"].max()) >= LIMITS.size:
        raise InputError(f"{path}: a coordinate after line {line} is not within 0 to {LIMITS.size - 1}")
    if not np.all(np.isin(table["p"], (-1, 0, 1))):
        raise InputError(f"{path}: a polarity after line {line} is not 0, 1 or -1")
    if seconds and not np.all(np.abs(table["t"]) < 9e9):
        raise InputError(f"{path}: a time after line {line} is not a number of seconds below 9e9")
    events = empty_batch(len(table))
    events["t"] = np.rint(table["t"] * 1e6) if seconds else table["t"]
    events["x"], events["y"], events["on"] = table["x"], table["y"], table["p"] > 0
    return events
