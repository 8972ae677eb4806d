"""Our client of DV's protocol: against DV's own server, our server, and servers that mean it no good."""

from __future__ import annotations

import contextlib
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from clsim.errors import InputError
from clsim.events import EventBatch, empty_batch
from clsim.events.formats.dv_stream import Compression, DvEncoder, StreamHeader, parse_header, parse_packet
from clsim.events.sockets.sources import open_socket_source
from clsim.events.sockets.stream_source import SocketSource
from clsim.events.sockets.tcp import StreamServer, TcpSink
from clsim.events.sockets.unix import UnixSink
from tests.events.event_data import end_of
from tests.events.sockets.socket_help import HEIGHT, WIDTH, make_events

HEADER = DvEncoder(WIDTH, HEIGHT).header
EVENTS = make_events(20)


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let ``close`` take its time on a busy machine."""
    monkeypatch.setattr("clsim.events.sockets.tcp.CLOSE_TIMEOUT_S", 30.0)


def packet(batch: EventBatch, compression: Compression = Compression.LZ4) -> bytes:
    return b"".join(data for data, _ in DvEncoder(WIDTH, HEIGHT, compression).packets(batch))


@contextlib.contextmanager
def serving(*parts: bytes | float, linger: threading.Event | None = None) -> Iterator[str]:
    """A server that sends these bytes to its one client, resting where a number of seconds stands, then hangs up.

    With ``linger`` it waits for that first.
    """
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            connection, _ = listener.accept()
            with connection, contextlib.suppress(OSError):
                for part in parts:
                    if isinstance(part, float):
                        time.sleep(part)
                    else:
                        connection.sendall(part)
                if linger is not None:
                    linger.wait(30)

        thread = threading.Thread(target=serve)
        thread.start()
        yield f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        thread.join(30)
        assert not thread.is_alive()


@pytest.mark.parametrize("kind", ["lz4", "none", "unix"])
def test_round_trip_with_our_server(tmp_path: Path, kind: str) -> None:
    sink: StreamServer
    if kind == "unix":
        url = f"unix://{tmp_path / 'events.sock'}"
        sink = UnixSink(url, WIDTH, HEIGHT)
    else:
        sink = TcpSink(f"tcp://127.0.0.1:0?compression={kind}", WIDTH, HEIGHT)
        url = f"tcp://127.0.0.1:{sink.port}"
    batches = [make_events(count, start_us=i * 10_000_000) for i, count in enumerate([5, 0, 150_000, 70])]
    with open_socket_source(url) as source:
        assert (source.width, source.height) == (WIDTH, HEIGHT)
        assert sink.wait_for_clients(timeout_s=10)
        for batch in batches:
            sink.write(batch, end_of(batch))
        closer = threading.Thread(target=sink.close)
        closer.start()
        got = np.concatenate(list(source))
        closer.join()
    np.testing.assert_array_equal(got, np.concatenate(batches))
    assert list(source) == []


DV_SERVER = f"""
import sys, time
sys.path.insert(0, {str(Path(__file__).parents[3])!r})
import dv_processing as dv
from tests.events.sockets.socket_help import WIDTH, HEIGHT, make_events

stream = dv.io.Stream.EventStream(0, "events", "camera", (WIDTH, HEIGHT))
stream.setCompression(getattr(dv.CompressionType, sys.argv[2]))
writer = dv.io.NetworkWriter("127.0.0.1", int(sys.argv[1]), stream)
store = dv.EventStore()
for t, x, y, on in make_events(20).tolist():
    store.push_back(t, x, y, on)
while writer.getClientCount() == 0:
    time.sleep(0.005)
writer.writeEvents(store)
time.sleep(60)
"""


@pytest.mark.parametrize("compression", ["NONE", "LZ4", "LZ4_HIGH"])
def test_reads_dv_processings_server(compression: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    # In a process of its own: its destructor waits for a thread that waits for Python's lock.
    with subprocess.Popen([sys.executable, "-c", DV_SERVER, str(port), compression]) as server:
        try:
            source = connect_when_up(f"tcp://127.0.0.1:{port}")
            with source:
                assert (source.width, source.height) == (WIDTH, HEIGHT)
                parts: list[EventBatch] = []
                while sum(map(len, parts)) < len(EVENTS):
                    parts.append(next(source))
        finally:
            server.kill()
    np.testing.assert_array_equal(np.concatenate(parts), EVENTS)


def connect_when_up(url: str) -> SocketSource:
    end_s = time.monotonic() + 60
    while True:
        try:
            return open_socket_source(url)
        except InputError as error:
            assert "cannot be reached" in str(error) and time.monotonic() < end_s
            time.sleep(0.01)


def test_other_streams_and_empty_packets_are_passed_over() -> None:
    with serving(HEADER, struct.pack("<ii", 7, 5), b"frame", damaged_packet(put(28, "<I", 0)), packet(EVENTS)) as url:
        (got,) = open_socket_source(url)
    np.testing.assert_array_equal(got, EVENTS)


def test_unsorted_events_are_sorted() -> None:
    with serving(HEADER, packet(EVENTS[::-1])) as url:
        got = np.concatenate(list(open_socket_source(url)))
    assert (np.diff(got["t"]) >= 0).all()
    np.testing.assert_array_equal(np.sort(got), np.sort(EVENTS))


def damaged_packet(change: Callable[[bytearray], None]) -> bytes:
    payload = bytearray(packet(EVENTS, Compression.NONE)[8:])
    change(payload)
    payload = lz4.frame.compress(bytes(payload))
    return struct.pack("<ii", 0, len(payload)) + payload


def put(offset: int, layout: str, number: int) -> Callable[[bytearray], None]:
    return lambda payload: struct.pack_into(layout, payload, offset, number)


def header_with(old: bytes, new: bytes) -> bytes:
    """The header with one piece of its description changed, lengths kept right by blanks at its end."""
    assert HEADER.count(old) == 1
    changed = HEADER.replace(old, new)
    text_end = len(HEADER) - len(HEADER[56:]) + struct.unpack_from("<I", HEADER, 52)[0] + len(new) - len(old)
    changed = bytearray(changed[:text_end] + bytes(4))
    struct.pack_into("<I", changed, 0, len(changed) - 4)
    struct.pack_into("<I", changed, 52, text_end - 56)
    return bytes(changed)


BOMB = b"\0" * (65 << 20)

HOSTILE = {
    "no header": ((), "ended 4 bytes before"),
    "half a header": ((HEADER[:100],), "before a header's or packet's end"),
    "another protocol": ((b"SSH-2.0-OpenSSH_9.6\r\n",), "expected the header of DV's protocol"),
    "a huge header": ((struct.pack("<I", 2**31),), "expected the header of DV's protocol"),
    "another FlatBuffer": ((HEADER.replace(b"IOHE", b"IOHF"),), "b'IOHE' was expected"),
    "unknown compression": ((HEADER[:32] + b"\x09" + HEADER[33:],), "compression 9"),
    "Zstandard": ((HEADER[:32] + b"\x03" + HEADER[33:],), "Zstandard"),
    "no XML": ((header_with(b'<dv version="2.0">', b"<dv"),), "cannot be read"),
    "entities": ((header_with(b'<dv version="2.0">', b'<!DOCTYPE a [<!ENTITY b "c">]><dv>'),), "'<!' declaration"),
    "no events": ((header_with(b"EVTS", b"FRME"),), "names no event stream"),
    "no width": ((header_with(b'"sizeX" type="int">64', b'"sizeX" type="int">-64'),), "sizeX = '-64'"),
    "zero height": ((header_with(b'"sizeY" type="int">48', b'"sizeY" type="int">0'),), "64x0"),
    "half a packet": ((HEADER, packet(EVENTS)[:-1]), "ended 1 bytes before"),
    "half a packet's head": ((HEADER, b"\0\0\0"), "ended 5 bytes before"),
    "negative size": ((HEADER, struct.pack("<ii", 0, -1)), "a packet claims -1 bytes"),
    "huge size": ((HEADER, struct.pack("<ii", 0, 2**31 - 1)), "a packet claims 2147483647 bytes"),
    "no LZ4": ((HEADER, packet(EVENTS, Compression.NONE)), "LZ4 frame is damaged"),
    "an LZ4 bomb": (
        (HEADER, (lambda b: struct.pack("<ii", 0, len(b)) + b)(lz4.frame.compress(BOMB))),
        "longer than 64",
    ),
    "wild root": ((HEADER, damaged_packet(put(4, "<I", 2**32 - 1))), "points to byte"),
    "wild vtable": ((HEADER, damaged_packet(put(20, "<i", -(2**31)))), "points to byte"),
    "vtable before the start": ((HEADER, damaged_packet(put(20, "<i", 2**31 - 1))), "points to byte"),
    "short vtable": ((HEADER, damaged_packet(put(14, "<H", 2))), "too short"),
    "wild vector": ((HEADER, damaged_packet(put(24, "<I", 2**31))), "points to byte"),
    "too many events": ((HEADER, damaged_packet(put(28, "<I", 21))), "claims to hold 21 items"),
    "far too many events": ((HEADER, damaged_packet(put(28, "<I", 2**32 - 1))), "claims to hold 4294967295"),
    "an event outside": ((HEADER, damaged_packet(put(40, "<h", WIDTH))), f"x, y = {WIDTH}"),
    "a negative coordinate": ((HEADER, damaged_packet(put(42, "<h", -1))), ", -1;"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_servers_are_one_sentence(name: str) -> None:
    parts, complaint = HOSTILE[name]
    with serving(*parts) as url, pytest.raises(InputError) as raised, open_socket_source(url) as source:
        list(source)
    assert str(raised.value).startswith(f"{url}: ")
    assert complaint in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(("parts", "what"), [((), "header"), ((HEADER, packet(EVENTS)[:50]), "packet")])
def test_stalling_servers_are_left(parts: tuple[bytes, ...], what: str) -> None:
    left = threading.Event()
    with serving(*parts, linger=left) as url:
        with (
            pytest.raises(InputError, match="nothing came"),
            open_socket_source(url, timeout_s=0.1) as source,
        ):
            next(source)
        left.set()


def test_any_true_byte_is_on() -> None:
    with serving(HEADER, damaged_packet(put(44, "<B", 255))) as url:
        (got,) = open_socket_source(url)
    assert got["on"].view(np.uint8)[0] == 1


def test_silence_between_packets_is_no_fault() -> None:
    with serving(HEADER, 0.5, packet(EVENTS), 0.5, packet(EVENTS)) as url:
        assert [len(batch) for batch in open_socket_source(url, timeout_s=0.3)] == [len(EVENTS)] * 2


def test_silence_ends_the_iteration_when_asked() -> None:
    left = threading.Event()
    with serving(HEADER, packet(EVENTS), linger=left) as url:
        with open_socket_source(url, idle_timeout_s=1.0) as source:
            np.testing.assert_array_equal(np.concatenate(list(source)), EVENTS)
        left.set()


@pytest.mark.parametrize("rest", [b"", packet(EVENTS)[:50]], ids=["between", "within"])
def test_close_by_another_thread_ends_the_iteration(rest: bytes) -> None:
    left = threading.Event()
    with serving(HEADER, packet(EVENTS), rest, linger=left) as url:
        source = open_socket_source(url)
        next(source)
        threading.Timer(0.05, source.close).start()
        assert list(source) == []
        left.set()


STREAM = StreamHeader(Compression.NONE, WIDTH, HEIGHT)
PAYLOAD = packet(EVENTS, Compression.NONE)[8:]


def changed(original: bytes) -> st.SearchStrategy[bytes]:
    """The bytes with some overwritten, then cut off."""
    spot = st.tuples(st.integers(0, min(len(original), 80) - 1), st.binary(min_size=1, max_size=8))

    def apply(spots: list[tuple[int, bytes]], length: int) -> bytes:
        data = bytearray(original)
        for offset, new in spots:
            data[offset : offset + len(new)] = new
        return bytes(data[:length])

    return st.builds(apply, st.lists(spot, max_size=4), st.integers(0, len(original)) | st.just(len(original)))


@settings(deadline=None)
@given(changed(HEADER) | st.binary(max_size=100))
@example(HEADER)
def test_any_header_is_read_or_refused(data: bytes) -> None:
    with contextlib.suppress(InputError):
        header = parse_header(data)
        assert 0 < header.width <= 32768 and 0 < header.height <= 32768


@settings(deadline=None)
@given(changed(PAYLOAD) | st.binary(max_size=100).map(lambda data: data[:8] + b"EVTS" + data[12:]))
@example(PAYLOAD)
def test_any_packet_is_read_or_refused(data: bytes) -> None:
    with contextlib.suppress(InputError):
        batch = parse_packet(data, STREAM)
        assert len(batch) * 16 <= len(data)
        assert (batch["x"] < WIDTH).all() and (batch["y"] < HEIGHT).all()
        assert (batch["on"].view(np.uint8) <= 1).all()


@pytest.mark.parametrize("missing", [1, 4, 5, 16])
def test_a_packet_that_lacks_bytes_at_its_end_is_refused(missing: int) -> None:
    assert len(parse_packet(PAYLOAD, STREAM)) == 20 and len(PAYLOAD) == 32 + 20 * 16
    with pytest.raises(InputError, match="claims to hold 20 items"):
        parse_packet(PAYLOAD[:-missing], STREAM)


@settings(deadline=None)
@given(changed(lz4.frame.compress(PAYLOAD)))
@example(lz4.frame.compress(PAYLOAD))
def test_any_compressed_packet_is_read_or_refused(data: bytes) -> None:
    with contextlib.suppress(InputError):
        parse_packet(data, StreamHeader(Compression.LZ4, WIDTH, HEIGHT))


@settings(deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(0, 2**62), st.integers(0, WIDTH - 1), st.integers(0, HEIGHT - 1), st.booleans()),
        max_size=50,
    ),
    st.sampled_from([Compression.NONE, Compression.LZ4]),
)
def test_packets_round_trip(events: list[tuple[int, int, int, bool]], compression: Compression) -> None:
    batch = empty_batch(len(events))
    batch[:] = sorted(events, key=lambda event: event[0])
    encoder = DvEncoder(WIDTH, HEIGHT, compression)
    header = parse_header(encoder.header)
    got = [parse_packet(data[8:], header) for data, _ in encoder.packets(batch)]
    np.testing.assert_array_equal(np.concatenate([empty_batch(), *got]), batch)
