"""The adaptive sampler of Manabe et al., ICCP 2024, as a baseline: a t-test at each pixel and frame.

From the paper ("Monte Carlo Path Tracing and Statistical Event Detection for Event Camera Simulation") and its
published program: noise is independent between frames; the first frame gets all samples; in later ones a pixel gets 256
samples and then 64 at a time, until a t-test tells whether its log luminance differs from that of the frame of its last
event by more than the threshold or by less, or a cap is reached, where the difference as it stands decides. An event
makes its frame the pixel's new reference.

Assumed here: the test is Welch's (the program takes one number of samples for both frames); it is two-sided at 95 %
confidence; the cap is 1024 (the program's examples have 4096, which few of the pixels here would go beyond 1024 for).
Brightness is the log of the mean luminance, as the references of these benches have it, its variance by the delta
method and its bias taken off; the program averages logarithms of samples. As there, nothing is spent on looking at the
test after every step. All steps of a frame are rendered whole while any pixel needs them, but a path counts only for
pixels that had asked for it, and so does the time of rendering.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from clsim.bench.tradeoff.measure import warm_renderer
from clsim.bench.tradeoff.stopwatch import Stopwatch
from clsim.detect.features import LUMINANCE_WEIGHTS
from clsim.events import EVENT_DTYPE, EventBatch
from clsim.frames import RADIANCE, SAMPLES, Frame, page_aligned
from clsim.render import PathTracer, RenderOptions
from clsim.scene import Sensor, World

FIRST, STEP, CAP = 256, 64, 1024
"""Samples of a pixel before the first test, between tests, and at most."""
CONFIDENCE = 0.95

F64 = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


@dataclass(slots=True)
class Moments:
    """Running moments of the samples of each pixel, all ``[H, W]``: count, mean, sum of squared deviations."""

    count: F64
    mean: F64
    m2: F64

    @classmethod
    def of(cls, frame: Frame) -> Moments:
        """Return those of luminance in a frame with planes of variances."""
        count = frame.plane(SAMPLES[0]).astype(np.float64)
        rgb = np.stack([frame.plane(name) for name in RADIANCE]).astype(np.float64)
        mean = np.tensordot(np.asarray(LUMINANCE_WEIGHTS["rec709"]), rgb, axes=1)
        variance_of_mean = np.nan_to_num(frame.plane("Variance.Luminance").astype(np.float64))
        return cls(count, mean, variance_of_mean * count * (count - 1))

    def merge(self, other: Moments, where: Mask) -> None:
        """Add the samples of ``other`` to these pixels (Chan, Golub and LeVeque, 1979)."""
        count = self.count + other.count
        delta = other.mean - self.mean
        with np.errstate(invalid="ignore"):
            share = np.where(count > 0, other.count / count, 0.0)
        self.m2 = np.where(where, self.m2 + other.m2 + delta * delta * self.count * share, self.m2)
        self.mean = np.where(where, self.mean + delta * share, self.mean)
        self.count = np.where(where, count, self.count)

    def put(self, other: Moments, where: Mask) -> None:
        """Take over the moments of ``other`` at these pixels."""
        for name in Moments.__slots__:
            getattr(self, name)[where] = getattr(other, name)[where]

    def log_brightness(self, sensor: Sensor) -> tuple[F64, F64]:
        """Return L [natural-log units], its bias taken off, and the variance of L."""
        floor = sensor.floor / sensor.scale
        mean = np.maximum(self.mean, floor)
        with np.errstate(divide="ignore", invalid="ignore"):
            variance = self.m2 / (self.count * (self.count - 1)) / (mean * mean)
        variance = np.where((self.mean > floor) & (self.count > 1), variance, 0.0)
        return np.log(sensor.scale * mean) + variance / 2, variance


@dataclass(slots=True)
class Decision:
    """What a test says: ``change [H, W]`` is L now less L then; ``beyond`` and ``within`` are what it is sure of."""

    change: F64
    beyond: Mask
    within: Mask


@dataclass(frozen=True)
class ManabeRun:
    """What the sampler found and took.

    Attributes:
        events: by the rule ``frame``.
        paths: paths that pixels asked for.
        undecided: share of pixels and frames in which the cap was reached without a decision.
        render_cpu_s, render_wall_s: time of rendering [s], in proportion to ``paths``.
        testing: time of the tests.
    """

    events: EventBatch
    paths: int
    undecided: float
    render_cpu_s: float
    render_wall_s: float
    testing: Stopwatch


def decide(now: Moments, then: Moments, sensor: Sensor) -> Decision:
    """Test by Welch's t whether |ΔL| is beyond the threshold of its direction, or within it."""
    from scipy.stats import t as student

    level, variance = now.log_brightness(sensor)
    old_level, old_variance = then.log_brightness(sensor)
    change = level - old_level
    excess = np.abs(change) - np.where(change > 0, sensor.threshold_on, sensor.threshold_off)
    spread = variance + old_variance
    with np.errstate(divide="ignore", invalid="ignore"):
        freedom = spread**2 / (variance**2 / (now.count - 1) + old_variance**2 / (then.count - 1))
        p = student.cdf(excess / np.sqrt(spread), freedom)
    # Without any variance there is no doubt.
    p = np.where(spread > 0, p, np.where(excess >= 0, 1.0, 0.0))
    tail = (1 - CONFIDENCE) / 2
    return Decision(change, p >= 1 - tail, p <= tail)


def run_manabe(world: World, options: RenderOptions, on_samples: Callable[[int], None]) -> ManabeRun:
    """Render and detect ``options.frames`` frames; ``on_samples`` is told each number of samples rendered everywhere.

    Of ``options``, the seed, the frame rate and the paths' lengths are used.
    """
    renderer = _Batches(world, options, on_samples)
    try:
        return _run(world, options, renderer)
    finally:
        renderer.close()


def _run(world: World, options: RenderOptions, renderer: _Batches) -> ManabeRun:
    width, height = world.camera.width, world.camera.height
    everywhere = np.ones((height, width), dtype=bool)
    then, _ = renderer.render(0, 0)
    for batch in range(1, renderer.batches):
        then.merge(renderer.render(0, batch)[0], everywhere)
    asked = float(CAP * width * height)
    undecided, batches, testing = 0, [], Stopwatch()
    for index in range(1, options.frames or 0):
        now, time_us = renderer.render(index, 0)
        asked += FIRST * width * height
        for batch in range(1, renderer.batches + 1):
            with testing:
                decision = decide(now, then, world.sensor)
                open_ = ~(decision.beyond | decision.within)
            if batch == renderer.batches or not open_.any():
                break
            now.merge(renderer.render(index, batch)[0], open_)
            asked += STEP * int(open_.sum())
        undecided += int(open_.sum())
        change = decision.change
        crossed = np.where(change > 0, change >= world.sensor.threshold_on, -change >= world.sensor.threshold_off)
        fired = decision.beyond | (open_ & crossed)
        batches.append(_events(fired, change > 0, time_us))
        then.put(now, fired)
    events = np.concatenate(batches)
    share = asked / renderer.paths
    tested = width * height * ((options.frames or 0) - 1)
    watch = renderer.watch
    return ManabeRun(events, round(asked), undecided / tested, watch.cpu_s * share, watch.wall_s * share, testing)


def _events(fired: Mask, on: Mask, time_us: int) -> EventBatch:
    y, x = np.nonzero(fired)
    events = np.empty(len(x), dtype=EVENT_DTYPE)
    events["t"], events["x"], events["y"], events["on"] = time_us, x, y, on[fired]
    return events


class _Batches:
    """Renders batches of samples that are independent of each other, one tracer for each batch of a frame."""

    def __init__(self, world: World, options: RenderOptions, on_samples: Callable[[int], None]) -> None:
        self.batches = 1 + (CAP - FIRST) // STEP
        self.paths = 0
        self.watch = Stopwatch()
        self._world, self._on_samples = world, on_samples
        self._options = replace(options, noise="independent", variances=True, sampler="pcg")
        warm_renderer(world, replace(self._options, spp=1))
        self._tracers: dict[int, PathTracer] = {}
        self._frame: Frame | None = None

    def render(self, index: int, batch: int) -> tuple[Moments, int]:
        """Return the moments of a batch of frame ``index`` and the frame's time [µs]."""
        spp = FIRST if batch == 0 else STEP
        if batch not in self._tracers:
            seed = (self._options.seed * self.batches + batch) % (1 << 64)
            self._tracers[batch] = PathTracer(self._world, replace(self._options, spp=spp, seed=seed))
        tracer = self._tracers[batch]
        if self._frame is None:
            self._frame = Frame(page_aligned((len(tracer.names), tracer.height, tracer.width)), tracer.names)
        with self.watch:
            tracer.fill(index, self._frame)
        self.paths += spp * tracer.width * tracer.height
        self._on_samples(spp)
        return Moments.of(self._frame), self._frame.time_us

    def close(self) -> None:
        for tracer in self._tracers.values():
            tracer.close()
