import threading
import time

import numpy as np
import pytest

from clsim.events import EVENT_DTYPE, EventBatch, SinkError
from clsim.frames import Frame
from clsim.live.pipeline import Output, Pipeline
from clsim.live.schedule import Schedule, plan

NAMES = ("R", "G", "B")


class CountingSource:
    width, height, names, frame_count = 4, 3, NAMES, None

    def __init__(self, fail_at: int | None = None, seconds: float = 0.0) -> None:
        self.fail_at, self.seconds = fail_at, seconds
        self.filled: list[int] = []
        self.closed = self.cancelled = False

    def fill(self, index: int, out: Frame) -> None:
        if index == self.fail_at:
            raise FloatingPointError("the source broke")
        time.sleep(self.seconds)
        out.planes[...] = index
        self.filled.append(index)

    def cancel(self) -> None:
        self.cancelled = True

    def close(self) -> None:
        self.closed = True


class OneEventDetector:
    """Fires one event a frame, whose x is the source's frame index."""

    solved_share, masked, many_crossings, most_crossings, capped = 0.25, 0, 0, 0, 0

    @property
    def stats(self) -> "OneEventDetector":
        return self

    def __init__(self) -> None:
        self.resets: list[int] = []
        self.steps: list[tuple[int, int]] = []
        self.closed = False

    def step(self, frame: Frame) -> EventBatch:
        self.steps.append((frame.index, frame.time_us))
        batch = np.zeros(1, EVENT_DTYPE)
        batch["t"], batch["x"] = frame.time_us, int(frame.planes[0, 0, 0])
        return batch

    def reset(self) -> None:
        self.resets.append(len(self.steps))

    def close(self) -> None:
        self.closed = True


class ListSink:
    def __init__(self, fail_after: int | None = None) -> None:
        self.batches: list[EventBatch] = []
        self.fail_after = fail_after
        self.closed = 0

    def write(self, batch: EventBatch, end_us: int) -> None:
        if self.fail_after is not None and len(self.batches) >= self.fail_after:
            raise SinkError("disk.txt: no space left")
        self.batches.append(batch.copy())

    def close(self) -> None:
        self.closed += 1


def run(schedule: Schedule, source: CountingSource | None = None, sinks: tuple[ListSink, ...] = (), **options: object):
    source, detector = source or CountingSource(), OneEventDetector()
    outputs = [Output(f"sink {i}", sink) for i, sink in enumerate(sinks)]
    pipeline = Pipeline(
        lambda: source,
        lambda: detector,
        outputs,
        schedule,
        (NAMES, 3, 4),
        **options,  # type: ignore[arg-type]
    )
    return pipeline, source, detector


def test_every_frame_passes_once_and_in_order() -> None:
    sink = ListSink()
    pipeline, source, detector = run(plan(1.0, 60.0, frames=20), sinks=(sink,))
    pipeline.start()
    assert pipeline.wait(10)
    assert [int(b["x"][0]) for b in sink.batches] == list(range(20))
    assert detector.steps[-1] == (19, round(19e6 / 60))
    assert source.closed and detector.closed and sink.closed == 1
    progress = pipeline.progress
    assert (progress.frames, progress.events, progress.solved_share) == (20, 20, 0.25)


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


def test_a_failing_sink_does_not_stop_the_others() -> None:
    good, bad = ListSink(), ListSink(fail_after=3)
    pipeline, _, _ = run(plan(1.0, 10.0), sinks=(bad, good))
    pipeline.start()
    assert pipeline.wait(10)
    assert len(good.batches) == 11 and len(bad.batches) == 3
    assert pipeline.outputs[0].error == "disk.txt: no space left" and pipeline.outputs[1].error is None
    assert good.closed == bad.closed == 1


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
    pipeline, source, _ = run(
        plan(1.0, 500.0, frames=100), CountingSource(seconds=0.005), ring="drop-oldest", pace="real"
    )
    pipeline.start()
    assert pipeline.wait(20)
    assert source.filled == sorted(set(source.filled)) and source.filled[-1] == 99
    assert pipeline.progress.dropped_frames + pipeline.progress.frames == 100
    assert pipeline.progress.dropped_frames > 0


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
        hurried = False

        def close(self) -> None:
            super().close()
            if not self.hurried:
                raise KeyboardInterrupt

        def hurry(self) -> None:
            self.hurried = True

    patient, first, last = Patient(), ListSink(), ListSink()
    pipeline, _, _ = run(plan(1.0, 10.0, frames=3), sinks=(first, patient, last))
    pipeline.start()
    with pytest.raises(KeyboardInterrupt):
        while not pipeline.wait(1):
            pass
    assert (first.closed, last.closed) == (0, 1)
    assert pipeline.stop()
    assert (first.closed, patient.closed, last.closed) == (1, 2, 1)
    assert patient.hurried
