"""Which frames a run has: counted, not copied."""

from fractions import Fraction

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from clsim.live.pacing.schedule import Continuity, Schedule, plan


@example(29, 100.0)  # .29 · 100 is less than 29
@example(4530, 29.97)
@given(st.integers(1, 5000), st.sampled_from([1.0, 24.0, 30.0, 60.0, 100.0, 120.0, 29.97, 240.0, 1000.0]))
def test_a_duration_of_so_many_frames_has_one_more(count: int, fps: float) -> None:
    """Whatever a time in seconds rounds to: .29 s at 100 frames a second are 30 frames, from 0 to .29 s."""
    schedule = plan(7.0, fps, duration_s=count / fps)
    assert schedule.total == count + 1
    last_us = schedule.time_us(count)
    assert abs(last_us - Fraction(count) / Fraction(fps) * 1_000_000) <= Fraction(1, 2) + Fraction(1, 1000)


def test_without_a_length_the_motion_is_played_once_and_in_a_loop_for_ever() -> None:
    assert plan(0.29, 100.0).total == 30
    assert plan(0.29, 100.0, loop=True).total is None
    assert plan(0.0, 100.0).total == 2, "where nothing moves, one step is left"
    assert plan(0.29, 100.0, frames=7).total == 7


@given(st.integers(1, 9), st.lists(st.integers(1, 25), min_size=1, max_size=12), st.booleans())
def test_a_seam_is_crossed_wherever_a_pass_ends_between_two_frames(ends: int, jumps: list[int], periodic: bool) -> None:
    """Frames in between may have been lost; where the end meets the start there is no seam."""
    schedule = Schedule(30.0, ends, None, loop=True, periodic=periodic)
    seen, index = Continuity(schedule), 0
    for jump in jumps:
        passed = any(k % ends == 0 for k in range(index + 1, index + jump + 1))
        index += jump
        assert seen.breaks(index) == (passed and not periodic)
        assert schedule.source_index(index) == index % ends


@pytest.mark.parametrize("asked", [(3,), (3, 4), (4, 9)])
def test_what_shall_begin_anew_does_so_at_the_first_frame_from_then_on(asked: tuple[int, ...]) -> None:
    seen = Continuity(Schedule(30.0, 100, None))
    for index in asked:
        seen.restart_at(index)
    shown = (0, 2, 5, 6, 10, 11)
    expected = [any(before < index <= now for index in asked) for before, now in zip((-1, *shown), shown, strict=False)]
    assert [seen.breaks(index) for index in shown] == expected
