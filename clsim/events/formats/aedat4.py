"""AEDAT4, the file format of iniVation's DV, written so that every flush reaches the disk as one packet.

A file is what dv_stream describes, between a 14-byte magic and a data table (``FTAB``: where each packet is and what
times it spans), whose position is entered in the header at close. faery's encoder is not used because it keeps up to
8 kB of packets in memory with no way to flush them.

Source: https://docs.inivation.com/software/software-advanced-usage/file-formats/aedat-4.0.html
"""

from __future__ import annotations

import contextlib
import os
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import lz4.frame
import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events.batch import EVENT_DTYPE, EventBatch
from clsim.events.formats.dv_stream import (
    AEDAT4_MAGIC,
    FRAMES_STREAM,
    MAX_HEADER_BYTES,
    MAX_PACKET_BYTES,
    MAX_SIDE,
    PACKET_HEAD,
    Compression,
    DvEncoder,
    StreamHeader,
    pack_header,
    parse_frame,
    parse_header,
    parse_packet,
)
from clsim.events.formats.filesink import ByteFile, FileSink, FlushPolicy, Limits
from clsim.events.formats.filesource import CutShortError, EventSource, damaged, open_binary

LIMITS = Limits("AEDAT4", size=MAX_SIDE)
_LZ4_MAGIC = 0x184D2204


class Aedat4Sink(FileSink):
    """Writes one packet a flush; the data table follows at close."""

    def __init__(self, path: Path, width: int, height: int, flush: FlushPolicy, *, frames: bool = False) -> None:
        """Create the file with its header, for ``frames`` too if wanted; raises InputError when it cannot be."""
        super().__init__(path, width, height, LIMITS, flush)
        self._frames = frames
        self._encoder = DvEncoder(width, height, frames=frames)
        self._table: list[tuple[int, ...]] = []  # stream, size, offset, count, first t, last t
        self._file = ByteFile(path, AEDAT4_MAGIC + self._encoder.header)

    def _store(self, events: EventBatch) -> None:
        times = events["t"]
        done = 0
        for packet, count in self._encoder.packets(events):
            self._append(0, packet, count, int(times[done]), int(times[done + count - 1]))
            done += count

    def write_image(self, time_us: int, image: npt.NDArray[np.uint8]) -> None:
        """Take an image ``[H, W, 3]``, in the order blue, green, red that DV keeps; events before it go first.

        Raises SinkError when the medium fails.
        """
        self._check_open()
        if image.shape != (self.height, self.width, 3) or image.dtype != np.uint8:
            raise ValueError(f"expected 8 bits [{self.height}, {self.width}, 3], got {image.dtype} {image.shape}")
        self.flush()
        packet = self._encoder.frame_packet(time_us, image)
        with self._noting_failures():
            self._append(FRAMES_STREAM, packet, 1, time_us, time_us)

    def _append(self, stream: int, packet: bytes, count: int, first_us: int, last_us: int) -> None:
        # DV counts offsets from the payload, behind the packet's head.
        offset, size = self._file.size + PACKET_HEAD.size, len(packet) - PACKET_HEAD.size
        self._file.write(packet)
        self._table.append((stream, size, offset, count, first_us, last_us))

    def _finish(self) -> None:
        try:
            if self._file.seekable():
                position = self._file.size
                self._file.write(lz4.frame.compress(_data_table(self._table)))
                header = pack_header(self.width, self.height, Compression.LZ4, position, frames=self._frames)
                self._file.write_at(len(AEDAT4_MAGIC), header)
        finally:
            self._file.close()


def open_sink(path: Path, width: int, height: int, flush: FlushPolicy) -> Aedat4Sink:
    """Open an AEDAT4 writer."""
    return Aedat4Sink(path, width, height, flush)


def open_source(path: Path) -> EventSource:
    """Open the first event stream of an AEDAT4 file."""
    header, start = _read_header(path)
    read = _read_with_faery if header.compression >= Compression.ZSTD else _read_packets
    return EventSource(path, header.width, header.height, read(path, start, header))


def read_frames(path: Path) -> Iterator[tuple[int, npt.NDArray[np.uint8]]]:
    """Yield the time [µs] and the image ``[H, W, 3]``, red, green and blue, of each frame, one at a time.

    None come of files without frames, and of those compressed with Zstandard.

    Raises:
        InputError: the file cannot be read, or is damaged.
    """
    header, start = _read_header(path)
    if header.compression >= Compression.ZSTD:
        return
    with contextlib.suppress(CutShortError):  # who reads the events tells of it
        for owner, place, payload in _payloads(path, start, header):
            if owner != header.stream_id:
                with _naming_packet(path, place):
                    frame = parse_frame(payload(), header.compression)
                if frame is not None:
                    yield frame


def _read_header(path: Path) -> tuple[StreamHeader, int]:
    """Return a file's header and where its packets start."""
    with open_binary(path) as file:
        if file.read(len(AEDAT4_MAGIC)) != AEDAT4_MAGIC:
            raise damaged(path, f"expected it to begin with {AEDAT4_MAGIC!r}")
        prefix = file.read(4)
        size = struct.unpack("<I", prefix)[0] if len(prefix) == 4 else 0
        if not 0 < size <= MAX_HEADER_BYTES:
            raise damaged(path, f"a header of {size} bytes")
        raw = prefix + file.read(size)
        start = file.tell()
    try:
        header = parse_header(raw, accept_zstd=True)
    except InputError as error:  # does not know the file
        raise damaged(path, error) from None
    return header, start


def _read_packets(path: Path, start: int, header: StreamHeader) -> Iterator[EventBatch]:
    for owner, place, payload in _payloads(path, start, header):
        if owner == header.stream_id:
            with _naming_packet(path, place):
                events = parse_packet(payload(), header)
            yield events


@contextlib.contextmanager
def _naming_packet(path: Path, place: int) -> Iterator[None]:
    try:
        yield
    except InputError as error:
        raise damaged(path, f"the packet at byte {place}: {error}") from None


def _payloads(path: Path, start: int, header: StreamHeader) -> Iterator[tuple[int, int, Callable[[], bytes]]]:
    """Yield the stream of each packet that is whole, its place, and a function that reads it; else it is skipped.

    Raises CutShortError where the file ends within a packet, or before the data table that its header tells of.
    """
    end = header.data_table_position
    with open_binary(path) as file:
        file.seek(start)
        while end < 0 or file.tell() < end:
            head = file.read(PACKET_HEAD.size)
            if not head and end < 0:
                return
            if len(head) < PACKET_HEAD.size:
                raise CutShortError("within a packet" if head else "before its data table")
            owner, size = PACKET_HEAD.unpack(head)
            if end < 0 and owner == _LZ4_MAGIC:
                return  # the writer was killed between data table and header: this is the table
            if not 0 <= size <= MAX_PACKET_BYTES:
                raise damaged(path, f"a packet of {size} bytes at byte {file.tell() - len(head)}")
            place = file.tell()
            if place + size > os.fstat(file.fileno()).st_size:
                raise CutShortError("within a packet")
            yield owner, place, lambda size=size: file.read(size)  # type: ignore[misc]
            file.seek(place + size)


def _read_with_faery(path: Path, start: int, header: StreamHeader) -> Iterator[EventBatch]:
    import faery  # it alone brings a Zstandard decoder

    with faery.aedat.Decoder(path) as decoder:
        for track, packet in decoder:
            if track.id == header.stream_id:
                yield packet.astype(EVENT_DTYPE)
    if path.stat().st_size < header.data_table_position:
        raise CutShortError("before its data table")


def _data_table(packets: list[tuple[int, ...]]) -> bytes:
    """Return the size-prefixed FTAB flatbuffer of (stream, size, offset, count, first t, last t) of every packet.

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
        for name, column in zip(("stream", "size", "offset", "count", "first_us", "last_us"), columns, strict=True):
            definitions[name] = column
    total = tables + definitions.nbytes
    head = struct.pack(
        "<II4s4H8HiII", total - 4, 32, b"FTAB", 6, 8, 4, 0, 14, 44, 12, 4, 20, 28, 36, 0, 24, 4, len(packets)
    )
    offsets = (places - (vector + 4 * np.arange(len(packets)))).astype("<u4").tobytes()
    return (head + offsets).ljust(tables, b"\0") + definitions.tobytes()
