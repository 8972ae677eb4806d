"""What EVT2, EVT3 and DAT share: text headers, and faery's decoders behind one face."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from clsim.errors import InputError
from clsim.events.batch import EVENT_DTYPE, EventBatch
from clsim.events.evt3_words import Evt3Decoder, decode_file
from clsim.events.filesource import EventSource, damaged, open_binary

# faery falls back to this size where the header has none; no sensor has it, so it means "unknown".
_NO_SIZE = (65535, 65535)

_HEADER_FIELDS = tuple(
    re.compile(pattern)
    for pattern in (
        r"^(?:evt |format EVT)(?P<version>\d(?:\.?\d)?)",
        r"^geometry (?P<width>\d{1,5})x(?P<height>\d{1,5})$",
        r"[ ;]width=(?P<width>\d{1,5})",
        r"[ ;]height=(?P<height>\d{1,5})",
    )
)
_MOST_HEADER_LINES, _LONGEST_HEADER_LINE = 1000, 10_000


def raw_header(version: str, width: int, height: int) -> bytes:
    """Return the header of an EVT file; ``% end`` keeps events that begin with a ``%`` byte from being read as text."""
    return (
        f"% evt {version}.0\n% format EVT{version};height={height};width={width}\n% geometry {width}x{height}\n% end\n"
    ).encode()


def open_raw_source(path: Path) -> EventSource:
    """Open a ``.raw`` file; its header tells EVT2 and EVT3 apart.

    EVT3 is decoded here: faery's decoder loses 16.8 s for every lap of the clock that passes without an event.
    """
    with open_binary(path) as file:
        header = _read_raw_header(path, file)
        start = file.tell()
    if header.version.startswith("3"):
        decoder = Evt3Decoder(header.width, header.height)
        batches = decode_file(path, start, decoder)
        return EventSource(path, header.width, header.height, batches, lambda: decoder.dropped_events)

    if header.version not in ("2", "2.0"):
        raise InputError(f"{path}: is EVT{header.version}; expected EVT2 or EVT3")
    import faery

    words = faery.evt.Decoder(path, _NO_SIZE, "evt2")
    return EventSource(path, header.width, header.height, faery_batches(words, lambda packet: packet.get("events")))


@dataclass(frozen=True)
class _RawHeader:
    version: str
    width: int | None
    height: int | None


def _read_raw_header(path: Path, file: BinaryIO) -> _RawHeader:
    """Read the header's lines and leave the file at the first event."""
    fields: dict[str, str] = {}
    for _ in range(_MOST_HEADER_LINES):
        start = file.tell()
        line = file.readline(_LONGEST_HEADER_LINE)
        if not line.startswith(b"% "):
            file.seek(start)
            break
        text = line[2:].decode("latin-1").strip()
        if text == "end":
            break
        for pattern in _HEADER_FIELDS:
            found = pattern.search(text)
            fields.update(found.groupdict() if found else {})
    version = fields.get("version", "")
    if not version:
        raise damaged(path, "its header names no EVT version")
    width, height = (int(fields[name]) if name in fields else None for name in ("width", "height"))
    return _RawHeader(version, width, height)


def open_dat_source(path: Path) -> EventSource:
    """Open a ``.dat`` file of change-detection events."""
    with open_binary(path) as file:
        if file.read(1) != b"%":
            raise damaged(path, "expected a header of lines that begin with %")

    import faery

    decoder = faery.dat.Decoder(path, _NO_SIZE, None)
    if decoder.event_type == "trigger":
        raise damaged(path, "it holds trigger events; expected change-detection events")
    width, height = (None, None) if decoder.dimensions == _NO_SIZE else decoder.dimensions
    return EventSource(path, width, height, faery_batches(decoder, lambda packet: packet))


def faery_batches(decoder: Any, events_of: Callable[[Any], Any]) -> Iterator[EventBatch]:
    """Yield the batches of a faery decoder.

    ``events_of(packet)`` is a structured array with t, x, y and on or payload, or None where a packet has no events.
    """
    with decoder:
        for packet in decoder:
            found = events_of(packet)
            if found is None:
                continue
            batch = np.empty(len(found), EVENT_DTYPE)
            batch["t"], batch["x"], batch["y"] = found["t"], found["x"], found["y"]
            batch["on"] = found["on" if "on" in found.dtype.names else "payload"] != 0
            yield batch
