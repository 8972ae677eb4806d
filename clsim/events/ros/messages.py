"""Events in messages of ROS: EventPacket and EventArray, serialised and read without ROS.

Definitions: github.com/ros-event-camera/event_camera_msgs, github.com/uzh-rpg/rpg_dvs_ros (dvs_msgs) and
github.com/prophesee-ai/prophesee_ros_wrapper; encodings of packets: github.com/ros-event-camera/event_camera_codecs.
Serialisation: OMG CDR for ROS 2, wiki.ros.org/msg for ROS 1. Clocks of ROS count ns; ours starts at their 0.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from clsim.events.batch import EventBatch, empty_batch
from clsim.events.formats.prophesee.evt3_words import Evt3Decoder

PACKET, ARRAY, EVENT = "event_camera_msgs/msg/EventPacket", "dvs_msgs/msg/EventArray", "dvs_msgs/msg/Event"
PROPHESEE_ARRAY, PROPHESEE_EVENT = "prophesee_event_msgs/msg/EventArray", "prophesee_event_msgs/msg/Event"
OLDER_PACKET = "event_array_msgs/msg/EventArray"
"""What EventPacket was called at first."""
EVENT_TYPES = (PACKET, OLDER_PACKET, ARRAY, PROPHESEE_ARRAY)
"""Messages that hold events."""

_EVENT_TEXT = "uint16 x\nuint16 y\n{time} ts\nbool polarity\n"
_ARRAY_TEXT = "std_msgs/Header header\nuint32 height\nuint32 width\n{event}[] events\n"
_PACKET_TEXT = (
    "std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\nstring encoding\n"
    "bool is_bigendian\nuint8[] events\n"
)
MONO_SPAN_US = 4_000_000
"""A packet of encoding mono counts its ns in 32 bits: less than 4.29 s."""
_US_PER_S = 1_000_000
_WORD_BYTES = {"mono": 8, "evt3": 2, "libcaer": 8, "libcaer_cmp": 2}
# Words of libcaer_cmp, by their upper 4 bits.
_CMP_TIME_HIGH, _CMP_TIME_LOW, _CMP_COLUMN, _CMP_ROW, _CMP_BASE, _CMP_VECTOR = range(6)
_ARRAY_DTYPES = {
    2: np.dtype({
        "names": ["x", "y", "s", "ns", "on"], "formats": ["<u2", "<u2", "<i4", "<u4", "u1"],
        "offsets": [0, 2, 6, 10, 14], "itemsize": 16,
    }),
    1: np.dtype({
        "names": ["x", "y", "s", "ns", "on"], "formats": ["<u2", "<u2", "<u4", "<u4", "u1"],
        "offsets": [0, 2, 4, 8, 12], "itemsize": 13,
    }),
}  # fmt: skip
"""Events in an EventArray, by version of ROS. ROS 1 packs them. CDR aligns each number to its size, not each event: all
but the first, whose ``x`` and ``y`` lie 2 bytes later, are as here, from 2 bytes before the first on."""


def definitions(ros: int) -> dict[str, str]:
    """Return the texts of the definitions that ROS itself does not bring, by type, for ROS ``ros`` (1 or 2)."""
    time = "builtin_interfaces/Time" if ros == 2 else "time"
    return {
        PACKET: _PACKET_TEXT,
        EVENT: _EVENT_TEXT.format(time=time),
        ARRAY: _ARRAY_TEXT.format(event="dvs_msgs/Event"),
        PROPHESEE_EVENT: _EVENT_TEXT.format(time=time),
        PROPHESEE_ARRAY: _ARRAY_TEXT.format(event="prophesee_event_msgs/Event"),
    }


def stamp(time_us: int) -> tuple[int, int]:
    """Return a time as seconds and ns."""
    return time_us // _US_PER_S, time_us % _US_PER_S * 1000


@dataclass(frozen=True)
class Sensor:
    """What each message tells of the sensor."""

    width: int
    height: int
    frame: str = "cam0"


def mono_words(events: EventBatch, base_us: int) -> npt.NDArray[np.uint64]:
    """Return events in encoding mono: bit 63 on, 48–62 y, 32–47 x, 0–31 ns since ``base_us``."""
    words = ((events["t"] - base_us) * 1000).astype("<u8")
    words |= events["x"].astype("<u8") << np.uint64(32)
    words |= events["y"].astype("<u8") << np.uint64(48)
    words |= events["on"].astype("<u8") << np.uint64(63)
    return words


def packet_bytes(ros: int, sensor: Sensor, seq: int, time_us: int, encoding: str, words: bytes | memoryview) -> bytes:
    """Return an EventPacket, serialised; ``time_us`` is that of its first event."""
    out = _Writer(ros)
    out.header(seq, time_us, sensor.frame)
    out.put("II", sensor.height, sensor.width)
    out.put("Q", seq)
    out.put("Q", time_us * 1000)
    out.text(encoding)
    out.put("B", 0)
    out.put("I", len(words))
    return bytes(out.data) + words


def array_bytes(ros: int, sensor: Sensor, seq: int, time_us: int, events: EventBatch) -> bytes:
    """Return an EventArray, serialised; ``time_us`` is that of its last event."""
    out = _Writer(ros)
    out.header(seq, time_us, sensor.frame)
    out.put("III", sensor.height, sensor.width, len(events))
    records = np.zeros(len(events), _ARRAY_DTYPES[ros])
    records["x"], records["y"], records["on"] = events["x"], events["y"], events["on"]
    records["s"], rest = np.divmod(events["t"], _US_PER_S)
    records["ns"] = rest * 1000
    raw = records.tobytes()
    return b"".join((out.data, raw) if ros == 1 or not raw else (out.data, raw[:4], memoryview(raw)[6:-1]))


class _Writer:
    """Serialises numbers: aligned to their size in CDR, packed in ROS 1."""

    def __init__(self, ros: int) -> None:
        self._ros = ros
        self._start = 4 if ros == 2 else 0
        self.data = bytearray(b"\x00\x01\x00\x00" if ros == 2 else b"")

    def put(self, kinds: str, *values: int) -> None:
        for kind, value in zip(kinds, values, strict=True):
            if self._ros == 2:
                self.data += bytes(-(len(self.data) - self._start) % struct.calcsize(kind))
            self.data += struct.pack(f"<{kind}", value)

    def text(self, value: str) -> None:
        raw = value.encode() + (b"\0" if self._ros == 2 else b"")
        self.put("I", len(raw))
        self.data += raw

    def header(self, seq: int, time_us: int, frame: str) -> None:
        if self._ros == 1:
            self.put("I", seq & 0xFFFFFFFF)
        self.put("iI" if self._ros == 2 else "II", *stamp(time_us))
        self.text(frame)


class _Reader:
    """Reads what `_Writer` writes; raises ValueError where a message is too short."""

    def __init__(self, ros: int, data: bytes | memoryview) -> None:
        self._ros = ros
        self._data = memoryview(data)
        self._at = self._start = 4 if ros == 2 else 0
        if ros == 2 and bytes(self._data[:2]) != b"\x00\x01":
            raise ValueError("a message is not in little-endian CDR")

    def take(self, kind: str) -> int:
        size = struct.calcsize(kind)
        if self._ros == 2:
            self._at += -(self._at - self._start) % size
        (value,) = struct.unpack(f"<{kind}", self.block(size))
        return int(value)

    def block(self, size: int) -> memoryview:
        piece = self._data[self._at : self._at + size]
        if len(piece) < size:
            raise ValueError("a message ends early")
        self._at += size
        return piece

    def text(self) -> str:
        raw = bytes(self.block(self.take("I")))
        return raw.rstrip(b"\0").decode("utf-8", "replace")

    def align(self, size: int) -> None:
        if self._ros == 2:
            self._at += -(self._at - self._start) % size

    def skip_header(self) -> None:
        for kind in "III" if self._ros == 1 else "iI":
            self.take(kind)
        self.text()


class MessageDecoder:
    """Turns the messages of one topic into events; EVT3's clock lives on from one to the next.

    Attributes:
        width, height: of the sensor, as the last message told; None before the first.
    """

    def __init__(self, ros: int, kind: str) -> None:
        """Prepare for messages of a type of `EVENT_TYPES`, of ROS ``ros`` (1 or 2)."""
        self.width: int | None = None
        self.height: int | None = None
        self._ros, self._kind = ros, kind
        self._evt3: Evt3Decoder | None = None
        self._column = self._base = self._top = self._outside = 0

    @property
    def dropped_events(self) -> int:
        """Number of events left out so far because they lie outside the sensor, or have no time."""
        return self._outside + (0 if self._evt3 is None else self._evt3.dropped_events)

    def decode(self, data: bytes | memoryview) -> EventBatch:
        """Return the events of a serialised message.

        Raises:
            ValueError: it is damaged, or has an encoding that is not known.
        """
        message = _Reader(self._ros, data)
        message.skip_header()
        self.height, self.width = message.take("I"), message.take("I")
        if not 0 < self.width <= 1 << 16 or not 0 < self.height <= 1 << 16:
            raise ValueError(f"a message has a sensor of {self.width}×{self.height} pixels")
        return self._packet(message) if self._kind in (PACKET, OLDER_PACKET) else self._array(message)

    def _packet(self, message: _Reader) -> EventBatch:
        message.take("Q")
        base_ns = message.take("Q")
        encoding = message.text()
        if message.take("B"):
            raise ValueError("a packet is big-endian")
        block = message.block(message.take("I"))
        if len(block) % _WORD_BYTES.get(encoding, 1):
            raise ValueError(f"a packet of {len(block)} bytes ends within a word of {encoding}")
        if encoding == "mono":
            return _of_mono(np.frombuffer(block, "<u8"), base_ns)
        if encoding == "evt3":
            if self._evt3 is None:
                self._evt3 = Evt3Decoder(self.width, self.height)
            return self._evt3.decode(np.frombuffer(block, "<u2"))
        if encoding == "libcaer":
            return _of_libcaer(np.frombuffer(block, "<u4").reshape(-1, 2), base_ns)
        if encoding == "libcaer_cmp":
            return self._of_compressed(np.frombuffer(block, "<u2"), base_ns)
        raise ValueError(f"packets have the encoding {encoding[:40]!r}, expected mono, evt3, libcaer or libcaer_cmp")

    def _of_compressed(self, words: npt.NDArray[np.uint16], base_ns: int) -> EventBatch:
        """Return the events of libcaer_cmp: words much like EVT3's, but column first, and vectors down a column."""
        kind, value = words >> 12, (words & 0xFFF).astype(np.int64)
        at = np.arange(len(words))

        def latest(wanted: int) -> npt.NDArray[np.int64]:
            """Return, for each word, what the last of a kind said: 0 before the first."""
            last = np.maximum.accumulate(np.where(kind == wanted, at, -1)) if len(at) else at
            return np.where(last >= 0, value[last], 0)

        t = latest(_CMP_TIME_HIGH) << 12 | latest(_CMP_TIME_LOW)
        first = np.where(kind == _CMP_COLUMN, at, -1)
        x = np.where(np.maximum.accumulate(first) >= 0, latest(_CMP_COLUMN), self._column) if len(at) else at
        self._column = int(x[-1]) if len(at) else self._column
        # Each vector goes on where the one before it ended, be that in the packet before; so do base and column.
        based = np.maximum.accumulate(np.where(kind == _CMP_BASE, at, -1)) >= 0 if len(at) else at
        base = np.where(based, latest(_CMP_BASE), self._base)
        is_vector = kind == _CMP_VECTOR
        walked = np.cumsum(is_vector) - is_vector
        at_base = np.maximum.accumulate(np.where(kind == _CMP_BASE, walked, 0)) if len(at) else walked
        top = np.where(based, base & 0x7FF, self._top) + 8 * (walked - at_base)
        if len(at):
            self._base, self._top = int(base[-1]), int(top[-1] + 8 * is_vector[-1])
        vectors = np.flatnonzero(is_vector)
        vector, step = np.nonzero(value[vectors, None] >> np.arange(8) & 1)
        vector = vectors[vector]
        single = np.flatnonzero(kind == _CMP_ROW)
        word = np.concatenate((single, vector))
        order = np.argsort(word, kind="stable")
        y = np.concatenate((value[single] & 0x7FF, top[vector] + step))[order]
        on = np.concatenate((value[single] >> 11, base[vector] >> 11))[order]
        word = word[order]
        columns = x[word] & 0x7FF
        fits = (columns < (self.width or 0)) & (y < (self.height or 0))
        self._outside += len(word) - int(np.count_nonzero(fits))
        events = empty_batch(int(np.count_nonzero(fits)))
        events["t"] = (t[word] + base_ns // 1000)[fits]
        events["x"], events["y"], events["on"] = columns[fits], y[fits], on[fits]
        return events

    def _array(self, message: _Reader) -> EventBatch:
        count = message.take("I")
        kind = _ARRAY_DTYPES[self._ros]
        size = count * kind.itemsize
        message.align(4)
        if self._ros == 1 or not count:
            records = np.frombuffer(message.block(size), kind)
        else:
            block = bytes(message.block(size - 3))
            records = np.frombuffer(block[:4] + b"\0\0" + block[4:] + b"\0", kind)
        events = empty_batch(count)
        events["x"], events["y"], events["on"] = records["x"], records["y"], records["on"] != 0
        events["t"] = records["s"].astype(np.int64) * _US_PER_S + records["ns"] // 1000
        return events


def _of_libcaer(records: npt.NDArray[np.uint32], base_ns: int) -> EventBatch:
    """Return the events of libcaer's records: address and 31 bits of time, which may begin anew within a packet."""
    ticks = records[:, 1].astype(np.int64)
    laps = np.cumsum(np.diff(ticks, prepend=ticks[:1]) <= -(1 << 30))
    events = empty_batch(len(records))
    events["t"] = base_ns // 1000 + ticks + (laps << 31)
    address = records[:, 0]
    events["on"], events["y"], events["x"] = address >> 1 & 1, address >> 2 & 0x7FFF, address >> 17
    return events


def _of_mono(words: npt.NDArray[np.uint64], base_ns: int) -> EventBatch:
    events = empty_batch(len(words))
    whole_us, rest_ns = divmod(base_ns, 1000)
    events["t"] = whole_us + ((words & np.uint64(0xFFFFFFFF)).astype(np.int64) + rest_ns) // 1000
    events["x"] = (words >> np.uint64(32)) & np.uint64(0xFFFF)
    events["y"] = (words >> np.uint64(48)) & np.uint64(0x7FFF)
    events["on"] = words >> np.uint64(63)
    return events
