"""Render a sequence once; run detectors over it; count what both cost."""

from __future__ import annotations

import gc
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from clsim.bench.stopwatch import Stopwatch, peak_memory_bytes, reset_peak_memory
from clsim.detect.config import DetectorConfig
from clsim.detect.detector import Detector
from clsim.events import EventBatch
from clsim.frames import Frame, InterestBoard, page_aligned, rendered_planes
from clsim.opencl.device import Device
from clsim.render import PathTracer, RenderOptions
from clsim.scene import World

_ENOUGH_CPU_S = 0.3
"""Short work is timed again until it took so much in all; the quickest pass counts."""
_MOST_PASSES = 5


@dataclass(frozen=True)
class Cost:
    """What a piece of work took: wall-clock and processor time [s], and peak resident memory [bytes] or None."""

    wall_s: float
    cpu_s: float
    peak_bytes: int | None


@dataclass(frozen=True)
class Detected:
    """The events of a sequence, the share of tested pixels whose regression was solved, and the cost."""

    events: EventBatch
    solved_share: float
    cost: Cost


@dataclass(frozen=True)
class Rendered:
    """What rendering a sequence took: paths, rays that looked for the first hit alone, and the cost."""

    paths: int
    first_hit_rays: int
    cost: Cost


@dataclass(frozen=True)
class Run:
    """What detection and rendering gave and cost."""

    detected: Detected
    rendered: Rendered


def warm_renderer(world: World, options: RenderOptions) -> None:
    """Load the world's render kernel, which the first frame of a process would wait for."""
    tracer = PathTracer(world, options)
    try:
        tracer.fill(0, _new_frame(tracer))
    finally:
        tracer.close()


def start_up(
    world: World, options: RenderOptions, config: DetectorConfig, device: Device
) -> tuple[Stopwatch, Stopwatch]:
    """Render the first frame and let a detector see it, which loads the kernels of both; return what each took."""
    rendering, detecting = Stopwatch(), Stopwatch()
    with rendering:
        tracer = PathTracer(world, options)
        try:
            frame = _new_frame(tracer)
            tracer.fill(0, frame)
        finally:
            tracer.close()
    with detecting:
        detector = Detector(config, frame.width, frame.height, frame.names, device=device)
        try:
            detector.step(frame)
        finally:
            detector.close()
    return rendering, detecting


def render_each(world: World, options: RenderOptions, take: Callable[[Frame], None]) -> Rendered:
    """Render ``options.frames`` frames into one frame's memory and hand each to ``take``; count the rendering alone."""
    tracer, watch = PathTracer(world, options), Stopwatch()
    frame, peak = _new_frame(tracer), None
    reset_peak_memory()
    try:
        for index in range(options.frames or 0):
            with watch:
                tracer.fill(index, frame)
            peak = peak_memory_bytes()
            take(frame)
    finally:
        tracer.close()
    return Rendered(tracer.paths, tracer.first_hit_rays, Cost(watch.wall_s, watch.cpu_s, peak))


def render_sequence(world: World, options: RenderOptions, on_frame: Callable[[], None]) -> tuple[list[Frame], Rendered]:
    """Return all frames and what one rendering of them costs; ``on_frame`` is called after each of the first pass."""
    frames: list[Frame] = []

    def take(frame: Frame) -> None:
        frames.append(frame.copy())
        on_frame()

    passes = [render_each(world, options, take)]
    while sum(each.cost.cpu_s for each in passes) < _ENOUGH_CPU_S and len(passes) < _MOST_PASSES:
        passes.append(render_each(world, options, lambda frame: None))
    best = min((each.cost for each in passes), key=lambda cost: cost.cpu_s)
    # Later passes ran beside the frames kept from the first.
    return frames, replace(passes[0], cost=Cost(best.wall_s, best.cpu_s, passes[0].cost.peak_bytes))


def detect(config: DetectorConfig, frames: list[Frame], device: Device) -> Detected:
    """Run a detector over frames; a first pass gives the events and builds kernels, further ones are timed.

    The peak of the memory leaves out the frames themselves: a live run keeps a few of them only.
    """
    gc.collect()
    detector = Detector(config, frames[0].width, frames[0].height, frames[0].names, device=device)
    stored = sum(frame.planes.nbytes for frame in frames)
    reset_peak_memory()
    try:
        events = np.concatenate([detector.step(frame) for frame in frames])
        solved_share = detector.stats.solved_share
        passes = [_timed_pass(detector, frames)]
        while sum(watch.cpu_s for watch in passes) < _ENOUGH_CPU_S and len(passes) < _MOST_PASSES:
            passes.append(_timed_pass(detector, frames))
        peak = peak_memory_bytes()
    finally:
        detector.close()
    best = min(passes, key=lambda watch: watch.cpu_s)
    return Detected(events, solved_share, Cost(best.wall_s, best.cpu_s, None if peak is None else peak - stored))


def run_in_turns(
    world: World, options: RenderOptions, config: DetectorConfig, device: Device, on_frame: Callable[[], None]
) -> Run:
    """Render a frame, detect in it, render the next: for renderings that depend on what was detected before.

    Each frame is rendered with the map of interest of the frame two before, as live. A first pass gives the events and
    builds kernels, and ``on_frame`` is called after each of its frames; further passes are timed, rendering and
    detection apart, and the quickest counts.
    """
    gc.collect()
    names = rendered_planes(first_hit_rays=options.first_hit_rays > 0).names
    detector = Detector(config, world.camera.width, world.camera.height, names, device=device)
    reset_peak_memory()
    try:
        first = _turns(world, options, detector, on_frame)
        solved_share = detector.stats.solved_share
        passes = [_turns(world, options, detector, lambda: None)]
        while sum(each.cpu_s for each in passes) < _ENOUGH_CPU_S and len(passes) < _MOST_PASSES:
            passes.append(_turns(world, options, detector, lambda: None))
        peak = peak_memory_bytes()
    finally:
        detector.close()
    best = min(passes, key=lambda each: each.cpu_s)
    detected = Detected(first.events, solved_share, Cost(best.detecting.wall_s, best.detecting.cpu_s, peak))
    cost = Cost(best.rendering.wall_s, best.rendering.cpu_s, peak)
    return Run(detected, Rendered(first.paths, first.first_hit_rays, cost))


@dataclass(frozen=True)
class _Pass:
    """One pass over a sequence, frame by frame."""

    events: EventBatch
    paths: int
    first_hit_rays: int
    rendering: Stopwatch
    detecting: Stopwatch

    @property
    def cpu_s(self) -> float:
        return self.rendering.cpu_s + self.detecting.cpu_s


def _turns(world: World, options: RenderOptions, detector: Detector, on_frame: Callable[[], None]) -> _Pass:
    rendering, detecting = Stopwatch(), Stopwatch()
    board = InterestBoard()
    tracer = PathTracer(world, options, board)
    frame = _new_frame(tracer)
    batches: list[EventBatch] = []
    detector.reset()
    try:
        for index in range(tracer.frame_count or 0):
            with rendering:
                tracer.fill(index, frame)
            with detecting:
                events = detector.step(frame)
                if options.probe_spp is not None:
                    # The detector goes on counting from pass to pass.
                    board.publish(replace(detector.interest(), number=index))
            batches.append(events)
            on_frame()
    finally:
        tracer.close()
    return _Pass(np.concatenate(batches), tracer.paths, tracer.first_hit_rays, rendering, detecting)


def _timed_pass(detector: Detector, frames: list[Frame]) -> Stopwatch:
    watch = Stopwatch()
    detector.reset()
    with watch:
        for frame in frames:
            detector.step(frame)
    return watch


def _new_frame(tracer: PathTracer) -> Frame:
    return Frame(page_aligned((len(tracer.names), tracer.height, tracer.width)), tracer.names)
