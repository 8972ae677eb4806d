import threading
import time

import numpy as np
import pytest

from clsim.frames import FrameRing, RingClosed


def ring_of(slots: int, policy: str = "block") -> FrameRing:
    return FrameRing(slots, ("R", "G"), 3, 5, policy)  # type: ignore[arg-type]


def produce(ring: FrameRing, index: int) -> None:
    frame = ring.acquire()
    frame.index = index
    frame.planes[...] = index
    ring.publish()


def drain(ring: FrameRing) -> list[int]:
    seen = []
    while True:
        try:
            frame = ring.take()
        except RingClosed:
            return seen
        assert frame is not None and (frame.planes == frame.index).all()
        seen.append(frame.index)
        ring.release()


def test_slots_start_on_pages_and_share_no_memory() -> None:
    frames = ring_of(3).frames
    for frame in frames:
        assert frame.planes.ctypes.data % 4096 == 0
    assert not np.shares_memory(frames[0].planes, frames[1].planes)


def test_block_loses_nothing_across_threads() -> None:
    ring = ring_of(2)

    def run() -> None:
        for index in range(200):
            produce(ring, index)
        ring.close()

    thread = threading.Thread(target=run)
    thread.start()
    assert drain(ring) == list(range(200))
    thread.join()
    assert ring.dropped == 0


def test_drop_oldest_never_waits_and_counts() -> None:
    ring = ring_of(3, "drop-oldest")
    for index in range(10):
        produce(ring, index)
    ring.close()
    assert drain(ring) == [7, 8, 9]
    assert ring.dropped == 7


def test_drop_oldest_spares_the_frame_being_read() -> None:
    ring = ring_of(3, "drop-oldest")
    produce(ring, 0)
    held = ring.take()
    assert held is not None
    for index in range(1, 8):
        produce(ring, index)
    assert held.index == 0 and (held.planes == 0).all()
    ring.release()
    ring.close()
    assert drain(ring) == [6, 7]


def test_take_times_out() -> None:
    began = time.monotonic()
    assert ring_of(2).take(timeout_s=0.01) is None and time.monotonic() - began < 0.6


def test_abandon_wakes_a_waiting_producer() -> None:
    ring = ring_of(2)
    ended = threading.Event()

    def run() -> None:
        try:
            for index in range(100):
                produce(ring, index)
        except RingClosed:
            ended.set()

    thread = threading.Thread(target=run)
    thread.start()
    ring.abandon()
    thread.join(5)
    assert ended.is_set()


def test_frames_that_wait_are_not_taken_any_more_once_one_side_stops() -> None:
    ring = ring_of(2)
    produce(ring, 0)
    ring.abandon()
    with pytest.raises(RingClosed):
        ring.take()


def test_failure_reaches_the_other_side() -> None:
    ring = ring_of(2)
    ring.fail(KeyError("lost"))
    with pytest.raises(KeyError, match="lost"):
        ring.take()
    with pytest.raises(KeyError, match="lost"):
        ring.acquire()


@pytest.mark.parametrize(("policy", "slots"), [("block", 1), ("drop-oldest", 2)])
def test_too_few_slots_are_refused(policy: str, slots: int) -> None:
    with pytest.raises(ValueError, match="slots"):
        ring_of(slots, policy)


def test_misuse_is_refused() -> None:
    ring = ring_of(2)
    with pytest.raises(RuntimeError):
        ring.publish()
    with pytest.raises(RuntimeError):
        ring.release()
    ring.acquire()
    with pytest.raises(RuntimeError):
        ring.acquire()
