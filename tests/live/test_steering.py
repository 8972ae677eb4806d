"""What goes back from the detector to the source: maps of interest, and a governor's effort."""

import threading
import time
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from clsim.events import EVENT_DTYPE, EventBatch
from clsim.frames import Frame, InterestBoard, InterestMap
from clsim.live.pacing.clock import FrameClock
from clsim.live.pacing.governed import WARM_UP_FRAMES, Governed
from clsim.live.pacing.ladder import Level, ladder
from clsim.live.pacing.load import BusyMeter
from clsim.live.pacing.schedule import Schedule, plan
from clsim.live.pipeline import Pipeline

NAMES = ("R", "G", "B")
BEST = Level(probe_spp=1, spp=8, first_hit_rays=16)


@dataclass(frozen=True)
class FakeEffort:
    probe_spp: int = 1
    spp: int = 8
    first_hit_rays: int = 16
    every: int = 1


class SteeredSource:
    """A source that reads the map of each frame, as a renderer with adaptive sampling does."""

    width, height, names, frame_count = 4, 3, NAMES, None

    def __init__(self, board: InterestBoard | None = None, fail_at: int | None = None, seconds: float = 0.0) -> None:
        self.board, self.fail_at, self.seconds = board, fail_at, seconds
        self.effort = FakeEffort()
        self.found: list[int | None] = []
        self.efforts: list[FakeEffort] = []
        self.filled: list[int] = []
        self.waiting = threading.Event()
        self.paths = self.first_hit_rays = 0
        self.light_s = 0.0

    def fill(self, index: int, out: Frame) -> None:
        if len(self.found) == self.fail_at:
            raise FloatingPointError("the source broke")
        self.efforts.append(self.effort)
        self.filled.append(index)
        time.sleep(self.seconds * (4 + self.effort.spp))
        self.waiting.set()
        interest = self.board.find(len(self.found)) if self.board is not None else None
        self.found.append(None if interest is None else interest.number)
        self.paths += 100
        self.first_hit_rays += 7

    def close(self) -> None:
        pass


class InterestedDetector:
    solved_share, masked, many_crossings, most_crossings, capped, lost = 0.0, 0, 0, 0, 0, 0

    @property
    def stats(self) -> "InterestedDetector":
        return self

    def __init__(self, fail_at: int | None = None, hang_at: int | None = None, first_seconds: float = 0.0) -> None:
        self.fail_at, self.hang_at, self.first_seconds = fail_at, hang_at, first_seconds
        self.go_on = threading.Event()
        self.frames = self.resets = 0
        self.reset_before: list[int] = []

    def step(self, frame: Frame) -> EventBatch:
        if self.frames == self.fail_at:
            raise ArithmeticError("the detector broke")
        if self.frames == self.hang_at:
            self.go_on.wait(60)
        if self.frames == 0:
            time.sleep(self.first_seconds)
        self.frames += 1
        return np.zeros(0, EVENT_DTYPE)

    def interest(self) -> InterestMap:
        plane = np.zeros((3, 4), np.float32)
        return InterestMap(self.frames - 1, plane, plane, plane, plane)

    def reset(self) -> None:
        self.resets += 1
        self.reset_before.append(self.frames)

    def close(self) -> None:
        pass


def adaptive(schedule: Schedule, source: SteeredSource, detector: InterestedDetector, **options: object) -> Pipeline:
    return Pipeline(
        lambda: source,
        lambda: detector,
        (),
        schedule,
        (NAMES, 3, 4),
        board=source.board,
        **options,  # type: ignore[arg-type]
    )


def left_threads() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("clsim-")]


def no_threads_left() -> bool:
    return not left_threads()


@pytest.mark.parametrize("slots", [2, 3, 5])
def test_each_frame_is_made_with_the_map_of_two_frames_ago(slots: int) -> None:
    source, detector = SteeredSource(InterestBoard("wait")), InterestedDetector()
    pipeline = adaptive(plan(1.0, 60.0, frames=40), source, detector, slots=slots)
    pipeline.start()
    assert pipeline.wait(20)
    assert source.found == [None, None, *range(38)]
    assert (pipeline.progress.paths, pipeline.progress.first_hit_rays) == (4000, 280)


def test_maps_are_counted_on_over_the_seam_of_a_loop() -> None:
    source, detector = SteeredSource(InterestBoard("wait")), InterestedDetector()
    pipeline = adaptive(plan(0.5, 10.0, frames=12, loop=True), source, detector)
    pipeline.start()
    assert pipeline.wait(20)
    assert detector.resets == 2 and source.found == [None, None, *range(10)]


def test_stop_ends_a_source_that_waits_for_a_map() -> None:
    """The detector hangs, in a compiler say; the source must not hang with it."""
    source, detector = SteeredSource(InterestBoard("wait")), InterestedDetector(hang_at=3)
    pipeline = adaptive(plan(1.0, 60.0, loop=True), source, detector)
    pipeline.start()
    while len(source.found) < 5:
        assert not pipeline.wait(0.005)
    assert not pipeline.wait(0.1)
    assert not pipeline.stop(0.3), "the detector's thread hangs on"
    deadline = time.monotonic() + 20  # far before the detector's thread would go on by itself
    while left_threads() != ["clsim-detect"] and time.monotonic() < deadline:
        time.sleep(0.005)
    assert left_threads() == ["clsim-detect"]
    detector.go_on.set()
    assert pipeline.wait(20) and no_threads_left()


def test_an_error_of_the_detector_ends_a_source_that_waits_for_a_map() -> None:
    source, detector = SteeredSource(InterestBoard("wait")), InterestedDetector(fail_at=5)
    pipeline = adaptive(plan(1.0, 60.0, loop=True), source, detector)
    pipeline.start()
    with pytest.raises(ArithmeticError, match="the detector broke"):
        pipeline.wait(20)
    assert no_threads_left()


def test_an_error_of_the_source_ends_the_detector() -> None:
    source, detector = SteeredSource(InterestBoard("wait"), fail_at=6), InterestedDetector()
    pipeline = adaptive(plan(1.0, 60.0, loop=True), source, detector)
    pipeline.start()
    with pytest.raises(FloatingPointError, match="the source broke"):
        pipeline.wait(20)
    assert no_threads_left()


def test_frames_may_be_dropped_between_a_steered_source_and_its_detector() -> None:
    source, detector = SteeredSource(InterestBoard("newest")), InterestedDetector(first_seconds=0.1)
    pipeline = adaptive(plan(1.0, 100.0, frames=60), source, detector, ring="drop-oldest", pace="real")
    pipeline.start()
    assert pipeline.wait(20)
    assert pipeline.progress.frames + pipeline.progress.dropped_frames == 60
    assert source.found[-1] is not None


@pytest.mark.parametrize("ring", ["block", "drop-oldest"])
def test_the_clock_starts_when_all_kernels_were_loaded(ring: str, monkeypatch: pytest.MonkeyPatch) -> None:
    source, detector = (
        SteeredSource(InterestBoard("wait" if ring == "block" else "newest")),
        InterestedDetector(first_seconds=0.1),
    )
    started: list[tuple[int, int]] = []
    start = FrameClock.start

    def note(clock: FrameClock, index: int) -> None:
        started.append((index, detector.frames))
        start(clock, index)

    monkeypatch.setattr(FrameClock, "start", note)
    pipeline = adaptive(plan(1.0, 100.0, frames=10), source, detector, ring=ring, pace="real")
    pipeline.start()
    assert pipeline.wait(20)
    assert started == [(WARM_UP_FRAMES, WARM_UP_FRAMES)]


def test_a_paced_run_ends_where_its_detector_breaks_in_the_warm_up() -> None:
    pipeline = adaptive(
        plan(1.0, 5.0), SteeredSource(InterestBoard("wait")), InterestedDetector(fail_at=1), pace="real"
    )
    pipeline.start()
    with pytest.raises(ArithmeticError):
        pipeline.wait(20)
    assert no_threads_left()


def test_frames_that_come_late_are_counted_where_none_is_dropped() -> None:
    pipeline = adaptive(
        plan(1.0, 200.0, frames=24),
        SteeredSource(InterestBoard("wait"), seconds=0.002),
        InterestedDetector(),
        pace="real",
    )
    pipeline.start()
    assert pipeline.wait(20)
    assert pipeline.progress.frames == 24 and pipeline.progress.late_frames > 10


def test_a_governor_renders_less_where_a_paced_run_would_be_late() -> None:
    """All samples would take 72 ms a frame, and there are 50."""
    source, governed = SteeredSource(InterestBoard("wait"), seconds=0.006), Governed(ladder(BEST), 20.0)
    pipeline = adaptive(plan(1.0, 20.0, frames=24), source, InterestedDetector(), pace="real", governed=governed)
    pipeline.start()
    assert pipeline.wait(20)
    assert source.efforts[0] == FakeEffort(), "the references are rendered as well as can be"
    assert {effort.spp for effort in source.efforts[WARM_UP_FRAMES:]} <= {1, 2}
    assert governed.level.spp <= 2
    assert governed.given_up.startswith("samples 8 -> ")
    assert governed.summary()["level"] == governed.levels.index(governed.level) > 0


def test_the_frames_of_the_warm_up_tell_where_to_start() -> None:
    source, governed = SteeredSource(), Governed(ladder(BEST), 10.0)
    for busy_s in (9.0, 5.0, 0.042):
        governed.frame_done(busy_s, lag_s=0.0)
        assert not governed.apply(source)
        assert source.effort == FakeEffort(probe_spp=1, spp=1, first_hit_rays=16, every=1)
    governed.frame_done(0.06, lag_s=0.0)
    predicted = [0.042 * level.cost / governed.levels[3].cost for level in governed.levels]
    assert governed.governor.level == next(i for i, seconds in enumerate(predicted) if seconds <= 0.06)
    assert 0 < governed.governor.level < 3
    assert not governed.apply(source) and source.effort.spp == governed.level.spp
    assert governed.summary()["changes"] == 0


def test_frames_are_left_out_where_there_is_no_time_for_them_but_never_the_last() -> None:
    """Eighteen in nineteen, once the warm-up has told; a frame may then take as long as nineteen."""
    source, detector = SteeredSource(), InterestedDetector()
    governed = Governed(ladder(BEST, 200.0)[:1] + ladder(BEST, 200.0)[-1:], 200.0)
    busy_s = iter([0.02] * WARM_UP_FRAMES + [0.03] * 100)
    governed.frame_done = lambda _, lag_s: Governed.frame_done(governed, next(busy_s), lag_s)  # type: ignore[method-assign]
    pipeline = adaptive(plan(1.0, 200.0, frames=200), source, detector, pace="real", governed=governed)
    pipeline.start()
    assert pipeline.wait(20)
    assert source.filled[:WARM_UP_FRAMES] == [0, 1, 2, 3] and source.filled[-1] == 199
    steps = np.diff(source.filled[WARM_UP_FRAMES + 3 :])
    assert governed.levels[-1].one_in == 19 and set(steps[:-1]) == {19} and 1 <= steps[-1] <= 19
    assert not governed.governor.too_slow
    assert governed.given_up.startswith("18 of 19 frames, ")


def test_nothing_fires_where_other_first_hit_rays_change_a_still_picture() -> None:
    """The detector is reset for the very frame; samples change without."""
    source, detector = SteeredSource(), InterestedDetector()
    governed = Governed(ladder(BEST), 1e-3)  # 1000 s a frame: everything fits
    pipeline = adaptive(plan(1.0, 1000.0, frames=20), source, detector, pace="real", governed=governed)
    budget_s = iter([0.01] * WARM_UP_FRAMES + [2000.0] * 100)
    governed.frame_done = lambda busy_s, lag_s: Governed.frame_done(governed, next(budget_s), lag_s)  # type: ignore[method-assign]
    pipeline.start()
    assert pipeline.wait(20)
    rays = [effort.first_hit_rays for effort in source.efforts]
    changes = [k for k in range(1, 20) if rays[k] != rays[k - 1]]
    assert changes and rays[-1] == 8
    assert detector.reset_before == changes
    assert governed.summary()["restarts"] == len(changes)


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_the_time_of_a_frame_is_that_in_which_anybody_works() -> None:
    clock = Clock()
    meter = BusyMeter(clock=clock)
    with meter.busy("source"):
        clock.now = 2.0
    clock.now = 10.0  # both wait
    with meter.busy("detector"):
        clock.now = 13.0
    assert meter.lap() == 5.0
    with meter.busy("source"):
        clock.now = 14.0
        with meter.busy("detector"):
            clock.now = 16.0
        assert meter.lap() == 3.0
        clock.now = 17.0
    assert meter.lap() == 1.0
    assert meter.lap() == 0.0


def test_with_cores_of_their_own_it_is_the_time_of_the_slower_one() -> None:
    clock = Clock()
    meter = BusyMeter(share_cores=False, clock=clock)
    with meter.busy("source"):
        clock.now = 2.0
    with meter.busy("detector"):
        clock.now = 5.0
    with meter.busy("source"):
        clock.now = 5.5
        assert meter.lap() == 3.0
        clock.now = 6.0
    assert meter.lap() == 0.5


def test_noise_is_told_by_pixels_without_a_past_where_their_samples_become_others() -> None:
    """As the detector takes that frame for a first one, so does what compares pixels that are sampled twice."""
    source, detector, seen = SteeredSource(), InterestedDetector(), []
    source.sampled_twice = lambda frame: len(source.filled)
    changes = iter([False, False, False, True, False, False])
    governed = SimpleNamespace(one_in=1, apply=lambda source: next(changes), frame_done=lambda *args, **more: None)
    twice = SimpleNamespace(take=lambda frame, _: seen.append(frame), restart=lambda: seen.append("anew"))
    twice.noise_share = 0.25
    pipeline = adaptive(plan(1.0, 20.0, frames=6), source, detector, governed=governed, duplicates=twice)
    pipeline.start()
    assert pipeline.wait(20)
    assert seen == [1, 2, 3, "anew", 4, 5, 6] and detector.reset_before == [3]
    assert pipeline.progress.noise_share == 0.25
