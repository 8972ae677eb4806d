"""Which frames a run has: counted, not copied."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from clsim.detect.config import DetectorConfig
from clsim.errors import InputError
from clsim.frames import Frame
from clsim.frames.exr import ExrWriter
from clsim.live.pacing.schedule import Continuity, Schedule, plan, truth_every
from clsim.live.recording_options import RecordingOptions
from clsim.live.session import open_recording


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


def test_less_than_half_a_frame_is_no_run() -> None:
    assert plan(1.0, 100.0, duration_s=0.006).total == 2
    with pytest.raises(InputError, match=r"`duration_s` must be at least half a frame, which is 0.005 s at 100 frames"):
        plan(1.0, 100.0, duration_s=0.004)


@pytest.mark.parametrize(("fps", "rate", "every"), [(100, 33.3333, 3), (100, None, 1), (240, 30, 8), (29.97, 29.97, 1)])
def test_a_rate_of_truth_may_be_rounded_by_hand(fps: float, rate: float | None, every: int) -> None:
    assert truth_every(fps, rate) == every


@pytest.mark.parametrize(("rate", "near"), [(33.4, "33.3333 and 50"), (140, "100"), (99.0, "50 and 100")])
def test_a_rate_of_truth_that_does_not_fit_names_those_that_do(rate: float, near: str) -> None:
    said = rf"`fps` \(100\) must be a multiple of `frame_rate`, got {rate:g}; the nearest that work: {near}$"
    with pytest.raises(InputError, match=said):
        truth_every(100.0, rate)


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


@pytest.mark.parametrize("asked", [(3,), (3, 4), (4, 9), (5,), (6, 10)])
def test_what_shall_begin_anew_does_so_at_the_first_frame_from_then_on(asked: tuple[int, ...]) -> None:
    seen = Continuity(Schedule(30.0, 100, None))
    for index in asked:
        seen.restart_at(index)
    shown = (0, 2, 5, 6, 10, 11)
    expected = [any(before < index <= now for index in asked) for before, now in zip((-1, *shown), shown, strict=False)]
    assert [seen.breaks(index) for index in shown] == expected


@pytest.mark.parametrize(("rendered", "runs_at"), [(60.0, 60.0), (None, 1e6 / 16_667), (60.5, 1e6 / 16_667)])
def test_a_recording_runs_at_the_rate_it_was_rendered_by(tmp_path, rendered, runs_at) -> None:
    """Times of frames are whole µs: they tell 60 a second as 59.9988. A rate that they do not fit is not believed."""
    writer = ExrWriter(tmp_path)
    for index, time_us in enumerate((1_000_000, 1_016_667, 1_033_333)):
        writer.write(Frame(np.ones((3, 4, 6), np.float32), ("R", "G", "B"), time_us, index))
    options = RecordingOptions(str(tmp_path), DetectorConfig(method="esim"), rendered_fps=rendered)
    session = open_recording(options)
    assert session.run().simulated_s == pytest.approx(0.033333), "from the first frame on, whenever that is"
    assert session.schedule.fps == runs_at
