"""The pipeline: a source fills the ring, a detector empties it, sinks take the events.

The producer and the consumer run in threads of their own; so do all kernel compilations and launches, because Python
handles signals in the main thread alone and a compiler would block it. The main thread only waits.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol, cast, runtime_checkable

import numpy as np
import numpy.typing as npt

from clsim.events import Causes, EventBatch
from clsim.events.sockets.closing import BRIEF_FLUSH_S
from clsim.frames import (
    Cancellable,
    CountsRays,
    Frame,
    FrameRing,
    FrameSource,
    InterestBoard,
    InterestMap,
    Policy,
    Renoising,
    RingClosed,
    SourceEnded,
)
from clsim.frames.frame import FloatArray
from clsim.live.noise.duplicate_sampling import DuplicateSampling
from clsim.live.noise.significance import Significance, TellsError
from clsim.live.outputs.delivery import Delivery, Output
from clsim.live.pacing.clock import FrameClock
from clsim.live.pacing.governed import WARM_UP_FRAMES, Governed, Steerable
from clsim.live.pacing.load import BusyMeter
from clsim.live.pacing.schedule import Continuity, Schedule

Pace = Literal["max", "real"]
_CLOSING_S = BRIEF_FLUSH_S + 0.1
"""Time for outputs to close in once somebody pressed Ctrl-C."""


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
    lost: int
    """Events that the sensor's readout had no time for."""


class Detector(Protocol):
    """Anything that turns frames into events."""

    def step(self, frame: Frame) -> EventBatch:
        """Return the events between the previous frame and this one."""
        ...

    def reset(self) -> None:
        """Let the next frame reset the references, without events."""
        ...

    def close(self) -> None:
        """Release what the detector holds."""
        ...

    @property
    def stats(self) -> DetectorStats:
        """Counters since the start."""
        ...


class InterestedDetector(Protocol):
    """A detector that tells where events are near."""

    def interest(self) -> InterestMap:
        """Return the map after the last frame; frames are numbered from 0 on, over `Detector.reset` too."""
        ...


@runtime_checkable
class TimesEvents(Protocol):
    """A detector that times events as exactly as it is told to."""

    tolerance_us: float
    """Error of an event's time that will do [µs]."""


@runtime_checkable
class TellsLevel(Protocol):
    """A detector that tells the brightness that it sees."""

    def level(self) -> FloatArray:
        """Return the brightness of each pixel at the last frame [log units], ``[H, W]``."""
        ...


@runtime_checkable
class TellsCauses(Protocol):
    """A detector that tells what caused its events."""

    @property
    def causes(self) -> Causes | None:
        """Causes of the last step's events, as many as these; None where brightness caused them all."""
        ...


class SamplesTwice(Protocol):
    """A source that samples some pixels a second time."""

    def sampled_twice(self, frame: Frame) -> npt.NDArray[np.float32]:
        """Return both estimates there, ``[2, …]``: that of ``frame``, the last one, and the second."""
        ...


class FrameWatcher(Protocol):
    """A receiver that wants a frame now and then."""

    def wants_frame(self) -> bool:
        """Tell whether the frame at hand should be shown; called for each, so it must be quick."""
        ...

    def show_frame(self, frame: Frame, level: FloatArray | None) -> None:
        """Show a copy of the frame and, if the detector tells, of its brightness ``[H, W]``, denoised [log units]."""
        ...


@dataclass
class Progress:
    """Counters that the pipeline keeps and a status line reads."""

    frames: int = 0
    events: int = 0
    on_events: int = 0
    first_us: int | None = None  # recordings may begin late
    simulated_us: int = 0
    dropped_frames: int = 0
    late_frames: int = 0
    """Frames begun more than a frame's time after the clock wanted them."""
    solved_share: float = 0.0
    masked_pixels: int = 0
    steep_pixels: int = 0
    """Pixels that crossed more than 3 thresholds in one step, summed over steps."""
    most_crossings: int = 0
    """The largest number of thresholds that a pixel crossed in one step."""
    capped_events: int = 0
    lost_events: int = 0
    """Events that the sensor's readout had no time for."""
    noise_share: float | None = None
    """Share of the events that is likely noise of the rendering; known at the end, where it is measured."""
    paths: int | None = None
    """Light paths traced so far, if the source tells."""
    first_hit_rays: int | None = None
    """Primary rays traced so far, if the source tells."""
    light_s: float | None = None
    """Time that finding light again has taken so far, if the source tells."""
    fill: int = 0
    started_s: float = field(default_factory=time.perf_counter)
    first_frame_s: float | None = None


class Pipeline:
    """Runs source → ring → detector → sinks until the schedule, the user or an error ends it.

    Args:
        make_source: builds the frame source, in the producer's thread.
        make_detector: builds the detector, in the consumer's thread.
        outputs: where events go; one that fails is named in the end, the others go on.
        schedule: which frames to show.
        shape: plane names, height and width of the frames.
        ring: policy of the ring.
        slots: its number of slots.
        pace: ``real`` never runs ahead of the wall clock, and under ``drop-oldest`` skips frames it is late for.
        board: where the detector's maps of interest go, if the source wants them.
        governed: what sets the source's effort at the pace of the wall clock.
        share_cores: whether source and detector compute on the same cores.
        significance: what judges events, if the detector knows errors.
        duplicates: what gets pixels that are sampled twice, if the source samples any so.
        in_step: whether the source waits with each frame until the last one's events are found.
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
        board: InterestBoard | None = None,
        governed: Governed | None = None,
        share_cores: bool = True,
        in_step: bool = False,
        duplicates: DuplicateSampling | None = None,
        significance: Significance | None = None,
    ) -> None:
        """Prepare; nothing runs before ``start``."""
        names, height, width = shape
        self._names = names
        self.progress = Progress()
        self.watchers: list[FrameWatcher] = []
        self._delivery = Delivery(outputs)
        self._make_source, self._make_detector = make_source, make_detector
        self._schedule = schedule
        self._ring = FrameRing(slots, names, height, width, ring)
        self._clock = FrameClock(schedule, may_skip=ring == "drop-oldest") if pace == "real" else None
        self._board, self._governed, self._in_step = board, governed, in_step
        self._duplicates, self._significance = duplicates, significance
        self._meter = BusyMeter(share_cores=share_cores)
        self._source: object = None
        self._detector: object = None
        self._stopping = threading.Event()
        self._consumed = threading.Semaphore(0)
        self._continuity = Continuity(schedule)
        self._error: BaseException | None = None
        self._threads = [
            threading.Thread(target=self._run_worker, args=(self._produce,), name="clsim-render", daemon=True),
            threading.Thread(target=self._run_worker, args=(self._consume,), name="clsim-detect", daemon=True),
        ]

    @property
    def outputs(self) -> list[Output]:
        """Where events go; more may be added before the start."""
        return self._delivery.outputs

    def start(self) -> None:
        """Start both threads."""
        self._delivery.refuse_recorders(self._names)
        for thread in self._threads:
            thread.start()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for the end; True once both threads have ended. Raises what went wrong in either."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        for thread in self._threads:
            thread.join(None if deadline is None else max(0.0, deadline - time.monotonic()))
            if thread.is_alive():
                return False
        self._delivery.close()
        if self._error is not None:
            raise self._error
        return True

    def stop(self, timeout_s: float = 0.8) -> bool:
        """End now: running tiles finish, sinks are closed. False if a thread or a sink is still busy after the timeout.

        Ctrl-C does not cut this short, or files would be left unfinished.
        """
        ended: list[bool] = []
        ender = threading.Thread(target=lambda: ended.append(self._end(timeout_s)), name="clsim-stop")
        ender.start()
        while ender.is_alive():
            with contextlib.suppress(KeyboardInterrupt):
                ender.join()
        return ended == [True]

    def _end(self, timeout_s: float) -> bool:
        deadline = time.monotonic() + timeout_s
        self._give_up()
        for thread in self._threads:
            if thread.ident is not None:
                thread.join(max(0.0, deadline - _CLOSING_S - time.monotonic()))
        closed = self._delivery.close_at_once(max(_CLOSING_S, deadline - time.monotonic()))
        return closed and not any(thread.is_alive() for thread in self._threads)

    def _run_worker(self, run: Callable[[], None]) -> None:
        try:
            run()
        except RingClosed:
            pass
        except BaseException as error:
            if not self._stopping.is_set():
                self._error = self._error or error
            self._give_up()

    def _give_up(self) -> None:
        """Let neither thread go on, or wait for the other or for the clock."""
        self._stopping.set()
        self._ring.abandon()
        if self._board is not None:
            self._board.close()
        self._consumed.release()
        for each in (self._source, self._detector):
            if isinstance(each, Cancellable):
                each.cancel()

    def _produce(self) -> None:
        source = self._source = self._make_source()
        renoising = source if isinstance(source, Renoising) else None
        schedule, clock = self._schedule, self._clock
        try:
            index = 0
            while not self._stopping.is_set() and (schedule.total is None or index < schedule.total):
                if clock is not None and index >= WARM_UP_FRAMES:
                    index = clock.wait_for(index, self._stopping)
                frame = self._ring.acquire()
                if self._governed is not None and self._governed.apply(cast(Steerable, source)):
                    self._continuity.restart_at(index)
                    if self._duplicates is not None:
                        self._duplicates.restart()
                shown = schedule.source_index(index)
                if renoising is not None:
                    renoising.noise_offset = index - shown
                with self._meter.busy("source"):
                    try:
                        source.fill(shown, frame)
                    except SourceEnded:
                        break
                if self._duplicates is not None:
                    self._duplicates.take(cast(SamplesTwice, source).sampled_twice(frame), frame.time_us)
                frame.index = index
                if not schedule.recorded_times:
                    frame.time_us = schedule.time_us(index)
                self._ring.publish()
                if self._in_step or (clock is not None and index < WARM_UP_FRAMES):
                    self._consumed.acquire()
                index = self._after(index)
            self._ring.close()
        finally:
            if self._duplicates is not None:
                self.progress.noise_share = self._duplicates.noise_share
            source.close()

    def _after(self, index: int) -> int:
        """Return the next frame: some are left out where the clock leaves no time for them, but never the last."""
        following = index + (1 if self._governed is None else self._governed.one_in)
        last = (self._schedule.total or following + 1) - 1
        return following if index >= last else min(following, last)

    def _consume(self) -> None:
        detector = self._detector = self._make_detector()
        try:
            while True:
                frame = self._ring.take()
                assert frame is not None, "take() without a timeout returns a frame or raises"
                time_us = frame.time_us
                with self._meter.busy("detector"):
                    try:
                        events = self._detect(detector, frame)
                        causes = detector.causes if isinstance(detector, TellsCauses) else None
                        self._delivery.record(frame, events, causes)
                    finally:
                        self._ring.release()
                self._delivery.write(events, time_us, causes)
                self._count(events, time_us, detector.stats)
                if self._governed is not None and self._clock is not None:
                    self._governed.frame_done(self._meter.lap(), self._clock.lag_s)
                    if self._governed.tolerance_us is not None and isinstance(detector, TimesEvents):
                        detector.tolerance_us = self._governed.tolerance_us
                self._consumed.release()
        finally:
            if self._significance is not None:
                self.progress.noise_share = self._significance.noise_share
            detector.close()

    def _detect(self, detector: Detector, frame: Frame) -> EventBatch:
        if self._continuity.breaks(frame.index):
            detector.reset()
            if self._significance is not None:
                self._significance.restart()
        events = detector.step(frame)
        if self._board is not None:
            self._board.publish(cast(InterestedDetector, detector).interest())
        if self._significance is not None:
            self._significance.watch(cast(TellsError, detector), events)
        for watcher in self.watchers:
            if watcher.wants_frame():
                watcher.show_frame(frame, detector.level() if isinstance(detector, TellsLevel) else None)
        return events

    def _count(self, batch: EventBatch, time_us: int, stats: DetectorStats) -> None:
        progress = self.progress
        if progress.first_frame_s is None:
            progress.first_frame_s = time.perf_counter() - progress.started_s
        progress.frames += 1
        progress.events += len(batch)
        progress.on_events += int(batch["on"].sum())
        progress.first_us = time_us if progress.first_us is None else progress.first_us
        progress.simulated_us = time_us
        progress.solved_share = stats.solved_share
        progress.masked_pixels = stats.masked
        progress.steep_pixels = stats.many_crossings
        progress.most_crossings = stats.most_crossings
        progress.capped_events = stats.capped
        progress.lost_events = stats.lost
        progress.fill = self._ring.fill
        if isinstance(self._source, CountsRays):
            progress.paths, progress.first_hit_rays = self._source.paths, self._source.first_hit_rays
            progress.light_s = self._source.light_s
        progress.dropped_frames = self._ring.dropped
        if self._clock is not None:
            progress.dropped_frames += self._clock.skipped
            progress.late_frames = self._clock.late_frames
