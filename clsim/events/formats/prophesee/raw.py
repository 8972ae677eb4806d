"""Prophesee's RAW files: their header, and which encoding follows it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Literal

from clsim.errors import InputError
from clsim.events.formats.filesource import EventSource, damaged, open_binary
from clsim.events.formats.prophesee.evt2_words import Encoding, Evt2Decoder
from clsim.events.formats.prophesee.evt2_words import decode_file as decode_evt2_file
from clsim.events.formats.prophesee.evt3_words import Evt3Decoder
from clsim.events.formats.prophesee.evt3_words import decode_file as decode_evt3_file

_HEADER_FIELDS = tuple(
    re.compile(pattern)
    for pattern in (
        r"^(?:evt |format EVT)(?P<version>\d(?:\.?\d)?)",
        r"^geometry (?P<width>\d{1,5})x(?P<height>\d{1,5})$",
        r"[ ;]width=(?P<width>\d{1,5})",
        r"[ ;]height=(?P<height>\d{1,5})",
        r"\bendianness[ =](?P<order>\w{1,9})",
    )
)
_MOST_HEADER_LINES, _LONGEST_HEADER_LINE = 1000, 10_000


def raw_header(version: str, width: int, height: int) -> bytes:
    """Return the header of an EVT file; ``% end`` keeps events that begin with a ``%`` byte from being read as text."""
    return (
        f"% evt {version}.0\n% format EVT{version};height={height};width={width}\n% geometry {width}x{height}\n% end\n"
    ).encode()


def open_raw_source(path: Path) -> EventSource:
    """Open a ``.raw`` file; its header tells EVT2, EVT2.1, EVT3 and EVT4 apart.

    Decoded here: faery's decoders lose 16.8 s for every lap of EVT3's clock that passes without an event, and give
    times to events that have none. The others that are kept read fewer of the four.
    """
    with open_binary(path) as file:
        header = _read_raw_header(path, file)
        start = file.tell()
    size = header.width, header.height
    if header.encoding == "evt3":
        decoder = Evt3Decoder(*size)
        batches = decode_evt3_file(path, start, decoder)
        return EventSource(path, *size, batches, lambda: decoder.dropped_events, format="evt3")
    words = Evt2Decoder(header.encoding, *size)
    batches = decode_evt2_file(path, start, words)
    name = header.encoding.removesuffix("-legacy")
    return EventSource(path, *size, batches, lambda: words.dropped_events, format=name)


_VERSIONS: dict[str, Encoding | Literal["evt3"]] = {
    "2": "evt2", "2.0": "evt2", "2.1": "evt21", "21": "evt21", "3": "evt3", "3.0": "evt3", "4": "evt4", "4.0": "evt4",
}  # fmt: skip


@dataclass(frozen=True)
class _RawHeader:
    encoding: Encoding | Literal["evt3"]
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
    encoding = _VERSIONS.get(version)
    if encoding is None:
        raise InputError(f"{path}: is EVT{version}; expected EVT2, EVT2.1, EVT3 or EVT4")
    # OpenEB's rule: without a word on it, the halves of EVT2.1's words are the other way round.
    order = fields.get("order", "legacy")
    if encoding == "evt21" and order != "little":
        if order != "legacy":
            raise InputError(f"{path}: its EVT2.1 is {order}-endian; expected little or legacy")
        encoding = "evt21-legacy"
    width, height = (int(fields[name]) or None if name in fields else None for name in ("width", "height"))
    return _RawHeader(encoding, width, height)
