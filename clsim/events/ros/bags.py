"""Bags of ROS, written and read with rosbags, which needs no ROS: MCAP and SQLite of ROS 2, and ROS 1's own."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import sqlite3
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from clsim.errors import InputError
from clsim.events.batch import EventBatch
from clsim.events.formats.filesink import FileSink, FlushPolicy, Limits, PartFile
from clsim.events.formats.filesource import EventSource, damaged, open_binary
from clsim.events.formats.prophesee.evt3_words import Evt3Encoder
from clsim.events.outputs import Encoding
from clsim.events.ros import messages

Storage = Literal["mcap", "sqlite", "ros1"]
EVENT_TOPIC = "/cam0/events"
"""ESIM's name for it."""
_NAME = "events"
_LARGEST = {"mono": 2**15, "evt3": 2**11, "array": 2**16}
LIMITS = Limits("ROS bags", size=2**16, end_us=2**31 * 1_000_000)


def typestore(ros: int) -> Any:
    """Return rosbags' types of ROS ``ros`` (1 or 2), those of event cameras among them."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE if ros == 2 else Stores.ROS1_NOETIC)
    types: dict[str, Any] = {}
    for name, text in messages.definitions(ros).items():
        types |= get_types_from_msg(text, name)
    store.register(types)
    return store


class Bag:
    """A bag that gets its name when it is complete; what stood there stays until then.

    Attributes:
        ros: version of ROS whose serialisation its messages have.
        types: rosbags' types.
    """

    def __init__(self, path: Path, storage: Storage) -> None:
        """Begin a bag under a hidden name; raises InputError when it cannot be written."""
        if storage == "sqlite" and set("?#%") & set(os.path.realpath(path)):
            # rosbags makes a URI of the path and quotes nothing.
            raise InputError(f"{path}: SQLite cannot write there; expected a path without ?, # and %")
        self.ros = 1 if storage == "ros1" else 2
        self.types = typestore(self.ros)
        self._storage = storage
        self._part = PartFile(path)
        # rosbags makes a folder of a bag of ROS 2, and wants a name that is free.
        self._folder = self._part.part.with_suffix(".events")
        self._connections: dict[str, Any] = {}
        shutil.rmtree(self._folder, ignore_errors=True)
        try:
            self._writer = self._open()
        except BaseException:
            self.discard()
            raise

    def _open(self) -> Any:
        if self._storage == "ros1":
            from rosbags.rosbag1 import Writer

            self._part.part.unlink()
            writer: Any = Writer(self._part.part)
            writer.set_compression(Writer.CompressionFormat.LZ4)
        else:
            from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
            from rosbags.rosbag2 import Writer as Writer2

            plugin = StoragePlugin.MCAP if self._storage == "mcap" else StoragePlugin.SQLITE3
            # The bag tells its own name: one of a process would make each run's bytes others.
            self._folder.mkdir()
            writer = Writer2(self._folder / _NAME, version=9, storage_plugin=plugin)
            if self._storage == "mcap":
                writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        writer.open()
        if self._storage == "mcap":
            # rosbags has no option for the level. Its own, 3, takes two to six times as long for a sixth fewer bytes.
            writer.storage.compressor = partial(writer.storage.compressor, level=1)
        elif self._storage == "sqlite":
            # A run opens its outputs in one thread and writes in another, which rosbags' own connection refuses.
            writer.storage.conn.close()
            writer.storage.conn = sqlite3.connect(writer.storage.path, check_same_thread=False)
            writer.storage.cursor = writer.storage.conn.cursor()
        return writer

    def topic(self, topic: str, kind: str) -> None:
        """Declare a topic of messages of the type ``kind``, such as ``sensor_msgs/msg/Image``."""
        self._connections[topic] = self._writer.add_connection(topic, kind, typestore=self.types)

    def write(self, topic: str, time_us: int, data: bytes | memoryview) -> None:
        """Append a serialised message."""
        with _as_os_errors():
            self._writer.write(self._connections[topic], time_us * 1000, data)

    def complete(self) -> None:
        """Finish the bag and give it its name."""
        try:
            with _as_os_errors():
                self._writer.close()
            if self._storage != "ros1":
                ending = "mcap" if self._storage == "mcap" else "db3"
                os.replace(self._folder / _NAME / f"{_NAME}.{ending}", self._part.part)
            self._part.complete()
        finally:
            self.discard()

    def discard(self) -> None:
        """Remove what is left of it; safe to call twice."""
        self._part.discard()
        shutil.rmtree(self._folder, ignore_errors=True)

    def abandon(self) -> None:
        """Close without completing, and leave nothing."""
        with contextlib.suppress(Exception):  # what is half-written may fail in any way, and goes
            self._writer.close()
        self.discard()


class BagSink(FileSink):
    """Writes events into a bag, a message at each flush.

    Attributes:
        bag: for whoever has more to say than events; completed at the end.
    """

    def __init__(
        self, path: Path, width: int, height: int, flush: FlushPolicy, storage: Storage, encoding: Encoding
    ) -> None:
        """Begin the bag; raises InputError when it cannot be, or a sensor does not fit."""
        limits = Limits(f"a bag of {encoding} messages", _LARGEST[encoding], end_us=LIMITS.end_us)
        super().__init__(path, width, height, limits, flush)
        self._encoding = encoding
        self._sensor = messages.Sensor(width, height)
        self._evt3 = Evt3Encoder()
        self._seq = 0
        self.bag = Bag(path, storage)
        try:
            self.bag.topic(EVENT_TOPIC, messages.ARRAY if encoding == "array" else messages.PACKET)
        except BaseException:
            self.bag.abandon()
            raise

    def _store(self, events: EventBatch) -> None:
        t = events["t"]
        cuts = [0]
        while int(t[-1]) - int(t[cuts[-1]]) >= messages.MONO_SPAN_US:
            cuts.append(int(np.searchsorted(t, int(t[cuts[-1]]) + messages.MONO_SPAN_US)))
        for first, last in zip(cuts, [*cuts[1:], len(events)], strict=True):
            self._message(events[first:last], int(t[last - 1]))

    def _message(self, events: EventBatch, end_us: int) -> None:
        start_us = int(events["t"][0]) if len(events) else end_us
        ros, sensor, seq = self.bag.ros, self._sensor, self._seq
        if self._encoding == "array":
            data = messages.array_bytes(ros, sensor, seq, end_us, events)
        elif self._encoding == "mono":
            words = messages.mono_words(events, start_us)
            data = messages.packet_bytes(ros, sensor, seq, start_us, "mono", words.tobytes())
        else:
            data = messages.packet_bytes(
                ros, sensor, seq, start_us, "evt3", self._evt3.encode(events, afresh=True).tobytes()
            )
        self._seq += 1
        self.bag.write(EVENT_TOPIC, end_us, data)

    def _finish(self) -> None:
        if self._failed:
            self.bag.abandon()
            return
        if self._end_us > self._last_us or self._seq == 0:  # the recording lasted longer than its events
            self._message(np.empty(0, self._pending.dtype), self._end_us)
        self.bag.complete()


def open_bag_source(path: Path, topic: str | None = None) -> EventSource:
    """Open a bag for the events of a ``topic``; without one, of the topic of ESIM's name, or of the only one.

    Raises:
        InputError: it holds no events, or several topics of them.
    """
    open_binary(path).close()
    reader, ros = _reader(path)
    try:
        connections = _chosen(path, topic, reader.connections)
        decoder = messages.MessageDecoder(ros, connections[0].msgtype)
        raw = _messages(reader, connections)
        first = next((decoder.decode(data) for data in raw), None)
    except BaseException:
        reader.close()
        raise
    size = decoder.width, decoder.height
    return EventSource(path, *size, _read(reader, decoder, first, raw), lambda: decoder.dropped_events)


def _messages(reader: Any, connections: list[Any]) -> Iterator[bytes]:
    try:
        for _, _, data in reader.messages(connections):
            yield data
    except MemoryError:
        raise ValueError("a record is larger than memory") from None


@contextlib.contextmanager
def _as_os_errors() -> Iterator[None]:
    """Turn what SQLite raises when a medium fails, which is no OSError, into one."""
    try:
        yield
    except OSError:
        raise
    except Exception as error:
        raise OSError(errno.EIO, str(error) or type(error).__name__) from error


def _reader(path: Path) -> tuple[Any, int]:
    with open(path, "rb") as file:
        magic = file.read(13)
    if magic.startswith(b"#ROSBAG"):
        from rosbags.rosbag1 import Reader

        reader: Any = Reader(path)
    else:
        from rosbags.rosbag2.storage_mcap import McapReader
        from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

        reader = (Sqlite3Reader if magic.startswith(b"SQLite") else McapReader)(path)
    if magic.startswith(b"SQLite"):
        _check_whole(path)
    try:
        reader.open()
    except MemoryError:
        raise damaged(path, "a record is larger than memory") from None
    return reader, 1 if magic.startswith(b"#ROSBAG") else 2


def _check_whole(path: Path) -> None:
    """Raise InputError where an SQLite file is shorter than its header tells: it would read as one with gaps."""
    with open(path, "rb") as file:
        head = file.read(32)
    page, pages = int.from_bytes(head[16:18], "big"), int.from_bytes(head[28:32], "big")
    if len(head) < 32 or path.stat().st_size < (65536 if page == 1 else page) * pages:
        raise damaged(path, "it is truncated")


def _chosen(path: Path, topic: str | None, connections: Any) -> list[Any]:
    """Return the connections of a topic: bags of ROS 1 have one for each node that published there."""
    found = [connection for connection in connections if connection.msgtype in messages.EVENT_TYPES]
    if not found:
        held = ", ".join(sorted({connection.msgtype for connection in connections})[:8]) or "nothing"
        raise damaged(path, f"it holds no messages of events, but {held}")
    topics = sorted({connection.topic for connection in found})
    told = ", ".join(topics[:8])
    if topic is None and len(topics) > 1 and EVENT_TOPIC not in topics:
        raise InputError(f"{path}: holds events of several topics: {told}; name one of them: '{path}#{topics[0]}'")
    wanted = topic or (EVENT_TOPIC if EVENT_TOPIC in topics else topics[0])
    named = [connection for connection in found if connection.topic == wanted]
    if not named:
        raise InputError(f"{path}: has no events of the topic {topic}; expected one of {told}")
    if len({connection.msgtype for connection in named}) > 1:
        raise damaged(path, f"its topic {wanted} has messages of several types")
    return named


def _read(
    reader: Any, decoder: messages.MessageDecoder, first: EventBatch | None, raw: Iterator[bytes]
) -> Iterator[EventBatch]:
    try:
        if first is not None:
            yield first
            for data in raw:
                yield decoder.decode(data)
    finally:
        reader.close()
