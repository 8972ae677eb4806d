import os
import signal
import threading
import time
from pathlib import Path

import pytest

from clsim.errors import InputError
from clsim.events import Causes, EventBatch, SinkError
from clsim.events.sidecar import sidecar_path
from clsim.frames import Frame
from clsim.live.outputs.delivery import Output
from clsim.live.pacing.schedule import Continuity, Schedule, plan
from clsim.live.pipeline import Pipeline
from tests.live.small_pipeline import NAMES, CountingSource, ListSink, OneEventDetector, run


def test_every_frame_passes_once_and_in_order() -> None:
    sink = ListSink()
    pipeline, source, detector = run(plan(1.0, 60.0, frames=20), sinks=(sink,))
    pipeline.start()
    assert pipeline.wait(10)
    assert [int(b["x"][0]) for b in sink.batches] == list(range(20))
    assert detector.steps[-1] == (19, round(19e6 / 60))
    assert source.closed and detector.closed and sink.closed == 1
    progress = pipeline.progress
    assert (progress.frames, progress.events, progress.on_events, progress.solved_share) == (20, 20, 5, 0.25)


def test_a_jumping_loop_runs_time_on_and_resets_at_the_seam() -> None:
    pipeline, source, detector = run(plan(0.5, 10.0, duration_s=1.2, loop=True))
    pipeline.start()
    assert pipeline.wait(10)
    assert source.filled == [0, 1, 2, 3, 4, 0, 1, 2, 3, 4, 0, 1, 2]
    assert [time_us for _, time_us in detector.steps] == [k * 100_000 for k in range(13)]
    assert detector.resets == [5, 10]


def test_a_periodic_loop_is_not_reset() -> None:
    pipeline, _, detector = run(plan(0.5, 10.0, frames=12, loop=True, periodic=True))
    pipeline.start()
    assert pipeline.wait(10)
    assert detector.resets == []


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (SinkError("disk.txt: no space left"), "disk.txt: no space left"),
        (InputError("a.dat: event time 4294967296 µs is too late"), "a.dat: event time 4294967296 µs is too late"),
        (OSError("no such device"), "no such device"),
        (ZeroDivisionError("oops"), "sink 1: ZeroDivisionError('oops')"),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, Exception) else "",
)
def test_a_failing_sink_ends_alone(error: Exception, told: str) -> None:
    """The one before it and the one after it get every batch, that of the failure too."""
    before, bad, after = ListSink(), ListSink(3, error), ListSink()
    pipeline, _, _ = run(plan(1.0, 10.0), sinks=(before, bad, after))
    pipeline.start()
    assert pipeline.wait(10)
    assert len(before.batches) == len(after.batches) == 11 and len(bad.batches) == 3
    assert [output.error for output in pipeline.outputs] == [None, told, None]
    assert before.closed == bad.closed == after.closed == 1


@pytest.mark.parametrize("error", [SinkError("x"), InputError("x"), ZeroDivisionError("x")])
def test_a_sink_that_cannot_close_leaves_no_other_open(error: Exception) -> None:
    class Torn(ListSink):
        def close(self) -> None:
            super().close()
            raise error

    first, torn, last = ListSink(), Torn(), ListSink()
    pipeline, _, _ = run(plan(1.0, 10.0, frames=3), sinks=(first, torn, last))
    pipeline.start()
    assert pipeline.wait(10)
    assert (first.closed, torn.closed, last.closed) == (1, 1, 1)
    assert [output.error is None for output in pipeline.outputs] == [True, False, True]


@pytest.mark.parametrize("stalls", ["write", "close"])
def test_a_stalled_sink_does_not_hold_up_the_end(stalls: str) -> None:
    """The others are closed all the same, with all they were given, and a second Ctrl-C changes nothing."""
    released, stalled = threading.Event(), threading.Event()

    class Stalled(ListSink):
        def write(self, batch: EventBatch, end_us: int) -> None:
            super().write(batch, end_us)
            if stalls == "write" and len(self.batches) == 3:
                stalled.set()
                released.wait(20)

        def close(self) -> None:
            released.wait(20)

    first, stuck, last = ListSink(), Stalled(), ListSink()
    pipeline, _, _ = run(plan(1.0, 10.0, loop=True), CountingSource(seconds=0.001), (first, stuck, last))
    pipeline.start()
    try:
        if stalls == "write":
            assert stalled.wait(10)
        else:
            pipeline.wait(0.05)
        begun = time.monotonic()
        threading.Timer(0.2, signal.raise_signal, (signal.SIGINT,)).start()
        assert not pipeline.stop()
        assert time.monotonic() - begun < 1.0
        assert (first.closed, last.closed) == (1, 1)
        assert [output.closed for output in pipeline.outputs] == [True, False, True]
        assert "takes no more events" in (pipeline.outputs[1].error or "")
        assert pipeline.outputs[0].error is pipeline.outputs[2].error is None
    finally:
        released.set()


def test_recorders_get_each_frame_with_the_events_of_its_step() -> None:
    class Recorder(ListSink):
        planes = ("R",)

        def __init__(self, fail_after: int | None = None) -> None:
            super().__init__(fail_after)
            self.seen: list[tuple[int, float, int]] = []

        def record(self, frame: Frame, events: EventBatch, causes: Causes | None = None) -> None:
            super().write(events, frame.time_us)
            self.seen.append((frame.time_us, float(frame.plane("R")[0, 0]), int(events["x"][0])))

        def write(self, batch: EventBatch, end_us: int) -> None:
            raise AssertionError("a recorder's events come with their frame")

    class DepthRecorder(Recorder):
        planes = ("R", "Depth")

    plain, recorder, failing, lacking = ListSink(), Recorder(), Recorder(fail_after=2), DepthRecorder()
    pipeline, _, _ = run(plan(1.0, 10.0, frames=4), sinks=(failing, plain, recorder, lacking))
    pipeline.start()
    assert pipeline.wait(10)
    assert recorder.seen == [(100_000 * k, k, k) for k in range(4)]
    assert len(plain.batches) == 4 and len(failing.seen) == 2 and not lacking.seen
    assert [output.error is None for output in pipeline.outputs] == [False, True, True, False]
    assert "records Depth, but frames have R, G, B" in str(pipeline.outputs[3].error)


def test_a_broken_detector_stops_a_source_that_waits_for_the_clock() -> None:
    class Broken(OneEventDetector):
        def step(self, frame: Frame) -> EventBatch:
            if frame.index == 4:
                raise FloatingPointError("the detector broke")
            return super().step(frame)

    source = CountingSource()
    pipeline = Pipeline(lambda: source, Broken, [], plan(1e6, 0.05), (NAMES, 3, 4), pace="real")
    pipeline.start()
    begun = time.monotonic()
    with pytest.raises(FloatingPointError, match="the detector broke"):
        pipeline.wait(10)
    assert time.monotonic() - begun < 5 and source.closed and source.cancelled


def test_noise_goes_on_where_the_motion_restarts() -> None:
    class Noisy(CountingSource):
        noise_offset = 0

        def fill(self, index: int, out: Frame) -> None:
            super().fill(index, out)
            numbers.append(index + self.noise_offset)

    numbers: list[int] = []
    pipeline, source, _ = run(plan(0.3, 10.0, frames=8, loop=True), Noisy())
    pipeline.start()
    assert pipeline.wait(10)
    assert source.filled == [0, 1, 2, 0, 1, 2, 0, 1] and numbers == list(range(8))


def test_a_seam_counts_though_its_frames_were_dropped() -> None:
    jumps = Continuity(Schedule(10.0, 5, None, loop=True))
    assert [jumps.breaks(index) for index in (0, 3, 4, 7, 8, 9, 16)] == [False, False, False, True, False, False, True]
    assert not any(map(Continuity(Schedule(10.0, 5, None, loop=True, periodic=True)).breaks, (0, 3, 7, 16)))


def test_a_restart_counts_though_its_frame_was_dropped() -> None:
    continuity = Continuity(Schedule(10.0, 5, 100))
    continuity.restart_at(6)
    continuity.restart_at(7)
    continuity.restart_at(20)
    assert [continuity.breaks(index) for index in (4, 5, 9, 10, 20, 21)] == [False, False, True, False, True, False]


def test_when_every_sink_has_failed_the_run_ends() -> None:
    pipeline, source, _ = run(plan(1e6, 10.0), sinks=(ListSink(fail_after=0),))
    pipeline.start()
    with pytest.raises(SinkError, match="no space left"):
        pipeline.wait(10)
    assert source.closed


def test_a_failing_source_ends_the_run_with_its_error() -> None:
    sink = ListSink()
    pipeline, _, detector = run(plan(1e6, 10.0), CountingSource(fail_at=4), sinks=(sink,))
    pipeline.start()
    with pytest.raises(FloatingPointError, match="the source broke"):
        pipeline.wait(10)
    assert sink.closed == 1 and detector.closed


def test_stop_ends_an_endless_run_and_closes_the_sinks() -> None:
    sink = ListSink()
    pipeline, source, _ = run(plan(1.0, 10.0, loop=True), CountingSource(seconds=0.001), sinks=(sink,))
    pipeline.start()
    assert not pipeline.wait(0.05)
    assert pipeline.stop()
    assert source.cancelled and source.closed and sink.closed == 1
    assert pipeline.wait(1)


def test_stop_before_start_is_harmless() -> None:
    pipeline, _, _ = run(plan(1.0, 10.0))
    assert pipeline.stop()


def test_real_pace_with_drops_shows_the_frame_that_is_due() -> None:
    """Some are left out by the clock, and some of those rendered are lost to a slow detector: all are counted."""
    pipeline, source, detector = run(
        plan(1.0, 500.0, frames=100), CountingSource(seconds=0.005), ring="drop-oldest", pace="real"
    )
    step = detector.step
    detector.step = lambda frame: (time.sleep(0.02), step(frame))[1]  # type: ignore[method-assign]
    pipeline.start()
    assert pipeline.wait(20)
    assert source.filled == sorted(set(source.filled)) and source.filled[-1] == 99
    assert pipeline.progress.dropped_frames + pipeline.progress.frames == 100
    assert 0 < len(detector.steps) < len(source.filled) < 100


def test_real_pace_never_runs_ahead_of_the_clock() -> None:
    """The first frames, which load kernels, wait for nothing."""
    begun_s: list[float] = []

    class Timed(CountingSource):
        def fill(self, index: int, out: Frame) -> None:
            begun_s.append(time.perf_counter())
            super().fill(index, out)

    pipeline, _, _ = run(plan(1.0, 20.0, frames=12), Timed(), pace="real")
    pipeline.start()
    assert pipeline.wait(20)
    # Frame 4 was due at some time after frame 3 began; it may have begun late.
    assert all(begun_s[k] - begun_s[3] >= (k - 4) / 20 - 1e-3 for k in range(5, 12))
    assert pipeline.progress.dropped_frames == 0


def test_both_threads_end() -> None:
    pipeline, _, _ = run(plan(1.0, 10.0))
    pipeline.start()
    pipeline.wait(10)
    assert not [t for t in threading.enumerate() if t.name.startswith("clsim-")]


def test_the_motion_is_played_once_by_default() -> None:
    assert plan(2.0, 120.0).total == 241
    assert plan(2.0, 120.0, duration_s=0.5).total == 61
    assert plan(2.0, 120.0, loop=True).total is None
    assert plan(2.0, 120.0, frames=24).total == 24


def test_each_watcher_gets_the_frames_it_wants() -> None:
    class Watcher:
        def __init__(self, wants: bool) -> None:
            self.wants, self.times_us = wants, []

        def wants_frame(self) -> bool:
            return self.wants

        def show_frame(self, frame: Frame, level: object) -> None:
            self.times_us.append(frame.time_us)

    pipeline, _, _ = run(plan(1.0, 10.0, frames=3))
    pipeline.watchers += [Watcher(True), Watcher(False), Watcher(True)]
    pipeline.start()
    assert pipeline.wait(10)
    assert [watcher.times_us for watcher in pipeline.watchers] == [[0, 100_000, 200_000], [], [0, 100_000, 200_000]]


def test_ctrl_c_while_a_sink_closes_still_closes_all() -> None:
    """The first interrupt may come while a socket waits for its readers; no file may be left open by it."""

    class Patient(ListSink):
        flushed_briefly = False

        def close(self) -> None:
            super().close()
            if not self.flushed_briefly:
                raise KeyboardInterrupt

        def flush_briefly(self) -> None:
            self.flushed_briefly = True

    patient, first, last = Patient(), ListSink(), ListSink()
    pipeline, _, _ = run(plan(1.0, 10.0, frames=3), sinks=(first, patient, last))
    pipeline.start()
    with pytest.raises(KeyboardInterrupt):
        while not pipeline.wait(1):
            pass
    assert (first.closed, last.closed) == (0, 1)
    assert pipeline.stop()
    assert (first.closed, patient.closed, last.closed) == (1, 2, 1)
    assert patient.flushed_briefly


@pytest.mark.parametrize(
    ("name", "completed"), [("events.npz", True), ("pipe", False), ("tcp://127.0.0.1:7777", False)]
)
def test_a_file_is_completed_however_long_that_takes_and_a_reader_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, completed: bool
) -> None:
    class Slow(ListSink):
        def close(self) -> None:
            time.sleep(0.3)
            super().close()

    monkeypatch.setattr("clsim.live.pipeline._CLOSING_S", 0.05)
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    output = Output(name, Slow(), sidecar=sidecar_path(name))
    pipeline = Pipeline(CountingSource, OneEventDetector, [output], plan(1.0, 60.0, frames=9), (NAMES, 3, 4))
    pipeline.start()
    assert pipeline.stop(0.1) == completed
    assert (output.error is None) == (output.sink.closed == 1) == completed


def test_what_breaks_because_the_run_is_stopped_is_no_error() -> None:
    class Torn(CountingSource):
        def __init__(self) -> None:
            super().__init__()
            self.working, self.torn = threading.Event(), threading.Event()

        def fill(self, index: int, out: Frame) -> None:
            self.working.set()
            self.torn.wait(20)
            raise FloatingPointError("torn from its work")

        def cancel(self) -> None:
            self.torn.set()

    source = Torn()
    pipeline = Pipeline(lambda: source, OneEventDetector, (), plan(1.0, 60.0, frames=9), (NAMES, 3, 4))
    pipeline.start()
    assert source.working.wait(20)
    pipeline.stop()
    assert pipeline.wait(20)
