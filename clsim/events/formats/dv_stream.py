"""The bytes of DV's network stream: a header, then packets of events.

The stream is an AEDAT 4 file without its 14-byte magic and without the data table at its end
(https://docs.inivation.com/software/software-advanced-usage/file-formats/aedat-4.0.html). The header is a size-prefixed
FlatBuffer ``IOHE`` (compression, position of the data table, XML description of the streams); a packet is
``int32 stream id, int32 size, payload``, where the payload is a size-prefixed FlatBuffer ``EVTS``, LZ4-framed if the
header says so.

What is written here always has the same layout, so it is packed by hand. What is read comes from strangers: every
offset is checked before it is followed, and every size is bounded before memory is spent on it.
"""

from __future__ import annotations

import enum
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from xml.etree import ElementTree

import lz4.frame
import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events.batch import EventBatch, empty_batch

AEDAT4_MAGIC = b"#!AER-DAT4.0\r\n"
"""What stands before the stream when it is kept as a file or sent through a pipe."""

EVENTS_PER_PACKET = 65_536
"""Larger batches are split: a packet is the unit that is dropped when a client is slow."""

MAX_HEADER_BYTES = 1 << 20
MAX_PACKET_BYTES = 64 << 20
_PIECE_BYTES = 1 << 20
MAX_SIDE = 32_768
"""Coordinates are int16."""

PACKET_HEAD = struct.Struct("<ii")
"""Stream id, size of the payload."""

# One event as FlatBuffers stores the struct: 8-aligned, three bytes of padding.
_WIRE_DTYPE = np.dtype(
    {
        "names": ["t", "x", "y", "on"],
        "formats": ["<i8", "<i2", "<i2", "u1"],
        "offsets": [0, 8, 10, 12],
        "itemsize": 16,
    }
)
# Size prefix, offset of the root table, identifier, padding, vtable (its size, the table's size, field 0), table (back
# offset to the vtable, offset of the vector), length of the vector. The events follow at byte 32.
_EVENTS_HEAD = struct.Struct("<II4s2x3HiII")
# A frame: the vtable names time, format, width, height and pixels, of 11 fields; then the table and the pixels' length.
_FRAME_HEAD = struct.Struct("<II4s6x13HiqhhIb3xI")
_FRAME_VTABLE = (26, 24, 4, 0, 0, 0, 0, 20, 12, 14, 0, 0, 16)
_BLUE_GREEN_RED = 16
_CHANNELS = {0: 1, _BLUE_GREEN_RED: 3, 24: 4}
"""Channels of OpenCV's types of 8 bits: grey, blue, green and red, and those with opacity."""
FRAMES_STREAM = 1
"""Stream id of frames beside the events, which are stream 0."""
# The same as of events, with the vtable's three fields: compression, data table position, description.
_HEADER_HEAD = struct.Struct("<II4s6x5HiiIq4xI")


class Compression(enum.IntEnum):
    """How payloads are compressed, as the header's first field says."""

    NONE = 0
    LZ4 = 1
    LZ4_HIGH = 2
    ZSTD = 3
    ZSTD_HIGH = 4


@dataclass(frozen=True)
class StreamHeader:
    """What a client learns before the first packet."""

    compression: Compression
    width: int
    height: int
    stream_id: int = 0
    """Packets of other ids are not events."""
    data_table_position: int = -1
    """Where a file's packets end; -1 in a stream, and in a file whose writer was killed."""


class DvEncoder:
    """Turns batches into packets of one event stream; buffers are reused, so one thread at a time."""

    def __init__(
        self, width: int, height: int, compression: Compression = Compression.LZ4, *, frames: bool = False
    ) -> None:
        """Prepare the header for a sensor of ``width`` × ``height`` pixels, with a stream of ``frames`` if wanted.

        Raises:
            InputError: a side is not within 1 … 32768.
        """
        if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE):
            raise InputError(f"a DV stream's coordinates are int16: {width}x{height} is not within 1x1 … 32768x32768")
        self.header = pack_header(width, height, compression, frames=frames)
        """The first bytes every client gets."""
        self._limits = (width, height)
        self._compression = compression
        self._payload = bytearray(_EVENTS_HEAD.size + _WIRE_DTYPE.itemsize * EVENTS_PER_PACKET)
        self._events = np.frombuffer(self._payload, _WIRE_DTYPE, offset=_EVENTS_HEAD.size)

    def packets(self, batch: EventBatch) -> Iterator[tuple[bytes, int]]:
        """Yield ``(packet, number of events in it)``; nothing if the batch is empty.

        Raises:
            InputError: an event lies outside the sensor.
        """
        for start in range(0, len(batch), EVENTS_PER_PACKET):
            part = batch[start : start + EVENTS_PER_PACKET]
            yield self._packet(part), len(part)

    def frame_packet(self, time_us: int, image: npt.NDArray[np.uint8]) -> bytes:
        """Return the packet of an image ``[H, W, 3]`` of 8 bits, in the order blue, green, red."""
        height, width, _ = image.shape
        table = (26, time_us, width, height, 8, _BLUE_GREEN_RED, image.size)
        head = _FRAME_HEAD.pack(_FRAME_HEAD.size - 4 + image.size, 40, b"FRME", *_FRAME_VTABLE, *table)
        payload = head + image.tobytes()
        if self._compression is not Compression.NONE:
            payload = lz4.frame.compress(payload)
        return PACKET_HEAD.pack(FRAMES_STREAM, len(payload)) + payload

    def _packet(self, part: EventBatch) -> bytes:
        count = len(part)
        events = self._events[:count]
        for name in ("t", "x", "y", "on"):
            events[name] = part[name]
        for name, limit in zip(("x", "y"), self._limits, strict=True):
            # As uint16, so that what int16 made negative is too large as well.
            largest = int(events[name].view("<u2").max())
            if largest >= limit:
                raise InputError(f"an event has {name} = {largest}, but the sensor's {name} ends at {limit - 1}")
        size = _EVENTS_HEAD.size + _WIRE_DTYPE.itemsize * count
        _EVENTS_HEAD.pack_into(self._payload, 0, size - 4, 16, b"EVTS", 6, 8, 4, 6, 4, count)
        payload = memoryview(self._payload)[:size]
        if self._compression is not Compression.NONE:
            payload = lz4.frame.compress(payload)
        return PACKET_HEAD.pack(0, len(payload)) + payload


_STREAM = """        <node name="{id}" path="/outInfo/{id}/">
            <attr key="compression" type="string">{compression}</attr>
            <attr key="originalModuleName" type="string">clsim</attr>
            <attr key="originalOutputName" type="string">{name}</attr>
            <attr key="typeDescription" type="string">{type}</attr>
            <attr key="typeIdentifier" type="string">{mark}</attr>
            <node name="info" path="/outInfo/{id}/info/">
                <attr key="sizeX" type="int">{width}</attr>
                <attr key="sizeY" type="int">{height}</attr>
                <attr key="source" type="string">clsim</attr>
            </node>
        </node>
"""


def pack_header(
    width: int, height: int, compression: Compression, data_table_position: int = -1, *, frames: bool = False
) -> bytes:
    """Return the header of a stream of events, and one of ``frames`` if wanted.

    A file that is complete names the position of its data table in it.
    """
    kinds = [("events", "Array of events (polarity ADDRESS-EVENTs).", "EVTS")]
    kinds += [("frames", "Standard frame (8-bit image).", "FRME")] if frames else []
    streams = "".join(
        _STREAM.format(
            id=index, compression=compression.name, name=name, type=text, mark=mark, width=width, height=height
        )
        for index, (name, text, mark) in enumerate(kinds)
    )
    description = (
        f'<dv version="2.0">\n    <node name="outInfo" path="/outInfo/">\n{streams}    </node>\n</dv>\n'
    ).encode()
    padding = bytes(4 - len(description) % 4)  # at least the one NUL that ends a FlatBuffers string
    size = _HEADER_HEAD.size + len(description) + len(padding)
    layout = (10, 24, 4, 12, 8, 10)
    fields = (int(compression), 16, data_table_position, len(description))
    return _HEADER_HEAD.pack(size - 4, 24, b"IOHE", *layout, *fields) + description + padding


class _Table:
    """The root table of a size-prefixed FlatBuffer; no offset is followed before it is known to lie inside."""

    def __init__(self, data: bytes | bytearray | memoryview, identifier: bytes) -> None:
        self._data = memoryview(data)
        if len(data) < 12:
            raise InputError(f"a FlatBuffer of {len(data)} bytes is too short")
        if bytes(self._data[8:12]) != identifier:
            raise InputError(f"a FlatBuffer is marked {bytes(self._data[8:12])!r} where {identifier!r} was expected")
        self._table = 4 + self.read("<I", 4)
        self._vtable = self._table - self.read("<i", self._table)
        self._vtable_size = self.read("<H", self._vtable)
        if self._vtable_size < 4:
            raise InputError(f"a FlatBuffer's vtable of {self._vtable_size} bytes is too short")

    def read(self, layout: str, offset: int) -> int:
        """Return the number at ``offset``."""
        if not 0 <= offset <= len(self._data) - struct.calcsize(layout):
            raise InputError(f"a FlatBuffer of {len(self._data)} bytes points to byte {offset}")
        number: int = struct.unpack_from(layout, self._data, offset)[0]
        return number

    def field(self, index: int) -> int | None:
        """Return where field ``index`` is stored, or None if it is absent and so has its default."""
        entry = 4 + 2 * index
        if entry + 2 > self._vtable_size:
            return None
        offset = self.read("<H", self._vtable + entry)
        return self._table + offset if offset else None

    def vector(self, index: int, item_bytes: int) -> tuple[int, int]:
        """Return where the items of the vector in field ``index`` start and how many there are."""
        field = self.field(index)
        if field is None:
            return 0, 0
        start = field + self.read("<I", field)
        count = self.read("<I", start)
        if start + 4 + count * item_bytes > len(self._data):
            raise InputError(f"a FlatBuffer of {len(self._data)} bytes claims to hold {count} items of {item_bytes}")
        return start + 4, count


def parse_header(data: bytes, accept_zstd: bool = False) -> StreamHeader:
    """Read a header (with its size prefix).

    Raises:
        InputError: it is malformed, describes no event stream, or names a compression other than none and LZ4
            (parse_packet reads no other; ``accept_zstd`` is for callers who bring their own decoder).
    """
    table = _Table(data, b"IOHE")
    field = table.field(0)
    number = 0 if field is None else table.read("<i", field)
    try:
        compression = Compression(number)
    except ValueError:
        raise InputError(f"the stream's header names compression {number}, expected 0 (none) or 1 (LZ4)") from None
    if compression in (Compression.ZSTD, Compression.ZSTD_HIGH) and not accept_zstd:
        raise InputError("the stream is compressed with Zstandard, expected none or LZ4; choose one of these in DV")
    field = table.field(1)
    position = -1 if field is None else table.read("<q", field)
    start, count = table.vector(2, 1)
    stream_id, width, height = _parse_description(data[start : start + count])
    return StreamHeader(compression, width, height, stream_id, position)


def _parse_description(description: bytes) -> tuple[int, int, int]:
    """Return id, width and height of the first event stream."""
    if b"<!" in description:  # a document type could declare entities that expand without bound
        raise InputError("the stream's XML description holds a '<!' declaration, expected plain elements")
    try:
        root = ElementTree.fromstring(description)
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # the latter two: a bad or unknown encoding
        raise InputError(f"the stream's XML description cannot be read: {error}") from None
    for node in root.findall("./node[@name='outInfo']/node"):
        if node.findtext("./attr[@key='typeIdentifier']") != "EVTS":
            continue
        numbers = []
        for what, text in (
            ("stream id", node.get("name")),
            ("sizeX", node.findtext("./node[@name='info']/attr[@key='sizeX']")),
            ("sizeY", node.findtext("./node[@name='info']/attr[@key='sizeY']")),
        ):
            if text is None or not (text.isascii() and text.isdigit() and len(text) <= 5 and int(text) <= MAX_SIDE):
                raise InputError(f"the stream's description has {what} = {text!r}, expected a number within 0 … 32768")
            numbers.append(int(text))
        stream_id, width, height = numbers
        if not (width and height):
            raise InputError(f"the stream's description gives a sensor of {width}x{height} pixels")
        return stream_id, width, height
    raise InputError("the stream's description names no event stream (typeIdentifier EVTS)")


def parse_packet(payload: bytes | bytearray, header: StreamHeader) -> EventBatch:
    """Read the payload of a packet of events.

    Events are in the sender's order.

    Raises:
        InputError: it is malformed, too large when decompressed, or an event lies outside the sensor.
    """
    if header.compression is not Compression.NONE:
        payload = _decompress(payload)
    start, count = _Table(payload, b"EVTS").vector(0, _WIRE_DTYPE.itemsize)
    events = np.frombuffer(payload, _WIRE_DTYPE, count=count, offset=start)
    batch = empty_batch(count)
    for name in ("t", "x", "y"):
        batch[name] = events[name]
    batch["on"] = events["on"] != 0
    outside = (batch["x"] >= header.width) | (batch["y"] >= header.height)
    if outside.any():
        first = events[outside][0]
        raise InputError(
            f"an event has x, y = {first['x']}, {first['y']}; "
            f"expected them within the sensor of {header.width}x{header.height} pixels"
        )
    return batch


def parse_frame(payload: bytes | bytearray, compression: Compression) -> tuple[int, npt.NDArray[np.uint8]] | None:
    """Read the payload of a packet of a frame; None if it is something else.

    Returns:
        The frame's time [µs], and the image ``[H, W, 3]`` in the order red, green, blue.

    Raises:
        InputError: it is malformed, or not of 8 bits with 1, 3 or 4 channels.
    """
    if compression is not Compression.NONE:
        payload = _decompress(payload)
    if bytes(payload[8:12]) != b"FRME":
        return None
    table = _Table(payload, b"FRME")

    def number(index: int, layout: str) -> int:
        field = table.field(index)
        return 0 if field is None else table.read(layout, field)

    kind, width, height = number(5, "<b"), number(6, "<h"), number(7, "<h")
    if kind not in _CHANNELS:
        raise InputError(f"a frame's pixels are of OpenCV's type {kind}, expected {', '.join(map(str, _CHANNELS))}")
    start, count = table.vector(10, 1)
    channels = _CHANNELS[kind]
    if min(width, height) < 1 or count != width * height * channels:
        raise InputError(f"a frame of {width}x{height} pixels and {channels} channels has {count} bytes")
    pixels = np.frombuffer(payload, np.uint8, count, start).reshape(height, width, channels)
    image = pixels.repeat(3, axis=2) if channels == 1 else pixels[:, :, 2::-1]
    return number(0, "<q"), image


def _decompress(payload: bytes | bytearray) -> bytearray:
    decompressor = lz4.frame.LZ4FrameDecompressor()
    data = bytearray()
    try:
        # In pieces: the decompressor allocates all it is allowed to fill.
        piece = decompressor.decompress(payload, max_length=_PIECE_BYTES)
        while piece and len(data) <= MAX_PACKET_BYTES:
            data += piece
            piece = b"" if decompressor.eof else decompressor.decompress(b"", max_length=_PIECE_BYTES)
    except RuntimeError as error:
        raise InputError(f"a packet's LZ4 frame is damaged: {error}") from None
    if not decompressor.eof or len(data) > MAX_PACKET_BYTES:
        raise InputError(f"a packet's LZ4 frame is cut off or longer than {MAX_PACKET_BYTES >> 20} MiB")
    return data
