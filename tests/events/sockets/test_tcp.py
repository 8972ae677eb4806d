"""The TCP server against DV's own client, and against clients that misbehave."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
from pathlib import Path

import aedat
import dv_processing as dv
import numpy as np
import pytest

from clsim.errors import InputError
from clsim.events import EVENT_DTYPE, empty_batch
from clsim.events.formats.dv_stream import AEDAT4_MAGIC, DvEncoder
from clsim.events.socket_sinks import open_socket_sink
from clsim.events.sockets.tcp import TcpSink
from tests.events.event_data import end_of
from tests.events.sockets.dv_reader import assert_same, read_with_dv
from tests.events.sockets.socket_help import HEIGHT, WIDTH, make_events, receive_until_end, wait_until


@pytest.mark.parametrize("compression", ["lz4", "none"])
def test_network_reader_gets_every_event(tmp_path: Path, compression: str) -> None:
    batches = [make_events(count, start_us=i * 1_000_000) for i, count in enumerate([1, 7, 0, 150_000, 3000])]
    sink = TcpSink(f"tcp://127.0.0.1:0?compression={compression}", WIDTH, HEIGHT)
    try:
        got = read_with_dv(sink, sink.port, batches, tmp_path)
    finally:
        sink.close()
    assert tuple(got["resolution"]) == (WIDTH, HEIGHT)
    assert_same(got["events"], np.concatenate(batches))
    assert (sink.dropped_packets, sink.dropped_events) == (0, 0)


@pytest.mark.parametrize("compression", ["lz4", "none"])
def test_capture_is_an_aedat4_file(tmp_path: Path, compression: str) -> None:
    events = make_events(70_000, start_us=5_000_000_000)
    sink = TcpSink(f"tcp://127.0.0.1:0?compression={compression}", WIDTH, HEIGHT)
    with socket.create_connection(("127.0.0.1", sink.port), timeout=10) as client:
        assert sink.wait_for_clients(timeout_s=10)
        sink.write(events, end_of(events))
        sink.close()
        capture = receive_until_end(client)
    path = tmp_path / "capture.aedat4"
    path.write_bytes(AEDAT4_MAGIC + capture)

    recording = dv.io.MonoCameraRecording(str(path))
    assert recording.getEventResolution() == (WIDTH, HEIGHT)
    parts = []
    while (store := recording.getNextEventBatch()) is not None:
        parts.append(store.numpy())
    assert_same(np.concatenate(parts), events)

    decoder = aedat.Decoder(path)
    assert decoder.id_to_stream()[0] == {"type": "events", "width": WIDTH, "height": HEIGHT}
    packets = np.concatenate([packet["events"] for packet in decoder])
    for name in EVENT_DTYPE.names or ():
        np.testing.assert_array_equal(packets[name], events[name])


def test_late_client_starts_with_the_header() -> None:
    header = DvEncoder(WIDTH, HEIGHT).header
    sink = TcpSink("tcp://127.0.0.1:0", WIDTH, HEIGHT)
    sink.write(make_events(1000), end_of(make_events(1000)))  # nobody listens: gone
    with socket.create_connection(("127.0.0.1", sink.port), timeout=10) as client:
        assert sink.wait_for_clients(timeout_s=10)
        sink.write(make_events(1000, start_us=77_000_000), end_of(make_events(1000, start_us=77_000_000)))
        sink.close()
        capture = receive_until_end(client)
    assert capture.startswith(header)
    stream_id, size = struct.unpack_from("<ii", capture, len(header))
    assert stream_id == 0
    assert len(capture) == len(header) + 8 + size


def test_port_in_use() -> None:
    sink = TcpSink("tcp://127.0.0.1:0", WIDTH, HEIGHT)
    with pytest.raises(InputError, match=rf"tcp://127\.0\.0\.1:{sink.port}: .* in use"):
        TcpSink(f"tcp://127.0.0.1:{sink.port}", WIDTH, HEIGHT)
    sink.close()
    again = TcpSink(f"tcp://127.0.0.1:{sink.port}", WIDTH, HEIGHT)
    again.close()


def test_only_loopback_is_silent() -> None:
    for url, warned in (("tcp://:0", False), ("tcp://localhost:0", False), ("tcp://0.0.0.0:0", True)):
        sink = open_socket_sink(url, WIDTH, HEIGHT)
        assert isinstance(sink, TcpSink)
        socket.create_connection(("127.0.0.1", sink.port), timeout=10).close()
        sink.close()
        assert (sink.warning is not None) == warned


def test_coordinates_must_fit() -> None:
    with pytest.raises(InputError, match="int16"):
        TcpSink("tcp://127.0.0.1:0", 32_769, 10)
    outside = empty_batch(1)
    outside[0] = (0, WIDTH, 0, True)
    sink = TcpSink("tcp://127.0.0.1:0", WIDTH, HEIGHT)
    with socket.create_connection(("127.0.0.1", sink.port), timeout=10):
        assert sink.wait_for_clients(timeout_s=10)
        with pytest.raises(InputError, match=f"x = {WIDTH}"):
            sink.write(outside, end_of(outside))
    sink.close()


def receive_exactly(connection: socket.socket, count: int) -> bytes:
    parts = bytearray()
    while len(parts) < count:
        part = connection.recv(count - len(parts))
        assert part, "the server hung up"
        parts += part
    return bytes(parts)


def receive_header(connection: socket.socket) -> bytes:
    prefix = receive_exactly(connection, 4)
    return prefix + receive_exactly(connection, struct.unpack("<I", prefix)[0])


def receive_packet(connection: socket.socket) -> int:
    """Receive an uncompressed packet; return its first event's time."""
    stream_id, size = struct.unpack("<ii", receive_exactly(connection, 8))
    payload = receive_exactly(connection, size)
    assert stream_id == 0
    assert struct.unpack_from("<I", payload)[0] == size - 4
    return struct.unpack_from("<q", payload, 32)[0]


def connect_stuck(port: int) -> socket.socket:
    """A client that never reads and has little room in the system's buffers."""
    client = socket.socket()
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    client.settimeout(10)
    client.connect(("127.0.0.1", port))
    return client


def test_a_large_packet_drops_as_many_small_ones_as_it_needs_room() -> None:
    sink = TcpSink("tcp://127.0.0.1:0?compression=none&queue_mb=1", WIDTH, HEIGHT)
    with connect_stuck(sink.port):
        assert sink.wait_for_clients(1, timeout_s=10)
        small, large = make_events(1000), make_events(60_000)  # 16 kB and 0.96 MB
        while sink.dropped_packets < 2:
            sink.write(small, end_of(small))
            assert sink.queued_bytes <= 1 << 20
        dropped = sink.dropped_packets
        sink.write(large, end_of(large))
        assert 900_000 < sink.queued_bytes <= 1 << 20
        assert sink.dropped_packets > dropped + 50 and sink.dropped_events == 1000 * sink.dropped_packets
        sink.flush_briefly()
        sink.close()


def test_stuck_client_loses_the_oldest_and_nobody_else_notices() -> None:
    """Its queue stays bounded and drops are counted; another gets everything; awake again, it gets whole packets."""
    sink = TcpSink("tcp://127.0.0.1:0?compression=none&queue_mb=1", WIDTH, HEIGHT)
    with connect_stuck(sink.port) as stuck:
        assert sink.wait_for_clients(1, timeout_s=10)
        batch = make_events(10_000)
        sent = 0
        while sink.dropped_packets < 20:  # first the system's own buffers fill, then the queue
            batch["t"] = sent
            sink.write(batch, end_of(batch))
            sent += 1
            assert sent < 1000
            assert sink.queued_bytes <= 1 << 20
        assert sink.dropped_events == sink.dropped_packets * len(batch)

        with socket.create_connection(("127.0.0.1", sink.port), timeout=10) as reader:
            assert sink.wait_for_clients(2, timeout_s=10)
            receive_header(reader)
            for _ in range(50):
                batch["t"] = sent
                sink.write(batch, end_of(batch))
                assert receive_packet(reader) == sent
                sent += 1
        dropped = sink.dropped_packets
        assert dropped >= 70

        receive_header(stuck)
        seen = [receive_packet(stuck)]
        while seen[-1] < sent - 1:
            seen.append(receive_packet(stuck))
        assert len(seen) == sent - dropped
        assert seen == sorted(seen)
        first_lost = next(i for i, number in enumerate(seen) if number != i)
        assert seen[first_lost:] == list(range(first_lost + dropped, sent))  # one gap: the oldest of the queue
    sink.close()


def test_vanishing_clients_are_forgotten() -> None:
    sink = TcpSink("tcp://127.0.0.1:0", WIDTH, HEIGHT)
    polite = socket.create_connection(("127.0.0.1", sink.port), timeout=10)
    rude = socket.create_connection(("127.0.0.1", sink.port), timeout=10)
    stuck = connect_stuck(sink.port)
    assert sink.wait_for_clients(3, timeout_s=10)
    polite.close()
    wait_until(lambda: sink.clients == 2)
    rude.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # a reset instead of a farewell
    rude.close()
    wait_until(lambda: sink.clients == 1)
    while sink.queued_bytes == 0:
        sink.write(make_events(10_000), end_of(make_events(10_000)))
    stuck.close()
    wait_until(lambda: sink.clients == 0)
    assert sink.queued_bytes == 0
    sink.write(make_events(10), end_of(make_events(10)))
    sink.close()


def test_talking_clients_are_heard_out_then_dropped() -> None:
    """A client of another protocol is served; one that floods is disconnected; neither disturbs a third."""
    sink = TcpSink("tcp://127.0.0.1:0", WIDTH, HEIGHT)
    browser, flooder, reader = (socket.create_connection(("127.0.0.1", sink.port), timeout=10) for _ in range(3))
    with browser, flooder, reader:
        assert sink.wait_for_clients(3, timeout_s=10)
        browser.sendall(b"GET / HTTP/1.1\r\n\r\n")
        with pytest.raises(OSError):
            for _ in range(200):
                flooder.sendall(bytes(range(256)) * 256)
        wait_until(lambda: sink.clients == 2)
        sink.write(make_events(100), end_of(make_events(100)))
        for client in (browser, reader):
            receive_header(client)
            _, size = struct.unpack("<ii", receive_exactly(client, 8))
            receive_exactly(client, size)
        sink.close()
        assert reader.recv(1) == b""


def test_close_delivers_what_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    """More than the system's buffers hold is on its way when the server closes; a client that reads gets it all."""
    monkeypatch.setattr("clsim.events.sockets.tcp.PATIENCE_S", 30.0)  # for busy machines
    sink = TcpSink("tcp://127.0.0.1:0?compression=none", WIDTH, HEIGHT)
    batch = make_events(60_000)
    with connect_stuck(sink.port) as client:
        assert sink.wait_for_clients(1, timeout_s=10)
        written = 0
        while sink.queued_bytes == 0:
            sink.write(batch, end_of(batch))
            written += 1
        closer = threading.Thread(target=sink.close)
        closer.start()
        receive_header(client)
        for _ in range(written):
            receive_packet(client)
        assert client.recv(1) == b""
        closer.join()
    assert (sink.dropped_packets, sink.clients) == (0, 0)
    sink.close()


def test_close_does_not_wait_for_a_stuck_client(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clsim.events.sockets.tcp.CLOSE_TIMEOUT_S", 1000.0)
    sink = TcpSink("tcp://127.0.0.1:0?compression=none", WIDTH, HEIGHT)
    batch = make_events(60_000)
    with connect_stuck(sink.port):
        assert sink.wait_for_clients(1, timeout_s=10)
        while sink.queued_bytes == 0:
            sink.write(batch, end_of(batch))
        closer = threading.Thread(target=sink.close, daemon=True)
        closer.start()
        closer.join(30)
        assert not closer.is_alive()
    assert sink.dropped_packets >= 1
    assert sink.dropped_events == sink.dropped_packets * len(batch)


@pytest.mark.parametrize("late", [False, True])
def test_a_brief_flush_ends_all_patience(monkeypatch: pytest.MonkeyPatch, late: bool) -> None:
    """Ctrl-C, be it while a close waits already, does not wait for a stuck client."""
    monkeypatch.setattr("clsim.events.sockets.tcp.PATIENCE_S", 1000.0)
    monkeypatch.setattr("clsim.events.sockets.tcp.CLOSE_TIMEOUT_S", 1000.0)
    sink = TcpSink("tcp://127.0.0.1:0?compression=none", WIDTH, HEIGHT)
    batch = make_events(60_000)
    with connect_stuck(sink.port):
        assert sink.wait_for_clients(1, timeout_s=10)
        while sink.queued_bytes == 0:
            sink.write(batch, end_of(batch))
        closer = threading.Thread(target=sink.close, daemon=True)
        if late:
            closer.start()
            closer.join(0.5)
            assert closer.is_alive()
        sink.flush_briefly()
        if not late:
            closer.start()
        closer.join(30)
        assert not closer.is_alive()
    sink.flush_briefly()
    sink.close()


def test_too_many_clients_are_turned_away(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clsim.events.sockets.tcp.MAX_CLIENTS", 2)
    sink = TcpSink("tcp://127.0.0.1:0", WIDTH, HEIGHT)
    clients = [socket.create_connection(("127.0.0.1", sink.port), timeout=10) for _ in range(3)]
    assert receive_until_end(clients[2]) == b""
    assert sink.clients == 2
    for client in clients:
        client.close()
    sink.close()


def test_a_packet_of_which_a_client_got_a_part_counts_as_dropped() -> None:
    """What arrives whole and what is counted as dropped are all events there were."""
    sink = TcpSink("tcp://127.0.0.1:0?compression=none&queue_mb=1", WIDTH, HEIGHT)
    with connect_stuck(sink.port) as stuck:
        assert sink.wait_for_clients(1, timeout_s=10)
        batch = make_events(10_000)
        sent = 0
        while sink.dropped_packets < 2:
            sink.write(batch, end_of(batch))
            sent += 1
        sink.flush_briefly()
        sink.close()
        receive_header(stuck)
        whole = 0
        with contextlib.suppress(ConnectionResetError, AssertionError):  # it hangs up in the middle of a packet
            while True:
                receive_packet(stuck)
                whole += 1
    assert sent > whole > 0 and sink.dropped_events == (sent - whole) * len(batch)
