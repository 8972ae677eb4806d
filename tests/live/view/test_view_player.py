import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.events import EventBatch
from clsim.events.files import open_sink, open_source
from clsim.events.formats.aedat4 import Aedat4Sink, read_frames
from clsim.events.formats.filesink import FlushPolicy
from clsim.events.formats.filesource import EventSource
from tests.live.view.view_events import random_events

pytest.importorskip("aiohttp", reason="the page is an extra")

from clsim.live.view import playback as playback_module
from clsim.live.view.commands import Seek, Speed, Switch
from clsim.live.view.hub import Hub
from clsim.live.view.packets import HEADER, NOISY
from clsim.live.view.playback import Playback
from clsim.live.view.player import OVERVIEW_BINS, Overview, Player
from clsim.live.view.pump import Pump, paced
from tests.events.event_data import end_of

WIDTH, HEIGHT = 20, 10
EVENTS = random_events(5000, WIDTH, HEIGHT, begin_us=3_000_000, end_us=5_000_000)


class Browser(Hub):
    """Takes the place of a page's hub, so that tests see what would be sent to it."""

    def __init__(self) -> None:
        self.events: list[EventBatch] = []
        self.seeks: list[int] = []
        self.errors: list[BaseException] = []
        self.shown: list[tuple[int, bytes]] = []
        """Times and pixels of images."""

    def offer(self, batch: EventBatch, now_us: int) -> None:
        self.events.append(batch.copy())

    def show(self, kind: int, packet: bytes) -> None:
        head = HEADER.unpack_from(packet)
        assert (kind, head[0], head[1], head[4:]) == (NOISY, NOISY, 3, (WIDTH, HEIGHT))
        self.shown.append((head[3], packet[HEADER.size :]))

    def seek(self, now_us: int) -> None:
        self.sought_s = time.monotonic()
        self.seeks.append(now_us)
        self.events.clear()

    @property
    def seen(self) -> EventBatch:
        return np.concatenate(list(self.events)) if self.events else EVENTS[:0]


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "events.aedat4"
    sink = open_sink(path, WIDTH, HEIGHT)
    for start in range(0, len(EVENTS), 300):
        sink.write(EVENTS[start : start + 300], end_of(EVENTS[start : start + 300]))
    sink.close()
    return path


@pytest.fixture
def browser() -> Browser:
    return Browser()


def test_recorded_frames_are_shown_when_their_time_has_come(tmp_path: Path, browser: Browser) -> None:
    sink = Aedat4Sink(tmp_path / "both.aedat4", WIDTH, HEIGHT, FlushPolicy(), frames=True)
    images = np.random.default_rng(1).integers(0, 256, (4, HEIGHT, WIDTH, 3), dtype=np.uint8)
    times_us = (3_000_000, 3_600_000, 4_200_000, 4_800_000)
    for time_us, image, begin_us in zip(times_us, images, (0, *times_us), strict=False):
        part = EVENTS[(EVENTS["t"] >= begin_us) & (EVENTS["t"] < time_us)]
        sink.write(part, time_us)
        sink.write_image(time_us, image)
    sink.write(EVENTS[EVENTS["t"] >= times_us[-1]], 5_000_000)
    sink.close()
    path = tmp_path / "both.aedat4"
    assert np.array_equal(np.concatenate(list(open_source(path))), EVENTS)
    player = Playback(lambda: open_source(path), browser, browser.errors.append, lambda: read_frames(path))
    player.control(Switch("play", False))
    expected = []
    for target, number in ((4_300_000, 2), (4_800_000, 3), (3_700_000, 1), (4_200_000, 2), (4_100_000, 1)):
        player.control(Seek(target))
        expected.append((times_us[number], images[number][:, :, ::-1].tobytes()))  # red first, as pages want it
        wait_until(lambda: len(browser.seeks) == len(expected) and player._seek_us is None)
        wait_until(lambda: [each for each in browser.shown if each[0] >= 3_600_000][-1:] == expected[-1:])
    player.close()
    player.join(5)
    assert not browser.errors


@pytest.fixture
def playback(recording: Path, browser: Browser) -> Iterator[Playback]:
    player = Playback(lambda: open_source(recording), browser, browser.errors.append)
    player.control(Switch("play", False))
    yield player
    player.close()
    player.join(5)
    assert not player.alive and not browser.errors


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < deadline, "it did not happen within 10 s"
        time.sleep(0.005)


def play_to_the_end(playback: Playback) -> None:
    for command in (Switch("loop", False), Speed(10), Switch("play", True)):
        playback.control(command)
    wait_until(lambda: not playback.status()["playing"])


def test_everything_is_played(playback: Playback, browser: Browser) -> None:
    play_to_the_end(playback)
    assert np.array_equal(browser.seen, EVENTS)
    assert playback.status()["position_us"] == EVENTS["t"][-1]


@pytest.mark.parametrize(
    "targets",
    [
        (4_500_000,),
        (4_800_000, 3_700_000),
        (3_200_000, 3_100_000),
        (4_000_000, 4_300_000),
        (0,),
        (99_000_000,),
        (1 << 53,),
    ],
)
def test_a_seek_shows_the_second_before_it(playback: Playback, browser: Browser, targets: tuple[int, ...]) -> None:
    for count, target in enumerate(targets, start=1):
        playback.control(Seek(target))
        wait_until(lambda count=count: len(browser.seeks) >= count)
    reached = min(max(targets[-1], int(EVENTS["t"][0])), int(EVENTS["t"][-1]))
    wait_until(lambda: playback._seek_us is None)
    time.sleep(0.05)
    assert browser.seeks[-1] == reached
    begin_us = max(targets[-1], int(EVENTS["t"][0])) - playback_module.PREROLL_US
    wanted = EVENTS[(EVENTS["t"] >= begin_us) & (EVENTS["t"] < max(targets[-1], 0))]
    assert np.array_equal(browser.seen, wanted)
    assert not playback.status()["playing"]


def test_play_goes_on_from_a_seek(playback: Playback, browser: Browser) -> None:
    playback.control(Seek(4_000_000))
    wait_until(lambda: bool(browser.seeks))
    play_to_the_end(playback)
    assert np.array_equal(browser.seen, EVENTS[EVENTS["t"] >= 3_000_000])
    assert np.unique(browser.seen["t"]).size == np.unique(EVENTS["t"]).size


def played_no_longer(player: Playback, from_us: int, since_s: float) -> bool:
    """Whether no more has been played than time has passed, once something has been."""
    wait_until(lambda: player.status()["position_us"] > from_us)
    return bool(player.status()["position_us"] - from_us <= 1e6 * (time.monotonic() - since_s) + 1_000)


def test_play_goes_on_from_where_it_was_paused_however_long(playback: Playback) -> None:
    time.sleep(0.1)
    paused_us, began_s = playback.status()["position_us"], time.monotonic()
    playback.control(Switch("play", True))
    assert played_no_longer(playback, paused_us, began_s)


def test_the_time_that_a_seek_takes_is_not_played(recording: Path, browser: Browser) -> None:
    def slow() -> EventSource:
        time.sleep(0.05)
        return open_source(recording)

    player = Playback(slow, browser, browser.errors.append)
    player.control(Seek(3_500_000))
    wait_until(lambda: bool(browser.seeks))
    assert played_no_longer(player, 3_500_000, browser.sought_s)
    player.close()
    player.join(5)


def test_a_loop_begins_anew(playback: Playback, browser: Browser) -> None:
    playback.control(Speed(10))
    playback.control(Switch("play", True))
    wait_until(lambda: len(browser.seeks) >= 2)
    assert set(browser.seeks) == {int(EVENTS["t"][0])}


def test_a_wish_at_the_end_counts_more_than_the_loop(recording: Path, playback: Playback) -> None:
    playback.close()
    playback.join(5)  # from here on, this thread does its steps
    reader = playback_module._Reader(lambda: open_source(recording))
    playback._seek_us = 3_500_000
    playback._advance(reader, 99_000_000)
    assert reader.ended and playback._seek_us == 3_500_000


def test_the_speed_is_kept_within_reason(playback: Playback) -> None:
    for value, expected in ((0.1, 0.1), (1e9, 10.0), (1e-9, 0.001)):
        playback.control(Speed(value))
        assert playback.status()["speed"] == expected


def test_the_overview_counts_the_whole_file(recording: Path) -> None:
    player = Player(lambda: open_source(recording), "a test", WIDTH, HEIGHT, port=0)
    try:
        wait_until(lambda: player._overview.complete)
        wait_until(lambda: json.loads(player._server._told.get("overview", "{}")).get("complete", False))
        overview = json.loads(player._server._told["overview"])  # what a page gets that joins now
    finally:
        player.close()
    assert overview["begin_us"] == EVENTS["t"][0] and overview["end_us"] == EVENTS["t"][-1]
    assert sum(overview["on"]) == EVENTS["on"].sum() and sum(overview["off"]) == (~EVENTS["on"]).sum()


@pytest.mark.parametrize("step", [7, 1000, 5000])
def test_bins_of_an_overview_are_a_histogram(step: int) -> None:
    overview = Overview()
    for start in range(0, len(EVENTS), step):
        overview.add(EVENTS[start : start + step])
    told = overview.as_dict()
    assert len(told["on"]) <= OVERVIEW_BINS
    edges = told["begin_us"] + told["bin_us"] * np.arange(len(told["on"]) + 1)
    for name, events in (("on", EVENTS[EVENTS["on"]]), ("off", EVENTS[~EVENTS["on"]])):
        assert told[name] == np.histogram(events["t"], edges)[0].tolist()


@pytest.mark.parametrize("bins", [OVERVIEW_BINS - 1, OVERVIEW_BINS, OVERVIEW_BINS + 1])
def test_an_overview_has_room_for_an_event_that_begins_its_last_bin(bins: int) -> None:
    overview = Overview()
    events = EVENTS[:2].copy()
    events["t"], events["on"] = (0, bins * overview.bin_us), True
    overview.add(events)
    assert sum(overview.as_dict()["on"]) == 2


def test_a_damaged_recording_is_told(recording: Path) -> None:
    data = bytearray(recording.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 400] = b"\xff" * 400
    recording.write_bytes(data)
    player = Player(lambda: open_source(recording), "a test", WIDTH, HEIGHT, port=0)
    try:
        with pytest.raises(InputError, match=r"events\.aedat4"):
            player.wait(10)
        assert "events.aedat4" in player._status()["error"]
    finally:
        player.close()


def test_an_empty_recording_is_told(tmp_path: Path) -> None:
    (tmp_path / "empty.txt").write_text("# nothing\n")
    player = Player(lambda: open_source(tmp_path / "empty.txt"), "a test", WIDTH, HEIGHT, port=0)
    try:
        with pytest.raises(InputError, match="no events"):
            player.wait(10)
    finally:
        player.close()


class ListSink:
    def __init__(self) -> None:
        self.batches: list[EventBatch] = []
        self.closed = 0

    def write(self, batch: EventBatch, end_us: int) -> None:
        self.batches.append(batch.copy())

    def close(self) -> None:
        self.closed += 1


def test_pacing_loses_and_reorders_nothing_and_takes_its_time() -> None:
    sink = ListSink()
    events = EVENTS[EVENTS["t"] < 3_200_000]
    began_s = time.monotonic()
    pump = Pump(paced([events[:100], events[100:]], speed=2.0), sink)
    while not pump.wait(0.1):
        pass
    assert np.array_equal(np.concatenate(sink.batches), events) and sink.closed == 1
    assert pump.events == len(events) and pump.now_us == events["t"][-1]
    assert time.monotonic() - began_s >= int(events["t"][-1] - events["t"][0]) * 1e-6 / 2


def test_pacing_is_as_fast_as_asked() -> None:
    began_s = time.monotonic()
    assert sum(len(batch) for batch, _ in paced([EVENTS], speed=20.0)) == len(EVENTS)
    assert time.monotonic() - began_s < 1.5, "two seconds of events, twenty times as fast"


def test_a_pump_raises_what_the_source_raises_and_closes_the_sink() -> None:
    def broken() -> Iterator[tuple[EventBatch, int]]:
        yield EVENTS[:10], end_of(EVENTS[:10])
        raise InputError("events.txt: line 11 is torn")

    sink = ListSink()
    pump = Pump(broken(), sink)
    with pytest.raises(InputError, match="line 11"):
        while not pump.wait(0.1):
            pass
    assert len(sink.batches) == 1 and sink.closed == 1
