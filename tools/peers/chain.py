"""The chain that users have today: Mitsuba 3 frame by frame, then the method of Tsuji et al., ICIP 2023, in numpy.

The frames are Mitsuba's, with fresh noise in each and the planes that the method needs. The events are those of the
published gate on these frames, by our vectorised float64 code. The time is what a numpy program would take that goes
through pixels one by one, as the published one does: a random subset of the run's own windows is fitted and tested that
way, and the times are scaled to the numbers of fits and tests that the events took.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from clsim.bench.tradeoff.stopwatch import Stopwatch
from clsim.detect.config import DetectorConfig
from clsim.detect.float64.observation import feature_names, observe
from clsim.detector import NumpyDetector
from clsim.events import EventBatch
from clsim.frames import Frame, page_aligned
from clsim.render import RenderOptions
from clsim.scene import Sensor, World
from tools.peers.mitsuba_frames import MitsubaFrames
from tools.peers.plain_wlr import cut_window, fit_plane, gate_plane

SPP = 32
"""Paths a pixel: the fewest in the paper's tables."""
_SAMPLED = 1000
"""Windows that are fitted and tested to take the time."""


@dataclass(frozen=True)
class PlainCost:
    """Processor time of one fit and of one test of the gate [s], and how many of each were timed."""

    fit_s: float
    gate_s: float
    sampled: int


@dataclass(frozen=True)
class Chain:
    """What the chain gave and took.

    Attributes:
        events: by the rule ``frame``.
        startup: time to load the scene and to render the first frame once, in which Mitsuba compiles.
        rendering: time of all frames after that.
        fits: regressions solved.
        gates: pixels asked by the gate whether they need one.
        plain: what one of each takes.
        paths: paths traced, those of the start apart.
    """

    events: EventBatch
    startup: Stopwatch
    rendering: Stopwatch
    fits: int
    gates: int
    plain: PlainCost
    paths: int

    @property
    def detect_s(self) -> float:
        """Processor time of detection [s], which is also its wall-clock time: plain numpy has one thread."""
        return self.fits * self.plain.fit_s + self.gates * self.plain.gate_s

    def costs(self) -> dict[str, Any]:
        """Return the figures for the results, by the names that points have, and those of the chain alone."""
        return {
            "paths": self.paths,
            "first_hit_rays_traced": 0,
            "render_cpu_s": self.rendering.cpu_s,
            "render_wall_s": self.rendering.wall_s,
            "detect_cpu_s": self.detect_s,
            "detect_wall_s": self.detect_s,
            "startup_cpu_s": self.startup.cpu_s,
            "startup_wall_s": self.startup.wall_s,
            "fits": self.fits,
            "gates": self.gates,
            "cpu_s_per_fit": self.plain.fit_s,
            "cpu_s_per_gate": self.plain.gate_s,
            "timed_windows": self.plain.sampled,
        }


def chain_config(sensor: Sensor) -> DetectorConfig:
    """Return the published method's options: its gate, rule, kernel and window."""
    return DetectorConfig(
        gate="published",
        event_rule="frame",
        kernel="epanechnikov",
        window=13,
        threshold_on=sensor.threshold_on,
        threshold_off=sensor.threshold_off,
        scale=sensor.scale,
        floor=sensor.floor,
    )


def run_chain(
    world: World, file: Path | None, options: RenderOptions, config: DetectorConfig, on_frame: Callable[[], None]
) -> Chain:
    """Render ``options.frames`` frames with Mitsuba and detect in each; ``file`` is the world's own, if Mitsuba's.

    Raises:
        InputError: Mitsuba is missing or cannot render the world.
    """
    startup, rendering = Stopwatch(), Stopwatch()
    with startup:
        source = MitsubaFrames(world, file, options)
        frame = _new_frame(source)
        source.fill(0, frame)
    detector = NumpyDetector(config, source.width, source.height, source.names)
    batches: list[EventBatch] = []
    count = options.frames or 0
    middle: list[Frame] = []
    for index in range(count):
        with rendering:
            source.fill(index, frame)
        batches.append(detector.step(frame))
        if index in (max(count // 2 - 1, 0), count // 2):
            middle.append(frame.copy())
        on_frame()
    source.close()
    stats = detector.stats
    plain = time_plain(middle[0], middle[-1], config)
    paths = source.width * source.height * count * options.spp
    fits = stats.solved + stats.initialised
    return Chain(np.concatenate(batches), startup, rendering, fits, stats.tested, plain, paths)


def time_plain(before: Frame, after: Frame, config: DetectorConfig, sampled: int = _SAMPLED) -> PlainCost:
    """Fit planes to windows of one frame and test them at the next, one by one; pixels are taken at random."""
    rng = np.random.default_rng(0)
    rows, columns = rng.integers(before.height, size=sampled), rng.integers(before.width, size=sampled)
    places = list(zip(rows.tolist(), columns.tolist(), strict=True))
    planes = feature_names(config, before.names)
    old, new = (observe(each, planes, config) for each in (before, after))
    fitting, testing = Stopwatch(), Stopwatch()
    for watched in (False, True):  # the first few warm up
        some = places if watched else places[:20]
        with fitting if watched else Stopwatch():
            fitted = [
                fit_plane(cut_window(old.features, old.brightness, *at, config.side), config.kernel) for at in some
            ]
        with testing if watched else Stopwatch():
            for plane, at in zip(fitted, some, strict=True):
                gate_plane(plane, cut_window(new.features, new.brightness, *at, config.side), config.kernel)
    return PlainCost(fitting.cpu_s / sampled, testing.cpu_s / sampled, sampled)


def _new_frame(source: MitsubaFrames) -> Frame:
    return Frame(page_aligned((len(source.names), source.height, source.width)), source.names)
