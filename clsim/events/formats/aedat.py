"""AEDAT 3.1, 2 and 1, the files of cAER and jAER. Only read.

AEDAT 3.1: packets of one kind of event each, little-endian; a polarity event is 32 bits of address (valid, ON, 15 bits
of y, 15 of x) and 31 bits of time, whose laps are told by the packet. AEDAT 2 and 1: big-endian address and time of
each event; what the address means depends on the chip that the header names, and rows count from below. As jAER has it,
columns are mirrored, and a DVS128 writes 0 where brightness rose.

Sources: https://docs.inivation.com/software/software-advanced-usage/file-formats/, and for AEDAT 2
https://github.com/SensorsINI/jaer (DVS128.java, DavisBaseCamera.java).
"""

from __future__ import annotations

import contextlib
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events.batch import EventBatch, empty_batch
from clsim.events.formats.filesource import CHUNK_EVENTS, CutShortError, EventSource, damaged, open_binary
from clsim.events.formats.laps import Laps

_SIZES = {
    "dvs128": (128, 128), "davis128": (128, 128), "davis208": (208, 192), "davis240": (240, 180),
    "davis346": (346, 260), "davis640": (640, 480), "dvs132s": (132, 104), "dvxplorerlite": (320, 240),
    "dvxplorer": (640, 480),
}  # fmt: skip
"""Sensors by the beginning of their chip's name."""
_LONGEST_LINE = 1 << 16
_PACKET = struct.Struct("<HHiiiiii")
_POLARITY, _EVENT_BYTES = 1, 8
_LARGEST_PACKET = 1 << 28
_LAP_BITS = 31
_COMPRESSED = 0x8000
"""cAER's mark in the type of a packet, whose capacity then tells bytes."""
_HEADER_LINE = re.compile(rb"#[^\x00-\x08\x0b\x0c\x0e-\x1f]*")
"""An event may begin with the byte of a ``#`` too."""
_HEADER_END = re.compile(r"#!END-HEADER|#\s*End Of ASCII Header", re.IGNORECASE)
# DAVIS: what tells a polarity event from samples and others, and where its parts are.
_DAVIS_OTHERS = 0x80000400
_DVS128_SPECIAL = 0x8000


@dataclass(frozen=True)
class _Header:
    version: str
    chip: str
    start: int
    sources: dict[int, str]
    """Chips of AEDAT 3.1 by the numbers of their sources."""

    @property
    def size(self) -> tuple[int, int] | None:
        return _size_of(self.chip)


def _size_of(chip: str) -> tuple[int, int] | None:
    return next((size for name, size in _SIZES.items() if chip.startswith(name)), None)


def open_source(path: Path) -> EventSource:
    """Open an ``.aedat`` file; its first line tells the version."""
    with open_binary(path) as file:
        header = _read_header(path, file)
    if header.version == "3.1":
        first = _first_source(path, header.start)
        width, height = _size_of(header.sources.get(first, header.chip)) or (None, None)
        batches = (events for source, events in _packets(path, header.start) if source == first)
        return EventSource(path, width, height, batches, format="aedat 3.1")
    if header.version not in ("1.0", "2.0"):
        raise InputError(f"{path}: is AEDAT {header.version}; expected 3.1, 2.0 or 1.0 (AEDAT 4 ends in .aedat4)")
    if header.size is None or not header.chip.startswith(("dvs128", "davis")):
        raise InputError(
            f"{path}: its chip is {header.chip or 'not named'}, whose addresses are not known; expected DVS128 or DAVIS"
        )
    return EventSource(path, *header.size, _records(path, header, *header.size), format=f"aedat {header.version}")


def _read_header(path: Path, file: BinaryIO) -> _Header:
    line = file.readline(_LONGEST_LINE)
    found = re.match(rb"#!AER-DAT(\d\.\d)", line)
    if found is None:
        raise damaged(path, "expected it to begin with #!AER-DAT")
    version, chip, sources = found[1].decode(), "", dict[int, str]()
    start = file.tell()
    while _HEADER_LINE.fullmatch(line := file.readline(_LONGEST_LINE)):
        start = file.tell()
        text = line.decode("latin-1").strip()
        if _HEADER_END.match(text):
            break
        if source := re.match(r"#Source (\d{1,4}):\s*(\w+)", text):
            sources[int(source[1])] = source[2].lower()
        if told := re.match(r"#\s*AEChip:\s*(?:[\w.]*\.)?(\w+)", text) or re.match(r"#Source \d+:\s*(\w+)", text):
            chip = chip or told[1].lower()
    # Before jAER told the chip, there was one.
    old = not chip and version in ("1.0", "2.0")
    return _Header(version, "dvs128" if old and _has_dvs128(path, start, version) else chip, start, sources)


def _has_dvs128(path: Path, start: int, version: str) -> bool:
    """Tell whether addresses fit the 16 bits of a DVS128, as far as a first look goes."""
    with open_binary(path) as file:
        file.seek(start)
        records = _of_bytes(file.read(_EVENT_BYTES * CHUNK_EVENTS), version)
    return bool((records["address"] < 1 << 16).all())


def _of_bytes(data: bytes, version: str) -> npt.NDArray[np.void]:
    kind = np.dtype([("address", ">u2" if version == "1.0" else ">u4"), ("t", ">u4")])
    return np.frombuffer(data[: len(data) // kind.itemsize * kind.itemsize], kind)


def _records(path: Path, header: _Header, width: int, height: int) -> Iterator[EventBatch]:
    laps = Laps(1 << 32)
    size = 6 if header.version == "1.0" else _EVENT_BYTES
    with open_binary(path) as file:
        file.seek(header.start)
        while data := file.read(size * CHUNK_EVENTS):
            records = _of_bytes(data, header.version)
            address = records["address"].astype(np.uint32)
            if header.chip.startswith("dvs128"):
                is_event = address & _DVS128_SPECIAL == 0
                columns, rows, on = address >> 1 & 0x7F, address >> 8 & 0x7F, address & 1 == 0
            else:
                is_event = address & _DAVIS_OTHERS == 0
                columns, rows, on = address >> 12 & 0x3FF, address >> 22 & 0x1FF, address >> 11 & 1 != 0
            _check(columns[is_event], rows[is_event], width, height)
            t = laps.unroll(records["t"].astype(np.int64))
            events = empty_batch(len(records))
            events["t"], events["on"] = t, on
            events["x"], events["y"] = width - 1 - columns.astype(np.int64), height - 1 - rows.astype(np.int64)
            yield events[is_event]
            if len(data) % size:
                raise CutShortError("within an event")


def _check(columns: npt.NDArray[np.uint32], rows: npt.NDArray[np.uint32], width: int, height: int) -> None:
    for name, values, size in (("x", columns, width), ("y", rows, height)):
        if len(values) and int(values.max()) >= size:
            raise ValueError(f"an event at {name} = {values.max()} lies outside the sensor's {size} pixels")


def _first_source(path: Path, start: int) -> int:
    """Return the number of the source of the first events."""
    with contextlib.suppress(CutShortError):
        return next((source for source, _ in _packets(path, start)), 0)
    return 0


def _packets(path: Path, start: int) -> Iterator[tuple[int, EventBatch]]:
    """Yield the events of each packet, and the number of their source."""
    with open_binary(path) as file:
        file.seek(start)
        while len(head := file.read(_PACKET.size)) == _PACKET.size:
            kind, source, size, _, laps, capacity, count, _ = _PACKET.unpack(head)
            length = capacity if kind & _COMPRESSED else size * capacity
            if size < 0 or capacity < 0 or length > _LARGEST_PACKET or count < 0:
                raise ValueError(f"a packet of {count} of {capacity} events of {size} bytes")
            if kind & ~_COMPRESSED != _POLARITY:
                file.seek(max(0, length - 1), 1)
                if length and not file.read(1):
                    raise CutShortError("within a packet")
                continue
            if kind & _COMPRESSED:
                raise ValueError("a packet of events is compressed, expected cAER's format RAW")
            if size != _EVENT_BYTES or count > capacity:
                raise ValueError(f"a packet of {count} of {capacity} polarity events of {size} bytes")
            data = file.read(length)
            yield source, _polarity(data[: size * count], laps)
            if len(data) < length:
                raise CutShortError("within a packet")
        if head:
            raise CutShortError("within a packet")


def _polarity(data: bytes, laps: int) -> EventBatch:
    records = np.frombuffer(data[: len(data) // _EVENT_BYTES * _EVENT_BYTES], "<u4").reshape(-1, 2)
    records = records[records[:, 0] & 1 != 0]
    events = empty_batch(len(records))
    events["t"] = records[:, 1].astype(np.int64) + (laps << _LAP_BITS)
    events["on"] = records[:, 0] & 2
    events["y"], events["x"] = records[:, 0] >> 2 & 0x7FFF, records[:, 0] >> 17
    return events
