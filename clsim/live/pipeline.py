"""The pipeline: a source fills the ring, a detector empties it, sinks take the events.

The producer and the consumer run in threads of their own; so do all kernel compilations and launches, because Python
handles signals in the main thread alone and a compiler would block it. The main thread only waits.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, Protocol

from clsim.events import EventBatch, Sink, SinkError
from clsim.events.closing import close_at_once
from clsim.frames import Frame, FrameRing, FrameSource, Policy, RingClosed
from clsim.frames.frame import FloatArray
from clsim.live.schedule import Schedule

Pace = Literal["max", "real"]


class DetectorStats(Protocol):
    """What a detector counts."""

    solved_share: float
    """Share of the tested pixels, over all frames, whose regression was solved."""
    masked: int
    """Pixels left out because of NaN or infinite values, summed over frames."""
    many_crossings: int
    """Pixels with more than 3 crossings in one step, summed over steps."""
    most_crossings: int
    """The largest number of crossings of a pixel in one step."""
    capped: int
    """Events not written because a pixel had too many in one step."""


class Detector(Protocol):
    """Anything that turns frames into events."""

    def step(self, frame: Frame) -> EventBatch:
        """Return the events between the previous frame and this one."""
        ...

    def reset(self) -> None:
        """Let the next frame set the references anew, without events."""
        ...

    def close(self) -> None:
        """Release what the detector holds."""
        ...

    @property
    def stats(self) -> DetectorStats:
        """Counters since the start."""
        ...


class FrameWatcher(Protocol):
    """Somebody who looks at a frame now and then."""

    def wants_frame(self) -> bool:
        """Tell whether the frame at hand should be shown; called for each, so it must be quick."""
        ...

    def show_frame(self, frame: Frame, level: FloatArray | None) -> None:
        """Show a copy of the frame and, if the detector tells, of its brightness ``[H, W]``, denoised [log units]."""
        ...


@dataclass
class Output:
    """A sink, the name the user knows it by, and where its sidecar goes if it has one."""

    name: str
    sink: Sink
    error: str | None = None
    sidecar: Path | None = None
    closed: bool = False


@dataclass
class Progress:
    """Counters that the pipeline keeps and a status line reads."""

    frames: int = 0
    events: int = 0
    on_events: int = 0
    simulated_us: int = 0
    dropped_frames: int = 0
    solved_share: float = 0.0
    masked_pixels: int = 0
    steep_pixels: int = 0
    """Pixels that crossed more than 3 thresholds in one step, summed over steps."""
    most_crossings: int = 0
    """The largest number of thresholds that a pixel crossed in one step."""
    capped_events: int = 0
    fill: int = 0
    started_s: float = field(default_factory=time.perf_counter)
    first_frame_s: float | None = None


class Pipeline:
    """Runs source → ring → detector → sinks until the schedule, the user or an error ends it.

    Args:
        make_source: builds the frame source, in the producer's thread.
        make_detector: builds the detector, in the consumer's thread.
        outputs: where events go; one that fails is closed and named, the others go on.
        schedule: which frames to show.
        shape: plane names, height and width of the frames.
        ring: policy of the ring.
        slots: its number of slots.
        pace: ``real`` never runs ahead of the wall clock, and under ``drop-oldest`` skips frames it is late for.
    """

    def __init__(
        self,
        make_source: Callable[[], FrameSource],
        make_detector: Callable[[], Detector],
        outputs: Sequence[Output],
        schedule: Schedule,
        shape: tuple[tuple[str, ...], int, int],
        *,
        ring: Policy = "block",
        slots: int = 3,
        pace: Pace = "max",
    ) -> None:
        """Prepare; nothing runs before ``start``."""
        names, height, width = shape
        self.progress = Progress()
        self.watchers: list[FrameWatcher] = []
        self.outputs = list(outputs)
        self._make_source, self._make_detector = make_source, make_detector
        self._schedule, self._pace = schedule, pace
        self._ring = FrameRing(slots, names, height, width, ring)
        self._source: FrameSource | None = None
        self._skipped = 0
        self._stopping = threading.Event()
        self._error: BaseException | None = None
        self._sinks_closed = False
        self._sink_lock = threading.Lock()
        self._threads = [
            threading.Thread(target=self._guard, args=(self._produce,), name="clsim-render", daemon=True),
            threading.Thread(target=self._guard, args=(self._consume,), name="clsim-detect", daemon=True),
        ]

    def start(self) -> None:
        """Start both threads."""
        for thread in self._threads:
            thread.start()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for the end; True once both threads have ended. Raises what went wrong in either."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        for thread in self._threads:
            thread.join(None if deadline is None else max(0.0, deadline - time.monotonic()))
            if thread.is_alive():
                return False
        self._close_outputs()
        if self._error is not None:
            raise self._error
        return True

    def stop(self, timeout_s: float = 0.7) -> bool:
        """End now: running tiles finish, sinks are closed. False if a thread was still busy (compiling, say)."""
        self._stopping.set()
        self._ring.abandon()
        cancel = getattr(self._source, "cancel", None)
        if cancel is not None:
            cancel()
        deadline = time.monotonic() + timeout_s
        for thread in self._threads:
            if thread.ident is not None:
                thread.join(max(0.0, deadline - time.monotonic()))
        self._close_outputs(at_once=True)
        return not any(thread.is_alive() for thread in self._threads)

    def _guard(self, run: Callable[[], None]) -> None:
        try:
            run()
        except RingClosed:
            pass
        except BaseException as error:
            if not self._stopping.is_set():
                self._error = self._error or error
            self._ring.abandon()

    def _produce(self) -> None:
        source = self._source = self._make_source()
        try:
            index = 0
            clock_start = time.perf_counter()
            while not self._stopping.is_set() and (self._schedule.total is None or index < self._schedule.total):
                if self._pace == "real":
                    index = self._keep_pace(index, clock_start)
                frame = self._ring.acquire()
                source.fill(self._schedule.source_index(index), frame)
                frame.index = index
                if not self._schedule.recorded_times:
                    frame.time_us = self._schedule.time_us(index)
                self._ring.publish()
                index += 1
            self._ring.close()
        finally:
            source.close()

    def _keep_pace(self, index: int, clock_start: float) -> int:
        """Wait until frame ``index`` is due; if it is long past and frames may be lost, return the one due now."""
        elapsed_s = time.perf_counter() - clock_start
        due_now = int(elapsed_s * self._schedule.fps)
        if self._ring.policy == "drop-oldest" and due_now > index and index > 0:
            if self._schedule.total is not None:
                due_now = min(due_now, self._schedule.total - 1)
            self._skipped += due_now - index
            return due_now
        self._stopping.wait(max(0.0, self._schedule.time_us(index) * 1e-6 - elapsed_s))
        return index

    def _consume(self) -> None:
        detector = self._make_detector()
        try:
            previous = 0
            while True:
                frame = self._ring.take()
                assert frame is not None, "take() without a timeout returns a frame or raises"
                try:
                    if self._schedule.crosses_seam(previous, frame.index):
                        detector.reset()
                    previous = frame.index
                    batch = detector.step(frame)
                    time_us = frame.time_us
                    for watcher in self.watchers:
                        if watcher.wants_frame():
                            tell_level = getattr(detector, "level", None)
                            watcher.show_frame(frame, None if tell_level is None else tell_level())
                finally:
                    self._ring.release()
                self._write(batch)
                self._count(batch, time_us, detector.stats)
        finally:
            detector.close()

    def _write(self, batch: EventBatch) -> None:
        with self._sink_lock:
            if self._sinks_closed:
                return
            for output in self.outputs:
                if output.error is None:
                    try:
                        output.sink.write(batch)
                    except (SinkError, OSError) as error:
                        output.error = str(error)
            if self.outputs and all(output.error for output in self.outputs):
                raise SinkError("every output has failed: " + "; ".join(o.error or "" for o in self.outputs))

    def _count(self, batch: EventBatch, time_us: int, stats: DetectorStats) -> None:
        progress = self.progress
        if progress.first_frame_s is None:
            progress.first_frame_s = time.perf_counter() - progress.started_s
        progress.frames += 1
        progress.events += len(batch)
        progress.on_events += int(batch["on"].sum())
        progress.simulated_us = time_us
        progress.solved_share = stats.solved_share
        progress.masked_pixels = stats.masked
        progress.steep_pixels = stats.many_crossings
        progress.most_crossings = stats.most_crossings
        progress.capped_events = stats.capped
        progress.fill = self._ring.fill
        progress.dropped_frames = self._ring.dropped + self._skipped

    def _close_outputs(self, *, at_once: bool = False) -> None:
        """Close what is open still (an earlier call may have been interrupted): files first, for sockets may wait."""
        with self._sink_lock:
            self._sinks_closed = True
            for output in reversed(self.outputs):
                if output.closed:
                    continue
                try:
                    if at_once:
                        close_at_once(output.sink)
                    else:
                        output.sink.close()
                except (SinkError, OSError) as error:
                    output.error = output.error or str(error)
                output.closed = True
