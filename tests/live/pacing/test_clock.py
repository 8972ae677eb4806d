import threading
import time

import pytest

from clsim.live.pacing.clock import FrameClock
from clsim.live.pacing.schedule import Schedule


def test_the_clock_tells_how_late_a_frame_is_begun() -> None:
    now_s = [100.0]
    clock = FrameClock(Schedule(10.0, 100, None), may_skip=False, clock=lambda: now_s[0])
    stopping = threading.Event()
    stopping.set()  # nothing is to wait in real time
    assert clock.wait_for(4, stopping) == 4 and clock.lag_s < 1e-9
    now_s[0] += 0.06  # 40 ms before the next is due
    assert clock.wait_for(5, stopping) == 5 and clock.lag_s < 1e-9
    now_s[0] += 0.09  # 50 ms after frame 5 was due, and before frame 6
    assert clock.wait_for(5, stopping) == 5
    assert (clock.lag_s, clock.late_frames) == (pytest.approx(0.05), 0)
    now_s[0] += 0.30
    assert clock.wait_for(6, stopping) == 6
    assert (clock.lag_s, clock.late_frames) == (pytest.approx(0.25), 1)
    assert clock.wait_for(7, stopping) == 7 and clock.late_frames == 2


def test_a_clock_that_may_skip_shows_what_is_due_and_never_beyond_the_end() -> None:
    now_s = [0.0]
    clock = FrameClock(Schedule(10.0, 100, 20), may_skip=True, clock=lambda: now_s[0])
    stopping = threading.Event()
    stopping.set()
    assert clock.wait_for(0, stopping) == 0
    now_s[0] = 0.75
    assert clock.wait_for(1, stopping) == 7 and (clock.skipped, clock.late_frames) == (6, 0)
    assert clock.lag_s == pytest.approx(0.05)
    now_s[0] = 60.0
    assert clock.wait_for(8, stopping) == 19 and clock.skipped == 6 + 11


def test_the_clock_waits_for_a_frame_that_is_not_due() -> None:
    clock = FrameClock(Schedule(20.0, 100, None), may_skip=False)
    stopping = threading.Event()
    clock.wait_for(3, stopping)
    begun = time.perf_counter()
    clock.wait_for(5, stopping)
    assert 0.05 < time.perf_counter() - begun < 5
