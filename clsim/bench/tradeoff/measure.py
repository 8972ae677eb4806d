"""Render a sequence, run a detector over it, and count what both cost."""

from __future__ import annotations

import gc
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from clsim.bench.tradeoff.stopwatch import Stopwatch, peak_memory_bytes, reset_peak_memory
from clsim.detect.config import DetectorConfig
from clsim.detector import Detector
from clsim.events import EventBatch
from clsim.frames import Frame, InterestBoard, page_aligned, rendered_planes
from clsim.opencl.device import Device
from clsim.render import PathTracer, RenderOptions
from clsim.scene import World

_ENOUGH_CPU_S = 0.3
"""Short work is timed again until it took so much in all; the quickest pass counts."""
_MOST_PASSES = 5


@dataclass(frozen=True)
class Run:
    """What rendering and detecting a sequence gave and took.

    Attributes:
        events: of the whole sequence.
        solved_share: share of tested pixels whose regression was solved.
        paths: light paths traced.
        first_hit_rays: rays that looked for the first hit alone.
        rendering, detecting: time of both.
        peak_bytes: largest resident memory, or None where the system does not tell.
    """

    events: EventBatch
    solved_share: float
    paths: int
    first_hit_rays: int
    rendering: Stopwatch
    detecting: Stopwatch
    peak_bytes: int | None

    @property
    def cpu_s(self) -> float:
        """Processor time of both [s]."""
        return self.rendering.cpu_s + self.detecting.cpu_s


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


def render_each(world: World, options: RenderOptions, take: Callable[[Frame], None]) -> Stopwatch:
    """Render ``options.frames`` frames into one frame's memory and hand each to ``take``; time the rendering alone."""
    tracer, watch = PathTracer(world, options), Stopwatch()
    frame = _new_frame(tracer)
    try:
        for index in range(options.frames or 0):
            with watch:
                tracer.fill(index, frame)
            take(frame)
    finally:
        tracer.close()
    return watch


def run_point(
    world: World, options: RenderOptions, config: DetectorConfig, device: Device, on_frame: Callable[[], None]
) -> Run:
    """Render a frame, detect in it, render the next, as live.

    Where sampling is adaptive, each frame is rendered with the map of interest of the frame two before. A first pass
    gives the events and builds kernels, and ``on_frame`` is called after each of its frames; further passes are timed,
    rendering and detection apart, and the quickest counts.
    """
    gc.collect()
    names = rendered_planes(first_hit_rays=options.first_hit_rays > 0).names
    detector = Detector(config, world.camera.width, world.camera.height, names, device=device)
    reset_peak_memory()
    try:
        first = _pass(world, options, detector, on_frame)
        passes = [_pass(world, options, detector, lambda: None)]
        while sum(each.cpu_s for each in passes) < _ENOUGH_CPU_S and len(passes) < _MOST_PASSES:
            passes.append(_pass(world, options, detector, lambda: None))
    finally:
        detector.close()
    best = min(passes, key=lambda each: each.cpu_s)
    return replace(first, rendering=best.rendering, detecting=best.detecting, peak_bytes=peak_memory_bytes())


def _pass(world: World, options: RenderOptions, detector: Detector, on_frame: Callable[[], None]) -> Run:
    rendering, detecting = Stopwatch(), Stopwatch()
    board = InterestBoard() if options.probe_spp is not None and not options.light_cache else None
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
                if board is not None:
                    # The detector goes on counting from pass to pass.
                    board.publish(replace(detector.interest(), number=index))
            batches.append(events)
            on_frame()
    finally:
        tracer.close()
    solved = detector.stats.solved_share
    return Run(np.concatenate(batches), solved, tracer.paths, tracer.first_hit_rays, rendering, detecting, None)


def _new_frame(tracer: PathTracer) -> Frame:
    return Frame(page_aligned((len(tracer.names), tracer.height, tracer.width)), tracer.names)
