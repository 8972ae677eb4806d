"""Text as v2e and ESIM write it: one event a line, ``t x y p``; ``.csv`` puts commas between and a header on top.

t is in whole µs by default; in seconds with six exact decimals on request (never through a float: at 1000 s a float32
steps by 61 µs).
"""

from __future__ import annotations

import codecs
import io
import re
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from clsim.errors import InputError
from clsim.events.batch import EventBatch, empty_batch
from clsim.events.formats.columns import NAMES, check_unnamed, find_columns, from_columns
from clsim.events.formats.filesink import ByteFile, FileSink, FlushPolicy, Limits
from clsim.events.formats.filesource import CutShortError, EventSource, damaged, open_binary

LIMITS = Limits("text", size=2**16)
_CHUNK_BYTES = 1 << 21
_LATEST_US = 9e15


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
    """Open a text file: ``t x y p`` between spaces, tabs, commas or semicolons.

    A first line of names, also behind a ``#``, tells the order of the columns, and the unit of t where it has one
    (``timestamp [ns]``, ``t_s``). Otherwise t is in seconds where it has a decimal point and is not
    always whole (``1164.0``, ``1.164e+03``), else in µs. A first line of two numbers is the sensor's width and height.
    faery tells it in its names, ``x@640``. Other lines that begin with ``#`` are skipped; p is on where it is 1 or
    True.
    Metavision's order ``x,y,p,t`` is known by its first line ``%geometry:640,480``, or by its third column of 0 and 1.
    """
    with open_binary(path) as file:
        start = file.read(_CHUNK_BYTES)
    table = _Table.of(start)
    return EventSource(path, *table.size, _read(path, table))


_UNITS = {
    1e6: "s sec secs second seconds",
    1e3: "ms msec millis millisecond milliseconds",
    1.0: "us \u00b5s \u03bcs \ufffds usec microsec microsecond microseconds",  # the last sign is Latin 1's
    1e-3: "ns nsec nanosec nanosecond nanoseconds",
}
_US = {name: factor for factor, names in _UNITS.items() for name in names.split()}
_LOOK_AT = 1000
_SOME_TIMES = 10


@dataclass(frozen=True)
class _Table:
    """How a file's lines are to be read.

    Attributes:
        columns: which field of a line is t, x, y and p.
        separator: what stands between fields; None is white space.
        unit_us: µs in what t counts.
        fractions: whether t has a decimal point.
        skip: lines to be passed over at first.
        named: whether the file names its columns.
        size: width and height of the sensor.
    """

    columns: tuple[int, ...]
    separator: str | None
    unit_us: float
    fractions: bool
    skip: int
    named: bool
    size: tuple[int | None, int | None]

    @classmethod
    def of(cls, start: bytes) -> _Table:
        """Find out from the beginning of a file; raises ValueError for names that are not those of events."""
        lines = _with_digits(start).decode("utf-8-sig", "replace").split("\n")[:_LOOK_AT]
        rows = [(k, line.strip()) for k, line in enumerate(lines) if line.strip()]
        names: dict[str, str] | None = None
        order: list[str] = []
        size: tuple[int | None, int | None] = (None, None)
        by_metavision = False
        skip = 0
        for k, row in rows:
            words = _fields(re.sub(r"^#[#\s]*(\w+:\s)?", "", row), _separator(row))
            found = find_columns(map(_plain, words))
            if found is not None:
                names, order, skip = found, words, k + 1
            elif re.fullmatch(r"[1-9]\d{0,4}\s+[1-9]\d{0,4}", row):
                width, height = map(int, row.split())
                size, skip = (width, height), k + 1
            elif row.startswith("%"):
                geometry = re.fullmatch(r"%geometry:([1-9]\d{0,4}),([1-9]\d{0,4})", row)
                if geometry is not None:
                    size, by_metavision = (int(geometry[1]), int(geometry[2])), True
                skip = k + 1
            elif not row.startswith("#"):
                if not re.search("[0-9]", row) or re.search("[a-df-zA-DF-Z_]{2}", words[0]):
                    raise ValueError(f"line {k + 1} names the columns {', '.join(words)[:80]}; expected t, x, y and p")
                break
        data = [row for k, row in rows if k >= skip and not row.startswith("#")]
        separator = _separator(data[0]) if data else None
        plain = [_plain(word) for word in order]
        if names is not None:
            columns = tuple(plain.index(names[name]) for name in NAMES)
            sides = [re.search(r"@([1-9]\d{0,4})$", order[k]) for k in columns[1:3]]
            size = (int(sides[0][1]), int(sides[1][1])) if sides[0] and sides[1] else size
        elif by_metavision or _ends_in_time(data, separator):
            columns = (3, 0, 1, 2)
        else:
            columns = (0, 1, 2, 3)
        times = [_fields(row, separator)[columns[0] : columns[0] + 1] for row in data]
        words = [word for time in times for word in time]
        fractions = any(sign in word for word in words for sign in ".eE")
        unit = _unit(order[columns[0]]) if names is not None else None
        in_seconds = fractions and not _are_whole(words)
        return cls(columns, separator, unit or (1e6 if in_seconds else 1.0), fractions, skip, names is not None, size)


def _ends_in_time(rows: list[str], separator: str | None) -> bool:
    """Whether columns without names must be x, y, p, t: the third one has polarities, and the fourth other values."""
    whole = [words for row in rows if len(words := _fields(row, separator)) == 4]
    return _are_polarities(words[2] for words in whole) and not _are_polarities(words[3] for words in whole)


def _are_whole(words: list[str]) -> bool:
    """Whether times with a point are whole numbers all the same, as programs write µs that they hold as floats."""
    if not all(re.fullmatch(r"\d+\.0?|\d(\.\d*)?e[+-]\d+", word) for word in words):
        return False
    times = {float(word) for word in words}
    return len(times) >= _SOME_TIMES and all(time.is_integer() for time in times)


def _with_digits(body: bytes) -> bytes:
    """Return text with 1 and 0 for True and False, which Python's programs write for polarities."""
    if b"rue" in body or b"RUE" in body or b"als" in body or b"ALS" in body:
        body = re.sub(rb"(?i)\btrue\b", b"1", re.sub(rb"(?i)\bfalse\b", b"0", body))
    return body


def _are_polarities(words: Iterable[str]) -> bool:
    return all(re.fullmatch(r"[+-]?[01](\.0*)?", word) for word in words)


def _separator(line: str) -> str | None:
    return next((mark for mark in ",;" if mark in line), None)


def _fields(line: str, separator: str | None) -> list[str]:
    return [word.strip() for word in line.split(separator)]


def _plain(name: str) -> str:
    """Return a column's name without quotes, its unit (``timestamp [us]``, ``t_ns``) and its side (``x@640``)."""
    plain = re.sub(r"[\[(].*[\])]$|@\d+$", "", name.strip("'\" ").lower()).strip()
    return re.sub(rf"_({'|'.join(_US)})$", "", plain)


def _unit(name: str) -> float | None:
    """Return the µs in the unit that a column's name tells; raises ValueError for one that is not known."""
    word = name.strip("'\" ").lower()
    found = re.search(rf"(?:_|[\[(]\s*)({'|'.join(_US)})(?:\s*[\])])?$", word)
    if found is None and re.search(r"[\[(]", word):
        raise ValueError(f"it names t in a unit that is not known: {word[:40]}; expected s, ms, us or ns")
    return _US[found[1]] if found else None


def _read(path: Path, table: _Table) -> Iterator[EventBatch]:
    row = 0
    with open_binary(path) as file:
        if file.read(len(codecs.BOM_UTF8)) != codecs.BOM_UTF8:
            file.seek(0)
        for _ in range(table.skip):
            file.readline()
        for block in _whole_lines(path, file):
            events = _parse(path, block, table, row)
            if not table.named and row == 0:
                check_unnamed(events["t"])
            row += len(events)
            yield events


def _whole_lines(path: Path, file: BinaryIO) -> Iterator[bytes]:
    """Yield blocks of whole lines.

    Raises CutShortError instead of a last line that is torn: no newline and fewer than four fields.
    """
    rest = b""
    while data := file.read(_CHUNK_BYTES):
        data = rest + data
        end = data.rfind(b"\n") + 1
        if not end and len(data) >= _CHUNK_BYTES:
            raise damaged(path, "it has no lines")
        if end:
            yield data[:end]
        rest = data[end:]
    if len(re.findall(rb"[^\s,;]+", rest)) >= 4:
        yield rest
    elif rest.strip() and not rest.lstrip().startswith(b"#"):
        raise CutShortError("within a line")


def _parse(path: Path, body: bytes, table: _Table, row: int) -> EventBatch:
    if not body.strip():
        return empty_batch()
    body = _with_digits(body)
    fractions = table.fractions or table.unit_us != 1.0
    kind = np.dtype([("t", "f8" if fractions else "i8"), ("x", "f8"), ("y", "f8"), ("p", "f8")])
    options: dict[str, Any] = {"delimiter": table.separator, "comments": "#", "ndmin": 1, "encoding": "latin-1"}
    if table.named or table.columns[0] > 0:
        options["usecols"] = table.columns
    try:
        with warnings.catch_warnings():
            # Older numpy only warns where it reads "nan" as an integer.
            warnings.simplefilter("error", DeprecationWarning)
            warnings.filterwarnings("ignore", "loadtxt: input contained no data")
            rows = np.loadtxt(io.BytesIO(body), kind, **options)
    except (ValueError, DeprecationWarning) as error:
        raise InputError(f"{path}: {error} (rows counted from {row}); expected lines of t x y p") from None
    t = rows["t"]
    if fractions:
        if not np.all(np.abs(t) * table.unit_us < _LATEST_US):
            limit = "seconds below 9e9" if table.unit_us == 1e6 else "µs below 9e15"
            raise InputError(f"{path}: a time after row {row} is not a number of {limit}")
        t = np.rint(t * table.unit_us)
    return from_columns(t, rows["x"], rows["y"], rows["p"], first_row=row)
