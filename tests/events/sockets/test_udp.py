"""UDP: each layout read by independent code, by faery and by AEStream; drops counted; strangers' datagrams survived."""

from __future__ import annotations

import contextlib
import socket
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from clsim.errors import InputError
from clsim.events import EventBatch, empty_batch
from clsim.events.sockets.sources import open_socket_source
from clsim.events.sockets.udp import UdpSink
from clsim.events.sockets.udp_layouts import LAYOUTS, Unwrapper
from clsim.events.sockets.udp_source import UdpSource
from tests.events.event_data import end_of
from tests.events.sockets.socket_help import AESTREAM, HEIGHT, WIDTH, free_port, is_bound, make_events, wait_until

FEW = 6000
"""Their datagrams fit into any receiver's default socket buffer, however late it reads."""


@pytest.fixture
def receiver() -> socket.socket:
    """A bound socket that takes datagrams."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound:
        bound.bind(("127.0.0.1", 0))
        bound.settimeout(10)
        yield bound


def send(port: int, layout: str, batch: EventBatch) -> None:
    sink = UdpSink(f"udp://127.0.0.1:{port}?format={layout}", WIDTH, HEIGHT)
    half = len(batch) // 2
    sink.write(batch[:half], end_of(batch[:half]))
    sink.write(empty_batch(), end_of(empty_batch()))
    sink.write(batch[half:], end_of(batch[half:]))
    sink.close()
    assert (sink.dropped_packets, sink.dropped_events) == (0, 0)
    assert sink.warning is None


def decode_t64(data: bytes) -> list[tuple[int, int, int, int]]:
    return list(struct.iter_unpack("<QHHB", data))


def decode_t32(data: bytes) -> list[tuple[int, int, int, int]]:
    return [(t, x, y_on >> 1, y_on & 1) for t, x, y_on in struct.iter_unpack("<IHH", data)]


def decode_spif(data: bytes) -> list[tuple[int, int, int, int]]:
    words = [word for (word,) in struct.iter_unpack("<I", data)]
    assert all(word & 0x80000000 for word in words)  # "no time stamp follows"
    return [(0, word >> 16 & 0x7FFF, word & 0x7FFF, word >> 15 & 1) for word in words]


@pytest.mark.parametrize(
    ("layout", "decode", "most", "time_mask"),
    [("t64", decode_t64, 100, -1), ("t32", decode_t32, 100, 2**32 - 1), ("spif", decode_spif, 128, 0)],
)
def test_layouts(receiver: socket.socket, layout: str, decode: object, most: int, time_mask: int) -> None:
    batch = make_events(FEW, start_us=2**32 - 1000)
    send(receiver.getsockname()[1], layout, batch)
    got = []
    while len(got) < len(batch):
        events = decode(receiver.recv(1 << 16))
        assert 0 < len(events) <= most
        got += events
    expected = [(t & time_mask, x, y, on) for t, x, y, on in batch.tolist()]
    assert got == expected


def test_largest_coordinates() -> None:
    for name, largest in (("t64", 65_535), ("t32", 32_767), ("spif", 32_767)):
        batch = empty_batch(1)
        batch[0] = (5, largest, largest, True)
        got = LAYOUTS[name].unpack(LAYOUTS[name].pack(batch))[0]
        assert (got["x"], got["y"], got["on"]) == (largest, largest, True)
        with pytest.raises(InputError, match="does not fit"):
            UdpSink(f"udp://127.0.0.1:9?format={name}", largest + 2, 10)


@pytest.mark.parametrize(("layout", "theirs"), [("t64", "t64_x16_y16_on8"), ("t32", "t32_x16_y15_on1")])
def test_faery_receives_every_event(tmp_path: Path, layout: str, theirs: str) -> None:
    batch, port, path = make_events(FEW, start_us=10), free_port(), tmp_path / "got.csv"
    kept = len(batch) - 1500  # faery holds back up to 8 kB of text
    expected = f"t,x@{WIDTH},y@{HEIGHT},on\r\n" + "".join(
        f"{t},{x},{y},{on:d}\r\n" for t, x, y, on in batch[:kept].tolist()
    )
    command = f"-m faery input udp --dimensions {WIDTH}x{HEIGHT} --format {theirs} 127.0.0.1:{port} output file {path}"
    with subprocess.Popen([sys.executable, *command.split()], stderr=subprocess.DEVNULL) as faery:
        try:
            wait_until(lambda: is_bound(port), 60)
            send(port, layout, batch)
            wait_until(lambda: path.exists() and path.stat().st_size >= len(expected), 30)
        finally:
            faery.kill()
    assert path.read_bytes()[: len(expected)] == expected.encode()


def test_aestream_receives_every_event(tmp_path: Path) -> None:
    pytest.importorskip("aestream", reason="AEStream's Python package has no wheel for every Python")
    batch, port = make_events(FEW), free_port()
    arguments = [str(argument) for argument in (WIDTH, HEIGHT, port, len(batch), tmp_path / "image.npy")]
    with subprocess.Popen([sys.executable, "-c", AESTREAM, *arguments]) as aestream:
        try:
            wait_until(lambda: is_bound(port), 60)
            send(port, "spif", batch)
            assert aestream.wait(90) == 0
        finally:
            aestream.kill()
    expected = np.zeros((WIDTH, HEIGHT))
    np.add.at(expected, (batch["x"], batch["y"]), 1)  # AEStream counts events of both polarities
    np.testing.assert_array_equal(np.load(tmp_path / "image.npy"), expected)


@pytest.mark.parametrize("layout", ["t64", "t32", "spif"])
def test_round_trip(layout: str) -> None:
    batch = make_events(FEW, start_us=4_000_000_000)  # in front of t32's wrap, and beyond it after the gap
    batch["t"][FEW // 2 :] += 1_000_000_000
    with open_socket_source(f"udp://127.0.0.1:0?format={layout}&size={WIDTH}x{HEIGHT}") as source:
        assert isinstance(source, UdpSource)
        send(source.port, layout, batch)
        parts = []
        while sum(map(len, parts)) < len(batch):
            parts.append(next(source))
    got = np.concatenate(parts)
    names = ["x", "y", "on"] if layout == "spif" else ["t", "x", "y", "on"]
    np.testing.assert_array_equal(got[names], batch[names])
    assert (np.diff(got["t"]) >= 0).all()
    assert (source.dropped_events, source.malformed_packets) == (0, 0)


def test_full_queue_drops_the_oldest_and_counts(monkeypatch: pytest.MonkeyPatch, receiver: socket.socket) -> None:
    monkeypatch.setattr("clsim.events.sockets.udp.QUEUE_BYTES", 13 * 5000)
    held = threading.Event()
    resting = SimpleNamespace(monotonic=time.monotonic, sleep=lambda _: held.wait(10))
    monkeypatch.setattr("clsim.events.sockets.udp.time", resting)  # the sender rests after its first burst
    sink = UdpSink(f"udp://127.0.0.1:{receiver.getsockname()[1]}", WIDTH, HEIGHT)
    batches = [make_events(1950, start_us=i * 1_000_000) for i in range(10)]
    sink.write(batches[0], end_of(batches[0]))
    wait_until(lambda: sink.queued_bytes == 0)
    for batch in batches[1:]:
        sink.write(batch, end_of(batch))
    assert sink.dropped_events == 7 * 1950  # of the nine, two fit
    assert sink.dropped_packets == 7 * 20
    held.set()
    sink.close()
    got = b"".join(receiver.recv(2000) for _ in range(60))
    assert decode_t64(got) == [event for i in (0, 8, 9) for event in batches[i].tolist()]


def test_close_sends_a_long_queue(receiver: socket.socket) -> None:
    """What a short run leaves in the queue takes longer to send than the run itself."""
    batch = make_events(1_000_000)
    sink = UdpSink(f"udp://127.0.0.1:{receiver.getsockname()[1]}", WIDTH, HEIGHT)
    sink.write(batch, end_of(batch))
    assert sink.queued_bytes > 5_000_000
    sink.close()
    assert (sink.dropped_packets, sink.dropped_events, sink.queued_bytes) == (0, 0, 0)


@pytest.mark.parametrize("briefly", [False, True])
def test_close_is_bounded(monkeypatch: pytest.MonkeyPatch, receiver: socket.socket, briefly: bool) -> None:
    monkeypatch.setattr(f"clsim.events.sockets.udp.{'BRIEF_FLUSH_S' if briefly else 'CLOSE_TIMEOUT_S'}", 0.0)
    sink = UdpSink(f"udp://127.0.0.1:{receiver.getsockname()[1]}", WIDTH, HEIGHT)
    for _ in range(5):
        sink.write(make_events(50_000), end_of(make_events(50_000)))
    if briefly:
        sink.flush_briefly()
    sink.close()
    sink.close()
    receiver.setblocking(False)
    arrived = 0
    try:
        while True:
            arrived += len(receiver.recv(2000)) // 13
    except BlockingIOError:
        pass
    assert sink.dropped_events > 100_000
    assert arrived + sink.dropped_events <= 250_000


def test_wrong_events_refused(receiver: socket.socket) -> None:
    sink = UdpSink(f"udp://127.0.0.1:{receiver.getsockname()[1]}", WIDTH, HEIGHT)
    for event, complaint in (((-1, 0, 0, True), "-1 µs is negative"), ((0, 0, HEIGHT, True), f"y = {HEIGHT}")):
        batch = empty_batch(1)
        batch[0] = event
        with pytest.raises(InputError, match=complaint):
            sink.write(batch, end_of(batch))
    sink.close()


def test_strangers_datagrams() -> None:
    """Noise is counted and left out; what is good passes; older datagrams are sorted in."""
    with open_socket_source(f"udp://127.0.0.1:0?size={WIDTH}x{HEIGHT}") as source:
        assert isinstance(source, UdpSource)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            for datagram in (
                b"",
                b"hello",
                struct.pack("<QHHB", 1, WIDTH, 0, 1),
                struct.pack("<QHHB", 2**63, 0, 0, 1),
                struct.pack("<QHHB", 30, 1, 2, 255) + struct.pack("<QHHB", 20, 3, 4, 0),
            ):
                stranger.sendto(datagram, ("127.0.0.1", source.port))
        batch = next(source)
    assert batch.tolist() == [(20, 3, 4, False), (30, 1, 2, True)]
    assert batch["on"].view(np.uint8).tolist() == [0, 1]
    assert (source.malformed_packets, source.dropped_events) == (2, 2)
    assert list(source) == []


def test_silence_ends_the_iteration_when_asked() -> None:
    with open_socket_source("udp://127.0.0.1:0?size=4x3", idle_timeout_s=0.05) as source:
        assert list(source) == []


def test_close_by_another_thread_ends_the_iteration() -> None:
    source = open_socket_source("udp://127.0.0.1:0?size=4x3")
    threading.Timer(0.05, source.close).start()
    assert list(source) == []


def received(datagrams: list[bytes], form: str, wait_s: float = 0.3) -> tuple[list[int], UdpSource]:
    """Return the times of the events that a source gives for datagrams, each of which arrives alone."""
    times: list[int] = []
    with open_socket_source(f"udp://127.0.0.1:0?size={WIDTH}x{HEIGHT}&format={form}", idle_timeout_s=wait_s) as source:
        assert isinstance(source, UdpSource)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for number, datagram in enumerate(datagrams):
                sender.sendto(datagram, ("127.0.0.1", source.port))
                if number == 0 or number % 2:  # some come alone, some two at once
                    with contextlib.suppress(StopIteration):
                        times += next(source)["t"].tolist()
        for batch in source:
            times += batch["t"].tolist()
        return times, source


def t64(*times_us: int) -> bytes:
    return b"".join(struct.pack("<QHHB", t, 1, 2, 1) for t in times_us)


def test_a_datagram_that_was_overtaken_is_dropped_and_counted() -> None:
    times, source = received([t64(10, 20), t64(30, 40), t64(25, 35, 41), t64(50)], "t64")
    assert times == [10, 20, 30, 40, 41, 50] and source.dropped_events == 2
    times, source = received([t64(10, 20), t64(20, 30)], "t64")
    assert times == [10, 20, 20, 30] and source.dropped_events == 0  # the same time is not too late


def test_a_time_far_ahead_that_nobody_follows_blocks_nothing() -> None:
    stray = 10**15
    times, source = received([t64(10), t64(20), t64(30, stray), t64(40), t64(stray), t64(50), t64(60)], "t64")
    assert times == [10, 20, 40, 50, 60] and source.dropped_events == 3


def test_a_long_silence_is_no_stray() -> None:
    late = 3_600_000_000
    times, source = received([t64(10), t64(20), t64(late), t64(late + 5), t64(2 * late), t64(2 * late + 1)], "t64")
    assert times == [10, 20, late, late + 5, 2 * late, 2 * late + 1] and source.dropped_events == 0
    times, source = received([t64(10), t64(20), t64(late)], "t64")
    assert times == [10, 20, late] and source.dropped_events == 0


def test_a_datagram_that_is_late_around_the_wrap_keeps_its_lap() -> None:
    """32-bit times 2³² − 10, then 5, then a straggler from before the wrap, then 20."""
    wrap = 1 << 32
    unwrap = Unwrapper()
    found = [unwrap(np.array([t % wrap], np.int64))[0] for t in (wrap - 10, wrap + 5, wrap - 5, wrap + 20)]
    assert found == [wrap - 10, wrap + 5, wrap - 5, wrap + 20]
    datagrams = [struct.pack("<IHH", t % wrap, 1, 2 << 1) for t in (wrap - 10, wrap + 5, wrap - 5, wrap + 20)]
    times, source = received(datagrams, "t32")
    assert times in ([wrap - 10, wrap + 5, wrap + 20], [wrap - 10, wrap - 5, wrap + 5, wrap + 20])
    assert len(times) + source.dropped_events == 4


@settings(deadline=None)
@given(st.lists(st.lists(st.integers(2**27, 2**31 - 1), min_size=1, max_size=5), min_size=5, max_size=20))
def test_unwrapping_restores_increasing_times(steps: list[list[int]]) -> None:
    unwrap, now = Unwrapper(), 0
    for part in steps:
        times = now + np.cumsum(np.array(part, np.int64))
        now = int(times[-1])
        np.testing.assert_array_equal(unwrap(times % 2**32), times)


def test_a_datagram_that_comes_out_of_order_does_not_make_the_next_look_far_ahead() -> None:
    """How far a datagram lies ahead is measured from the latest time there was, not from the one before it."""
    times_us = (9_000_000, 100, 12_000_000)
    with open_socket_source(f"udp://127.0.0.1:0?format=t64&size={WIDTH}x{HEIGHT}") as source:
        for time_us in times_us:
            batch = make_events(1)
            batch["t"] = time_us
            send(source.port, "t64", batch)
        assert next(source)["t"].tolist() == sorted(times_us)


def test_any_number_but_0_is_on_in_t64() -> None:
    data = b"".join(struct.pack("<QHHB", 7, 1, 2, on) for on in (0, 1, 2, 128, 254, 255))
    found = LAYOUTS["t64"].unpack(data)["on"]
    assert found.view(np.uint8).tolist() == [0, 1, 1, 1, 1, 1]


def test_events_without_times_are_counted_from_the_start_of_listening() -> None:
    begun_s = time.monotonic()
    with open_socket_source(f"udp://127.0.0.1:0?format=spif&size={WIDTH}x{HEIGHT}") as source:
        assert isinstance(source, UdpSource)
        time.sleep(0.05)
        send(source.port, "spif", make_events(10))
        times_us = next(source)["t"]
        assert ((times_us >= 50_000) & (times_us <= (time.monotonic() - begun_s) * 1e6)).all()


def test_after_a_long_silence_datagrams_may_overtake_each_other() -> None:
    """What lies far ahead is believed once another one is there as well, a little earlier or later."""
    for other_us in (20_000_000, 19_999_000, 20_001_000):
        times, source = received([t64(1), t64(2), t64(20_000_000), t64(other_us)], "t64", wait_s=0.1)
        assert times == [1, 2, *sorted([20_000_000, other_us])] and source.dropped_events == 0
