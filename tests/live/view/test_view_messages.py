"""What a page may ask for, and that nothing else is listened to, whoever sends it."""

import asyncio
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clsim.events.files import open_sink, open_source
from clsim.live.view import server as server_module
from clsim.live.view.commands import Seek, Seen, Speed, Switch, WantFrames, parse_message
from tests.live.view.view_events import random_events

aiohttp = pytest.importorskip("aiohttp", reason="the page is an extra")

from clsim.live.view.player import Player  # noqa: E402
from clsim.live.view.sink import ViewSink  # noqa: E402

EVENTS = random_events(3000, 20, 10, begin_us=1_000_000, end_us=3_000_000)
NONSENSE = (
    '{"command": "speed", "value": NaN}',
    '{"command": "speed", "value": 1e999}',
    '{"command": "speed", "value": -1}',
    '{"command": "speed", "value": 0}',
    '{"command": "speed", "value": "fast"}',
    '{"command": "speed", "value": true}',
    '{"command": "seek", "value": NaN}',
    '{"command": "seek", "value": 1e999}',
    '{"command": "seek", "value": -Infinity}',
    '{"command": "seek", "value": [1]}',
    '{"command": "seek"}',
    '{"command": "play", "value": 1}',
    '{"command": "joined"}',
    '{"command": ["play"], "value": true}',
    '{"seen": 1e999}',
    '{"seen": NaN}',
    '{"frames": 1}',
    "[" * 3000,
    "1" * 4000,
    "{",
    "[]",
    "null",
    '"seek"',
    "",
)


@pytest.mark.parametrize("text", NONSENSE, ids=lambda text: text[:40])
def test_nonsense_is_nothing(text: str) -> None:
    assert parse_message(text) is None


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ('{"seen": 12}', Seen(12)),
        ('{"frames": false}', WantFrames(False)),
        ('{"command": "play", "value": true}', Switch("play", True)),
        ('{"command": "loop", "value": false}', Switch("loop", False)),
        ('{"command": "speed", "value": 0.25}', Speed(0.25)),
        ('{"command": "seek", "value": 1500000}', Seek(1_500_000)),
        ('{"command": "seek", "value": -7}', Seek(0)),
        ('{"command": "seek", "value": 1e30}', Seek(1 << 53)),
    ],
)
def test_what_the_page_says_is_understood(text: str, meant: object) -> None:
    assert parse_message(text) == meant


@given(st.binary(max_size=200))
def test_bytes_are_nothing_or_a_message(data: bytes) -> None:
    parse_message(data)


def play(url: str, *said: str, until: int) -> list[Any]:
    """Join as a page, say something, and return the messages until events from a time on have come."""

    async def run() -> list[Any]:
        messages: list[Any] = []
        received = 0
        async with aiohttp.ClientSession() as session, session.ws_connect(f"{url}stream", max_msg_size=0) as stream:
            for text in said:
                await stream.send_str(text)
            while True:
                message = await asyncio.wait_for(stream.receive(), 20)
                assert message.type in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY), message
                if message.type == aiohttp.WSMsgType.TEXT:
                    messages.append(json.loads(message.data))
                    continue
                received += 1
                await stream.send_json({"seen": received})
                messages.append(message.data)
                if int.from_bytes(message.data[16:24], "little") >= until:
                    return messages

    return asyncio.run(run())


@pytest.fixture
def player(tmp_path: Path) -> Iterator[Player]:
    sink = open_sink(tmp_path / "events.aedat4", 20, 10)
    sink.write(EVENTS, 3_000_000)
    sink.close()
    opened = Player(lambda: open_source(tmp_path / "events.aedat4"), "a test", 20, 10, port=0)
    yield opened
    opened.close()


@pytest.mark.slow
def test_a_hostile_page_upsets_neither_itself_nor_the_recording(player: Player) -> None:
    extremes = ('{"command": "seek", "value": 1e30}', '{"command": "seek", "value": -1e30}')
    play(player.url, *NONSENSE, *extremes, '{"command": "speed", "value": 1e308}', until=int(EVENTS["t"][-1]))
    player.wait(0.1)
    play(player.url, '{"command": "speed", "value": 10}', until=int(EVENTS["t"][-1]))
    player.wait(0.1)


def test_a_page_that_sends_too_much_is_disconnected(player: Player) -> None:
    with pytest.raises(AssertionError, match=r"1009|CLOSE"):
        play(player.url, "x" * 100_000, '{"command": "play", "value": false}', until=1 << 60)
    play(player.url, '{"command": "speed", "value": 10}', until=int(EVENTS["t"][-1]))


def test_each_page_plays_for_itself(player: Player) -> None:
    """One page pauses at a place of its own while another plays: neither notices."""

    async def run() -> None:
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(f"{player.url}stream") as paused,
            session.ws_connect(f"{player.url}stream") as playing,
        ):
            await paused.send_str('{"command": "play", "value": false}')
            await paused.send_str('{"command": "seek", "value": 1500000}')
            await playing.send_str('{"command": "loop", "value": false}')
            await playing.send_str('{"command": "speed", "value": 10}')
            status: dict[Any, dict[str, Any]] = {paused: {}, playing: {}}
            latest_us = {paused: 0, playing: 0}
            while status[playing].get("playing", True) or status[paused].get("position_us") != 1_500_000:
                for stream in status:
                    message = await asyncio.wait_for(stream.receive(), 20)
                    if message.type == aiohttp.WSMsgType.TEXT:
                        told = json.loads(message.data)
                        status[stream] = told if told["type"] == "status" else status[stream]
                    else:
                        latest_us[stream] = max(latest_us[stream], int.from_bytes(message.data[16:24], "little"))
                        await stream.send_str('{"seen": 100000}')
            assert status[playing]["position_us"] == EVENTS["t"][-1] and status[playing]["speed"] == 10
            assert status[paused]["playing"] is False and status[paused]["speed"] == 1
            assert latest_us[paused] < 2_000_000 < latest_us[playing]  # neither is sent what the other sees

    asyncio.run(run())


def test_a_stream_takes_no_orders() -> None:
    sink = ViewSink("a test", 20, 10, port=0)
    try:
        messages = play_live(sink, '{"command": "play", "value": false}', '{"command": "seek", "value": 0}')
    finally:
        sink.close()
    assert np.frombuffer(messages[-1], "<u2", 3000, 32 + 4 * 3000).tolist() == EVENTS["x"].tolist()


def play_live(sink: ViewSink, *said: str) -> list[Any]:
    async def run() -> list[Any]:
        async with aiohttp.ClientSession() as session, session.ws_connect(f"{sink.url}stream") as stream:
            for text in said:
                await stream.send_str(text)
            await asyncio.sleep(0.1)
            sink.write(EVENTS, 3_000_000)
            while (message := await asyncio.wait_for(stream.receive(), 10)).type == aiohttp.WSMsgType.TEXT:
                pass
            return [message.data]

    return asyncio.run(run())


def test_the_number_of_pages_is_bounded(player: Player, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server_module, "MOST_PAGES", 2)

    async def run() -> None:
        url = f"{player.url}stream"
        async with aiohttp.ClientSession() as session, session.ws_connect(url) as first, session.ws_connect(url):
            with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
                await session.ws_connect(url)
            assert refused.value.status == 503
            await first.close()
            for _ in range(100):
                if len(player._server._pages) < 2:
                    break
                await asyncio.sleep(0.02)
            async with session.ws_connect(url) as again:
                assert json.loads((await again.receive()).data)["type"] == "hello"

    asyncio.run(run())
