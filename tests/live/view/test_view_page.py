"""The page's server: what it serves, to whom, and that slow browsers cost nothing."""

import asyncio
import gc
import json
import re
import socket
import struct
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from importlib.resources import files
from typing import Any

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.events import EVENT_DTYPE, EventBatch, empty_batch
from clsim.frames import Frame
from clsim.live.view import hub as hub_module
from clsim.live.view import server
from clsim.live.view.hub import Hub, Watcher
from clsim.live.view.packets import PACKET_EVENTS, event_packets
from tests.events.event_data import end_of
from tests.live.view.view_events import random_events

aiohttp = pytest.importorskip("aiohttp", reason="the page is an extra")

from clsim.live.view.sink import ViewSink  # noqa: E402

WIDTH, HEIGHT = 64, 48
ASSETS = (
    "",
    "index.html",
    "style.css",
    "main.js",
    "store.js",
    "image.js",
    "cloud.js",
    "rate.js",
    "text.js",
    "icon.svg",
)


@pytest.fixture
def sink() -> Iterator[ViewSink]:
    opened = ViewSink("a test", WIDTH, HEIGHT, port=0)
    yield opened
    opened.close()


def get(url: str, **headers: str) -> tuple[int, str, Any]:
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=5) as answer:
            return answer.status, answer.read().decode(), answer.headers
    except urllib.error.HTTPError as error:
        return error.code, "", error.headers


def decode(packet: bytes) -> tuple[int, int, int, EventBatch]:
    """Read an event packet by the table in packets.py, not by its code."""
    kind, count, base_us, now_us, width, height = struct.unpack_from("<IIqqII", packet)
    events = np.zeros(count if kind == 1 else 0, EVENT_DTYPE)
    if kind == 1:
        y = np.frombuffer(packet, "<u2", count, 32 + 6 * count)
        events["t"] = base_us + np.frombuffer(packet, "<u4", count, 32).astype(np.int64)
        events["x"] = np.frombuffer(packet, "<u2", count, 32 + 4 * count)
        events["y"], events["on"] = y & 0x7FFF, y >> 15 == 1
        assert len(packet) == 32 + 8 * count
    return kind, now_us, width * height, events


def watch(
    url: str, until: Callable[[list[Any]], bool], act: Callable[[], None] = lambda: None, **answer: Any
) -> list[Any]:
    """Join as a browser; call ``act`` once joined; return all messages up to the one that satisfies ``until``."""

    async def run() -> list[Any]:
        messages: list[Any] = []
        async with aiohttp.ClientSession() as session, session.ws_connect(f"{url}stream", max_msg_size=0) as stream:
            messages.append(json.loads((await stream.receive()).data))
            await asyncio.to_thread(act)
            received = 0
            while not until(messages):
                message = await asyncio.wait_for(stream.receive(), 10)
                if message.type == aiohttp.WSMsgType.BINARY:
                    received += 1
                    messages.append(message.data)
                    await stream.send_json({"seen": received})
                elif message.type == aiohttp.WSMsgType.TEXT:
                    messages.append(json.loads(message.data))
                else:
                    break
        return messages

    return asyncio.run(run())


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < deadline, "it did not happen within 10 s"
        time.sleep(0.005)


def test_page_and_assets_are_served_and_ask_nobody_else(sink: ViewSink) -> None:
    for name in ASSETS:
        status, body, headers = get(sink.url + name)
        assert status == 200 and body, name
        assert "default-src 'none'" in headers["Content-Security-Policy"]
    status, body, _ = get(f"{sink.url}colormaps.json")
    tables = json.loads(body)
    assert status == 200 and all(len(table) == 768 for themes in tables.values() for table in themes.values())
    assert get(f"{sink.url}../server.py")[0] == 404


def test_no_asset_mentions_another_machine() -> None:
    page = files("clsim.live.view") / "page"
    names = {entry.name for entry in page.iterdir()}
    assert {name for name in ASSETS if name} <= names
    for entry in page.iterdir():
        text = entry.read_text(encoding="utf-8").replace('xmlns="http://www.w3.org/2000/svg"', "")
        text = text.replace("`ws://${location.host}/stream`", "")
        assert not re.search(r"(https?:|wss?:)?//[\w$]", re.sub(r"(^|\s)//[^\n]*", "", text)), entry.name
        for script in re.findall(r'from "([^"]+)"|(?:src|href)="([^"]+)"', text):
            assert "".join(script).lstrip("./") in names, f"{entry.name} wants {script}"


def test_other_sites_and_names_are_refused(sink: ViewSink) -> None:
    port = sink.url.rstrip("/").rpartition(":")[2]
    assert get(sink.url, Origin="http://evil.example")[0] == 403
    assert get(sink.url, Origin=f"http://127.0.0.1:{int(port) - 1}")[0] == 403, "what another program serves here"
    assert get(sink.url, Host=f"evil.example:{port}")[0] == 403
    assert get(sink.url, Origin=sink.url.rstrip("/"))[0] == 200
    assert get(f"http://localhost:{port}/")[0] == 200


def test_packets_hold_every_event() -> None:
    events = random_events(3 * PACKET_EVENTS + 17, WIDTH, HEIGHT, end_us=20_000_000_000)
    told = [(*decode(packet), count) for packet, count in event_packets(events, 20_000_000_001)]
    assert sum(each[-1] for each in told) == len(events)
    assert np.array_equal(np.concatenate([each[3] for each in told]), events)
    assert [each[1] for each in told] == [*(each[3]["t"][-1] for each in told[:-1]), 20_000_000_001]
    events["t"][-17:] = events["t"][-17] + (1 << 32) * np.arange(17)  # a packet's own times have 32 bits
    packets = list(event_packets(events[-20:], 1 << 40))
    assert np.array_equal(np.concatenate([decode(packet)[3] for packet, _ in packets]), events[-20:])
    ((packet, count),) = event_packets(empty_batch(0), 5)
    assert count == 0 and decode(packet)[:2] == (1, 5)


def test_a_browser_gets_every_event_in_order(sink: ViewSink) -> None:
    events = random_events(200_000, WIDTH, HEIGHT)

    def act() -> None:
        for start in range(0, len(events), 1000):
            sink.write(events[start : start + 1000], end_of(events[start : start + 1000]))

    def got(messages: list[Any]) -> int:
        return sum(len(decode(m)[3]) for m in messages if isinstance(m, bytes))

    messages = watch(sink.url, lambda m: got(m) >= len(events), act)
    hello = {"type": "hello", "title": "a test", "width": WIDTH, "height": HEIGHT, "live": True, "frames": "rendered"}
    assert messages[0] == hello
    assert np.array_equal(np.concatenate([decode(m)[3] for m in messages if isinstance(m, bytes)]), events)
    assert sink.dropped_events == 0


def test_status_is_told(sink: ViewSink) -> None:
    sink.status = lambda: {"frames_per_s": 12.5}
    messages = watch(sink.url, lambda m: any(isinstance(x, dict) and x["type"] == "status" for x in m))
    assert {"type": "status", "frames_per_s": 12.5, "missed_events": 0} in messages


def test_garbage_from_a_browser_is_ignored(sink: ViewSink) -> None:
    async def run() -> None:
        async with aiohttp.ClientSession() as session, session.ws_connect(f"{sink.url}stream") as stream:
            await stream.receive()
            for text in ("{", "[]", "3", '{"seen": "x"}', '{"command": null}', '{"nothing": 1}', "null"):
                await stream.send_str(text)
            await stream.send_bytes(b"\xff\x00")
            await stream.send_str('{"frames": false}')
            while next(iter(sink._server.hub.watchers)).wants_frames:
                await asyncio.sleep(0.005)

    asyncio.run(asyncio.wait_for(run(), 10))


def test_a_stuck_browser_costs_bounded_memory_and_no_time(sink: ViewSink, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hub_module, "QUEUE_EVENTS", 50_000)
    host, port = sink.url[7:].rstrip("/").split(":")
    request = (
        f"GET /stream HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    )
    batch = random_events(10_000, WIDTH, HEIGHT)
    with socket.create_connection((host, int(port))) as stuck:
        stuck.sendall(request.encode())
        wait_until(lambda: sink.clients == 1)
        (watcher,) = sink._server.hub.watchers
        written = 0
        while written < 3_000_000:
            sink.write(batch, end_of(batch))
            written += len(batch)
            assert watcher.waiting_events <= 50_000
            assert sink._server.hub._pending_events <= 50_000
        wait_until(lambda: sink._server.hub._pending_events == 0)
        assert sink.dropped_events > 2_000_000
        # Who does read still gets the newest events.
        newest = random_events(1000, WIDTH, HEIGHT, begin_us=2_000_000, end_us=3_000_000)
        messages = watch(
            sink.url,
            lambda m: any(isinstance(x, bytes) and len(decode(x)[3]) for x in m),
            lambda: sink.write(newest, end_of(newest)),
        )
        assert np.array_equal(decode(messages[-1])[3], newest)
    wait_until(lambda: sink.clients == 0)
    assert sink.dropped_events > 2_000_000  # what a browser lost stays counted when it has gone


def test_nothing_is_kept_while_nobody_watches(sink: ViewSink) -> None:
    sink.write(random_events(1000, WIDTH, HEIGHT), end_of(random_events(1000, WIDTH, HEIGHT)))
    assert sink._server.hub._pending_events == 0 and not sink.wants_frame()


def test_more_than_a_queue_holds_is_counted_before_it_is_handed_out(
    sink: ViewSink, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hub_module, "QUEUE_EVENTS", 1000)
    events = random_events(1700, WIDTH, HEIGHT)
    got = watch(
        sink.url,
        lambda m: any(isinstance(x, bytes) and len(decode(x)[3]) for x in m),
        lambda: sink.write(events, end_of(events)),
    )
    assert np.array_equal(decode(got[-1])[3], events[700:])
    assert sink.dropped_events == 700


def test_a_seek_drops_what_waits_and_comes_before_what_follows() -> None:
    async def run() -> list[bytes]:
        hub, watcher = Hub(asyncio.get_running_loop()), Watcher()
        hub.watchers.add(watcher)
        hub.offer(random_events(10, WIDTH, HEIGHT), 10)
        await asyncio.sleep(0.05)
        hub.offer(random_events(20, WIDTH, HEIGHT), 20)
        hub.seek(5)
        hub.offer(random_events(30, WIDTH, HEIGHT), 30)
        await asyncio.sleep(0.05)
        packets = []
        while (packet := watcher.next_packet()) is not None:
            packets.append(packet)
        return packets

    seek, events = asyncio.run(run())
    assert decode(seek)[:2] == (4, 5)
    assert decode(events)[1] == 30 and len(decode(events)[3]) == 30


def test_frames_are_shown_noisy_and_denoised_and_throttled(sink: ViewSink) -> None:
    names = ("R", "G", "B", "Depth")
    planes = np.zeros((4, HEIGHT, WIDTH), np.float32)
    planes[0, :, 32:], planes[1], planes[2] = 4.0, 2.0, 1.0
    level = np.log(np.linspace(1, 5, HEIGHT * WIDTH, dtype=np.float32)).reshape(HEIGHT, WIDTH)
    level[0, 0] = np.nan

    def act() -> None:
        wait_until(sink.wants_frame)
        sink.show_frame(Frame(planes, names, time_us=77), level)
        assert not sink.wants_frame()

    def images(messages: list[Any]) -> dict[int, bytes]:
        return {decode(m)[0]: m for m in messages if isinstance(m, bytes)}

    found = images(watch(sink.url, lambda m: {2, 3} <= images(m).keys(), act))
    kind, channels, _, now_us, width, height = struct.unpack_from("<IIqqII", found[2])
    assert (kind, channels, now_us, width, height) == (2, 3, 77, WIDTH, HEIGHT)
    noisy = np.frombuffer(found[2], np.uint8, offset=32).reshape(HEIGHT, WIDTH, 3)
    assert (noisy[:, 40, 0] > noisy[:, 40, 1]).all() and (noisy[:, 40, 1] > noisy[:, 40, 2]).all()
    assert (noisy[:, 5, 0] == 0).all()
    denoised = np.frombuffer(found[3], np.uint8, offset=32).reshape(HEIGHT, WIDTH)
    assert denoised[0, 0] == 0 and (np.diff(denoised.ravel()[1:].astype(int)) >= 0).all() and denoised[-1, -1] > 200


def test_truth_is_shown_beside_as_pictures_of_the_frames_that_have_it() -> None:
    planes = np.zeros((9, HEIGHT, WIDTH), np.float32)
    planes[3] = np.linspace(1, 5, WIDTH)
    planes[3, 0] = np.inf
    planes[4], planes[6], planes[7] = 3.0, 1.0, 1.0  # to the right
    planes[8, :, 32:] = 2
    names = ("R", "G", "B", "Z", *(f"Flow.forward.{part}" for part in ("X", "Y", "valid", "covisible")), "Id.object")
    planes = np.concatenate([planes, planes[8:]])
    sink = ViewSink("truth", WIDTH, HEIGHT, port=0, truth_every=2)

    def act() -> None:
        for index in (1, 2):
            wait_until(sink.wants_frame)
            sink.show_frame(Frame(planes, (*names, "Id.material"), time_us=index, index=index), None)

    def images(messages: list[Any]) -> dict[int, bytes]:
        return {decode(m)[0]: m for m in messages if isinstance(m, bytes)}

    found = images(watch(sink.url, lambda m: {5, 6, 7} <= images(m).keys(), act))
    sink.close()
    assert {struct.unpack_from("<IIqqII", found[kind])[3] for kind in (5, 6, 7)} == {2}, "of the second frame alone"
    shown = [np.frombuffer(found[kind], np.uint8, offset=32).reshape(HEIGHT, WIDTH, 3) for kind in (5, 6, 7)]
    depth, flow, ids = (picture.astype(int) for picture in shown)
    assert (depth[0] == 0).all() and depth[1, 5].sum() > depth[1, -5].sum() > 0, "near is light, nothing is black"
    assert (flow == (255, 0, 0)).all(), "right is red"
    assert (ids[:, :32] == 0).all() and ids[:, 32:].any(axis=2).all()


def test_the_end_is_told_and_the_thread_ends() -> None:
    sink = ViewSink("short", WIDTH, HEIGHT, port=0)
    messages = watch(
        sink.url,
        lambda m: any(isinstance(x, dict) and x["type"] == "end" for x in m),
        lambda: threading.Timer(0.1, sink.close).start(),
    )
    assert messages[-1] == {"type": "end"}
    sink.close()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("clsim-view")]


def test_a_browser_that_draws_slowly_gets_the_last_events_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """It confirms what it has got a moment after it has heard of the end."""
    monkeypatch.setattr(hub_module, "UNSEEN_PACKETS", 2)
    sink = ViewSink("slow", WIDTH, HEIGHT, port=0)
    events = random_events(4 * PACKET_EVENTS, WIDTH, HEIGHT)

    async def run() -> int:
        found, received = 0, 0
        async with aiohttp.ClientSession() as session, session.ws_connect(f"{sink.url}stream", max_msg_size=0) as page:
            await page.receive()
            await asyncio.to_thread(sink.write, events, end_of(events))
            ending = None
            async for message in page:
                if message.type == aiohttp.WSMsgType.BINARY:
                    found, received = found + len(decode(message.data)[3]), received + 1
                    if received == hub_module.UNSEEN_PACKETS:
                        ending = asyncio.create_task(asyncio.to_thread(sink.close))
                elif json.loads(message.data)["type"] == "end":
                    await asyncio.sleep(0.1)
                    await page.send_json({"seen": received})
            assert ending is not None
            await ending
        return found

    assert asyncio.run(run()) == len(events)


def test_closing_with_browsers_open_is_quiet(caplog: pytest.LogCaptureFixture) -> None:
    sink = ViewSink("left alone", WIDTH, HEIGHT, port=0)
    request = b"GET /stream HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    request += b"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    port = int(sink.url.rstrip("/").rpartition(":")[2])
    with socket.create_connection(("127.0.0.1", port)) as browser:
        browser.sendall(request)
        wait_until(lambda: sink.clients == 1)
        began_s = time.monotonic()
        sink.close()
        assert time.monotonic() - began_s < 5
    gc.collect()
    assert caplog.records == []


def test_a_taken_port_is_one_sentence(sink: ViewSink) -> None:
    port = int(sink.url.rstrip("/").rpartition(":")[2])
    with pytest.raises(InputError, match=rf"`port`.*127\.0\.0\.1:{port}.*free port"):
        ViewSink("second", WIDTH, HEIGHT, port=port)


def test_another_machine_may_only_watch_with_a_warning() -> None:
    sink = ViewSink("open", WIDTH, HEIGHT, host="0.0.0.0", port=0)
    sink.close()
    assert sink.warning is not None and "every machine" in sink.warning


def test_another_port_serves_where_the_usual_one_is_taken_unless_that_was_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with server.listen(port=0) as first:
        taken = first.getsockname()[1]
        monkeypatch.setattr(server, "DEFAULT_PORT", taken)
        with server.listen() as second:
            assert second.getsockname()[1] != taken
        with pytest.raises(InputError, match=f"{taken} cannot be used .*; expected a free port"):
            server.listen(port=taken)
