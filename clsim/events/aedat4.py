"""AEDAT4, the file format of iniVation's DV, written so that every flush reaches the disk as one packet.

Layout: a 14-byte magic, a size-prefixed IOHeader flatbuffer, packets of (int32 stream id, int32 size, LZ4 frame of a
size-prefixed ``EVTS`` flatbuffer), and at close a data table (``FTAB``) whose position is then entered in the header.
DV's TCP protocol is the same without magic and data table. faery's encoder is not used for writing because it keeps up
to 8 kB of packets in memory with no way to flush them.

Source: https://docs.inivation.com/software/software-advanced-usage/file-formats/aedat-4.0.html
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import flatbuffers
import lz4.frame
import numpy as np

from clsim.events.batch import EventBatch, empty_batch
from clsim.events.filesink import ByteFile, FileSink, FlushPolicy, Limits
from clsim.events.filesource import EventSource, damaged, open_binary

MAGIC = b"#!AER-DAT4.0\r\n"
LIMITS = Limits("AEDAT4", size=2**15)

_WIRE_DTYPE = np.dtype({"names": ["t", "x", "y", "on"], "formats": ["<i8", "<i2", "<i2", "?"], "itemsize": 16})
_PACKET_HEADER = struct.Struct("<ii")
# An EVTS flatbuffer is one table with one vector: only its size and the vector's length ever change. Size, root offset,
# identifier, padding, vtable (its size, the table's size, the field's place), way back to it, vector offset, length.
_EVTS = struct.Struct("<II4sHHHHiII")
_LARGEST_PACKET = 1 << 28


def io_header(width: int, height: int, data_table_position: int = -1) -> bytes:
    """Return the size-prefixed IOHeader of one LZ4 event stream of this size."""
    text = _description(width, height)
    builder = flatbuffers.Builder(len(text) + 64)
    info = builder.CreateString(text)
    builder.StartObject(3)
    builder.PrependInt32Slot(0, 1, 0)  # LZ4
    # A default equal to no position, or the field would be left out and could not be entered later.
    builder.PrependInt64Slot(1, data_table_position, 0)
    builder.PrependUOffsetTRelativeSlot(2, info, 0)
    builder.FinishSizePrefixed(builder.EndObject(), b"IOHE")
    return bytes(builder.Output())


def encode_packet(events: EventBatch) -> bytes:
    """Return events as one packet of stream 0: header and LZ4-compressed EVTS flatbuffer."""
    body = np.zeros(len(events), _WIRE_DTYPE)
    for name in ("t", "x", "y", "on"):
        body[name] = events[name]
    raw = bytearray(_EVTS.size + body.nbytes)
    _EVTS.pack_into(raw, 0, len(raw) - 4, 16, b"EVTS", 0, 6, 8, 4, 6, 4, len(events))
    memoryview(raw)[_EVTS.size :] = body.view(np.uint8).data
    data: bytes = lz4.frame.compress(raw, store_size=False)
    return _PACKET_HEADER.pack(0, len(data)) + data


def decode_events(raw: bytes) -> EventBatch:
    """Return the events of a decompressed EVTS flatbuffer; raises ValueError when it is none."""
    if raw[8:12] != b"EVTS":
        raise ValueError(f"expected an EVTS packet, found {raw[8:12]!r}")
    table = 4 + struct.unpack_from("<I", raw, 4)[0]
    vtable = table - struct.unpack_from("<i", raw, table)[0]
    place = struct.unpack_from("<H", raw, vtable + 4)[0] if struct.unpack_from("<H", raw, vtable)[0] > 4 else 0
    if not place:
        return empty_batch()
    vector = table + place
    vector += struct.unpack_from("<I", raw, vector)[0]
    count = struct.unpack_from("<I", raw, vector)[0]
    body = np.frombuffer(raw, _WIRE_DTYPE, count, vector + 4)
    if count and (min(body["x"].min(), body["y"].min()) < 0 or body["t"].min() < 0):
        raise ValueError("an event has a negative time or coordinate")
    events = empty_batch(count)
    for name in ("t", "x", "y", "on"):
        events[name] = body[name]
    return events


class Aedat4Sink(FileSink):
    """Writes one packet a flush; the data table follows at close."""

    def __init__(self, path: Path, width: int, height: int, flush: FlushPolicy) -> None:
        """Create the file with its header; raises InputError when it cannot be."""
        super().__init__(path, width, height, LIMITS, flush)
        self._file = ByteFile(path)
        self._table: list[tuple[int, int, int, int, int]] = []  # offset, size, count, first t, last t
        self._file.write(MAGIC + io_header(width, height))

    def _store(self, events: EventBatch) -> None:
        packet = encode_packet(events)
        offset = self._file.size
        self._file.write(packet)
        size = len(packet) - _PACKET_HEADER.size
        # DV counts offsets from the payload, behind the packet's header.
        self._table.append((offset + _PACKET_HEADER.size, size, len(events), int(events["t"][0]), int(events["t"][-1])))

    def _finish(self) -> None:
        try:
            if self._file.seekable():
                position = self._file.size
                self._file.write(lz4.frame.compress(_data_table(self._table), store_size=False))
                self._file.write_at(len(MAGIC), io_header(self.width, self.height, position))
        finally:
            self._file.close()


def open_sink(path: Path, width: int, height: int, flush: FlushPolicy) -> Aedat4Sink:
    """Open an AEDAT4 writer."""
    return Aedat4Sink(path, width, height, flush)


def open_source(path: Path) -> EventSource:
    """Open the first event stream of an AEDAT4 file."""
    with open_binary(path) as file:
        magic, size = file.read(len(MAGIC)), file.read(4)
        if magic != MAGIC or len(size) < 4:
            raise damaged(path, f"expected it to begin with {MAGIC!r}")
        header = file.read(min(struct.unpack("<I", size)[0], _LARGEST_HEADER))
        start = file.tell()
    try:
        compression, table_position, description = _read_header(size + header)
        stream, width, height = _event_stream(description)
    except (ValueError, struct.error, ElementTree.ParseError, UnicodeDecodeError) as error:
        raise damaged(path, error) from error
    if compression in _ZSTD:
        return EventSource(path, width, height, _read_with_faery(path, stream))
    if compression not in (_NONE, *_LZ4):
        raise damaged(path, f"unknown compression {compression}")
    return EventSource(path, width, height, _read_packets(path, start, table_position, stream, compression))


_NONE, _LZ4, _ZSTD = 0, (1, 2), (3, 4)
_LARGEST_HEADER = 1 << 24
_LZ4_MAGIC = 0x184D2204


def _read_packets(path: Path, start: int, end: int, stream: int, compression: int) -> Iterator[EventBatch]:
    with open_binary(path) as file:
        file.seek(start)
        while end < 0 or file.tell() < end:
            head = file.read(_PACKET_HEADER.size)
            if len(head) < _PACKET_HEADER.size:
                return
            owner, size = _PACKET_HEADER.unpack(head)
            if owner == _LZ4_MAGIC and end < 0:
                return  # killed between data table and header: this is the table
            if not 0 <= size <= _LARGEST_PACKET:
                raise damaged(path, f"a packet of {size} bytes at byte {file.tell() - len(head)}")
            if owner != stream:
                file.seek(size, 1)
                continue
            data = file.read(size)
            if len(data) < size:
                return
            try:
                yield decode_events(data if compression == _NONE else _decompress(data))
            except (ValueError, struct.error, RuntimeError, EOFError) as error:
                raise damaged(path, f"packet at byte {file.tell() - size}: {error}") from error


def _decompress(data: bytes) -> bytes:
    inflater = lz4.frame.LZ4FrameDecompressor()
    raw = inflater.decompress(data, max_length=_LARGEST_PACKET)
    if not inflater.eof:
        raise ValueError("an LZ4 frame that does not end")
    return bytes(raw)


def _read_with_faery(path: Path, stream: int) -> Iterator[EventBatch]:
    import faery

    with faery.aedat.Decoder(path) as decoder:
        for track, packet in decoder:
            if track.id == stream:
                yield packet.astype(empty_batch().dtype, casting="unsafe")


def _read_header(raw: bytes) -> tuple[int, int, str]:
    """Return compression, position of the data table (-1: none) and XML description of an IOHeader."""
    if raw[8:12] != b"IOHE" or struct.unpack_from("<I", raw)[0] != len(raw) - 4:
        raise ValueError("expected a whole IOHE header")
    table = 4 + struct.unpack_from("<I", raw, 4)[0]
    vtable = table - struct.unpack_from("<i", raw, table)[0]
    if vtable < 0:
        raise ValueError("a header that points outside itself")
    length = struct.unpack_from("<H", raw, vtable)[0]
    places = [struct.unpack_from("<H", raw, vtable + at)[0] if at < length else 0 for at in (4, 6, 8)]
    compression = struct.unpack_from("<i", raw, table + places[0])[0] if places[0] else 0
    position = struct.unpack_from("<q", raw, table + places[1])[0] if places[1] else -1
    if not places[2]:
        raise ValueError("a header without description of its streams")
    text = table + places[2]
    text += struct.unpack_from("<I", raw, text)[0]
    end = text + 4 + struct.unpack_from("<I", raw, text)[0]
    if end > len(raw):
        raise ValueError("a description that points outside the header")
    return compression, position, raw[text + 4 : end].decode()


def _event_stream(description: str) -> tuple[int, int, int]:
    """Return id, width and height of the first event stream in a header's description."""
    if "<!" in description:  # no document type: entities could swell without bound
        raise ValueError("a description with a document type")
    for node in ElementTree.fromstring(description).iterfind("node[@name='outInfo']/node"):
        attributes = {attribute.get("key"): attribute.text for attribute in node.iterfind("attr")}
        if attributes.get("typeIdentifier") == "EVTS":
            info = {attribute.get("key"): attribute.text for attribute in node.iterfind("node[@name='info']/attr")}
            return int(node.get("name") or ""), int(info.get("sizeX") or ""), int(info.get("sizeY") or "")
    raise ValueError("no event stream in it")


def _description(width: int, height: int) -> str:
    path = "/mainloop/Recorder/outInfo/"
    root = ElementTree.Element("dv", version="2.0")
    out = ElementTree.SubElement(root, "node", name="outInfo", path=path)
    stream = ElementTree.SubElement(out, "node", name="0", path=f"{path}0/")
    info = ElementTree.Element("node", name="info", path=f"{path}0/info/")
    for node, key, kind, value in (
        (stream, "compression", "string", "LZ4"),
        (stream, "originalModuleName", "string", "clsim"),
        (stream, "originalOutputName", "string", "events"),
        (stream, "typeDescription", "string", "Array of events (polarity ON/OFF)."),
        (stream, "typeIdentifier", "string", "EVTS"),
        (info, "sizeX", "int", str(width)),
        (info, "sizeY", "int", str(height)),
        (info, "source", "string", "clsim"),
    ):
        ElementTree.SubElement(node, "attr", key=key, type=kind).text = value
    stream.append(info)
    return ElementTree.tostring(root, encoding="unicode")


def _data_table(packets: list[tuple[int, int, int, int, int]]) -> bytes:
    """Return the size-prefixed FTAB flatbuffer of (offset, size, count, first t, last t) of every packet.

    Laid out by hand, all tables sharing one vtable: long recordings have 10⁵ packets, too many for a builder in Python.
    """
    definitions = np.zeros(
        len(packets),
        np.dtype(
            [
                ("vtable", "<i4"),
                ("stream", "<i4"),
                ("size", "<i4"),
                ("offset", "<i8"),
                ("count", "<i8"),
                ("first_us", "<i8"),
                ("last_us", "<i8"),
                ("padding", "<i4"),
            ]
        ),
    )
    vector = 48
    tables = vector + 4 * len(packets)
    tables += (4 - tables) % 8  # so that the int64 fields, 12 bytes in, are aligned to 8
    places = tables + definitions.itemsize * np.arange(len(packets))
    definitions["vtable"] = places - 20
    if packets:
        columns = np.array(packets, np.int64).T
        for name, column in zip(("offset", "size", "count", "first_us", "last_us"), columns, strict=True):
            definitions[name] = column
    total = tables + definitions.nbytes
    head = struct.pack(
        "<II4s4H8HiII", total - 4, 32, b"FTAB", 6, 8, 4, 0, 14, 44, 12, 4, 20, 28, 36, 0, 24, 4, len(packets)
    )
    offsets = (places - (vector + 4 * np.arange(len(packets)))).astype("<u4").tobytes()
    return (head + offsets).ljust(tables, b"\0") + definitions.tobytes()
