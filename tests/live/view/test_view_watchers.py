"""What waits for a browser: never more than is bounded, and what is dropped is counted."""

import asyncio

import pytest
from hypothesis import given
from hypothesis import strategies as st

from clsim.live.view import hub as hub_module
from clsim.live.view.hub import Hub, Watcher
from tests.live.view.view_events import random_events


def test_a_watcher_is_sent_no_more_than_it_confirms() -> None:
    watcher = Watcher()
    for k in range(100):
        watcher.put(bytes([k]), 1)
    sent = []
    while (packet := watcher.next_packet()) is not None:
        sent.append(packet[0])
    assert sent == list(range(hub_module.UNSEEN_PACKETS))
    watcher.seen = 10
    assert watcher.next_packet() == bytes([hub_module.UNSEEN_PACKETS])


def test_a_watchers_queue_is_bounded_and_drops_the_oldest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hub_module, "QUEUE_EVENTS", 100)
    watcher, hub = Watcher(), Hub(asyncio.new_event_loop())
    hub.watchers.add(watcher)
    for k in range(50):
        watcher.put(bytes([k]), 10)
    assert watcher.waiting_events == 100 and watcher.dropped_events == 400 == hub.dropped_events
    assert watcher.missed_events == 400
    assert watcher.next_packet() == bytes([40])
    for _ in range(3 * hub_module.QUEUE_PACKETS):
        watcher.put(b"", 0)
    assert len(watcher._packets) == hub_module.QUEUE_PACKETS
    lost = watcher.dropped_events
    watcher.clear()
    assert watcher.missed_events == 0 and watcher.dropped_events == lost  # a jump begins a new count for the page
    hub.leave(watcher)
    assert hub.dropped_events == lost == 490  # still counted when the browser has gone
    hub._loop.close()


@pytest.mark.parametrize("jumps", [False, True])
def test_what_was_lost_before_a_jump_is_not_missed_after_it(jumps: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hub_module, "QUEUE_EVENTS", 100)
    watcher, hub = Watcher(), Hub(asyncio.new_event_loop())
    hub.watchers.add(watcher)
    hub.offer(random_events(150, 4, 4, begin_us=0, end_us=1000), 1000)
    if jumps:
        hub.seek(5000)
    hub._flush()
    assert watcher.missed_events == (0 if jumps else 50)
    hub._loop.close()


def test_a_large_packet_pushes_out_as_many_small_ones_as_it_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hub_module, "QUEUE_EVENTS", 100)
    watcher = Watcher()
    for k in range(10):
        watcher.put(bytes([k]), 10)
    watcher.put(b"large", 75)
    assert watcher.waiting_events == 95 and watcher.dropped_events == 80
    assert [watcher.next_packet() for _ in range(4)] == [bytes([8]), bytes([9]), b"large", None]


@given(st.lists(st.one_of(st.integers(0, 150), st.sampled_from(["send", "jump"])), max_size=25))
def test_whatever_comes_goes_and_jumps_what_waits_is_counted_right(happens: list[int | str]) -> None:
    """A count that outlived a jump would push out packets for which there is room."""
    watcher, waiting, dropped, missed = Watcher(), [], 0, 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hub_module, "QUEUE_EVENTS", 200)
        for each in happens:
            if each == "jump":
                watcher.clear()
                waiting, missed = [], 0
            elif each == "send":
                watcher.seen = watcher.sent
                assert watcher.next_packet() == (bytes([waiting.pop(0)]) if waiting else None)
            else:
                watcher.put(bytes([each]), each)
                waiting.append(each)
                while sum(waiting) > 200:
                    lost = waiting.pop(0)
                    dropped, missed = dropped + lost, missed + lost
            assert watcher.waiting_events == sum(waiting)
            assert (watcher.dropped_events, watcher.missed_events) == (dropped, missed)
