"""The detector in float64 numpy: what recorded frames need that no kernel does, and what kernels are tested against.

It favours plainness over speed: every pixel keeps all features (those that are constant get scale 0), windows are
gathered explicitly, moments are two-pass. The method is that of Tsuji et al., "Event-based Camera Simulation using
Monte Carlo Path Tracing with Adaptive Denoising", ICIP 2023, with the radiance gate and the interpolated rule added.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from clsim.detect.config import DetectorConfig
from clsim.detect.float64.bandwidth import SOLVERS
from clsim.detect.float64.fit import Fit, Pixels, fit_pixels
from clsim.detect.float64.gate import Boxes, Model, Verdict, box_means, delta_r, level_of, radiance
from clsim.detect.float64.kept import KeptWindows, delta_r_exact, published
from clsim.detect.float64.observation import (
    F64,
    REGRESSING,
    Mask,
    Observation,
    add_variances,
    feature_names,
    observe,
)
from clsim.detect.float64.rule import Outcome, Step, apply_rule
from clsim.detect.stats import DetectorStats
from clsim.errors import InputError
from clsim.events import EventBatch, empty_batch
from clsim.frames import Frame

KEPT_WINDOW_GATES = ("delta-r-exact", "published")


class Float64Detector:
    """Frames in, events out, in float64, by all methods but `irradiance`.

    After each step these arrays ``[H, W]`` tell what happened: ``ref``, the level of the last event; ``level``, the
    brightness that the step used (regressed where solved, else predicted); ``solved``; and ``margin``, the smallest
    distance that any test of the pixel has ever had to its threshold: where it is tiny, another precision may
    legitimately decide otherwise, and the pixel's later events differ.
    """

    def __init__(self, config: DetectorConfig, width: int, height: int, names: tuple[str, ...]) -> None:
        """Prepare for frames of ``width`` × ``height`` with the planes ``names``.

        The gate `published` always has the authors' Epanechnikov kernel. The bandwidths `tsvd` and `optimised` are
        chosen per pixel (see `clsim.detect.float64.bandwidth`) and need the variance planes.

        Raises:
            InputError: ``config`` demands ``confidence``, of which float64 knows nothing.
        """
        if config.facts.knows_error and config.confidence > 0:
            raise InputError(f"the float64 reference has no `confidence`: expected 0, got {config.confidence:g}")
        if config.method == "esim-ad" and config.gate == "published":
            config = replace(config, kernel="epanechnikov")
        self.config = config
        self.width, self.height = width, height
        self.planes = feature_names(config, names) if config.method in REGRESSING else ()
        self.stats = DetectorStats()
        count = width * height
        self.ref: F64 = np.zeros((height, width))
        self.level: F64 = np.zeros((height, width))
        self.margin: F64 = np.full((height, width), np.inf)
        self.solved: Mask = np.zeros((height, width), dtype=bool)
        self._ready: Mask = np.zeros(count, dtype=bool)
        self._history: deque[Observation] = deque(maxlen=config.history)
        depth = 2 + self.planes.index("Depth") if "Depth" in self.planes else None
        self.model = Model(count, 2 + len(self.planes), depth)
        keeps = config.method == "esim-ad" and config.gate in KEPT_WINDOW_GATES
        self._solve = SOLVERS[config.bandwidth]
        self._kept = KeptWindows(count) if keeps else None
        self._time_us = 0

    def reset(self) -> None:
        """Forget all references, as at the seam of a loop: the next frame initialises again and fires nothing."""
        self._ready[:] = False
        self._history.clear()

    def step(self, frame: Frame) -> EventBatch:
        """Process one frame and return its events, sorted by t, then (y, x).

        Raises:
            InputError: the frame has another size, or is not later than the one before.
        """
        if (frame.width, frame.height) != (self.width, self.height):
            raise InputError(
                f"frame {frame.index} has {frame.width}×{frame.height} pixels, expected {self.width}×{self.height}"
            )
        return self.step_observation(self._observe(frame), frame.time_us)

    def _observe(self, frame: Frame) -> Observation:
        """Return brightness and features of a frame."""
        now = observe(frame, self.planes, self.config)
        if self.config.bandwidth != "fixed" and self.config.method in REGRESSING:
            add_variances(now, frame, self.planes, self.config)
        return now

    def step_observation(self, now: Observation, time_us: int) -> EventBatch:
        """Process brightness and features given directly, for tests at values that no frame can hold.

        Raises:
            InputError: ``time_us`` is not later than the last frame's.
        """
        if self._ready.any() and time_us <= self._time_us:
            raise InputError(f"a frame is at {time_us} µs, expected later than {self._time_us} µs of the one before")
        self._history.append(now)
        valid = now.valid.ravel()
        fresh = np.flatnonzero(valid & ~self._ready)
        running = np.flatnonzero(valid & self._ready)
        events = self._run(now, fresh, running, time_us)
        self._time_us = time_us
        self._ready |= valid
        self.stats.frames += 1
        self.stats.events += len(events)
        self.stats.initialised += len(fresh)
        self.stats.masked += int((~valid).sum())
        return events

    def _run(self, now: Observation, fresh: Pixels, running: Pixels, time_us: int) -> EventBatch:
        boxes = self._boxes(now)
        verdict = self._gate(now, running, boxes)
        pixels = np.concatenate([fresh, running[verdict.solve]])
        alpha, fit = self._regress(now, pixels)
        ref, level, margin = self.ref.reshape(-1), self.level.reshape(-1), self.margin.reshape(-1)
        self.solved.reshape(-1)[:] = False
        self.solved.reshape(-1)[pixels] = True

        before = level[running]
        level[running] = np.clip(
            verdict.predicted, ref[running] - self.config.threshold_off, ref[running] + self.config.threshold_on
        )
        level[pixels] = alpha
        ref[fresh] = alpha[: len(fresh)]

        fitted = running[verdict.solve]
        step = Step(self._time_us, time_us, before[verdict.solve], level[fitted], ref[fitted])
        outcome = apply_rule(step, fitted, self.width, self.config) if len(fitted) else _nothing()
        ref[fitted] = outcome.ref
        margin[running] = np.minimum(margin[running], verdict.margin)
        margin[fitted] = np.minimum(margin[fitted], outcome.margin)
        if fit is not None:
            new = np.concatenate([np.ones(len(fresh), dtype=bool), outcome.fired])
            self.model.replace(pixels[new], fit.take(new), boxes)
            if self._kept is not None:
                self._kept.replace(self._history, pixels[new], self.config)
        self.stats.tested += len(running)
        self.stats.solved += len(fitted) if self.config.method in REGRESSING else 0
        self.stats.many_crossings += outcome.many
        self.stats.most_crossings = max(self.stats.most_crossings, outcome.most)
        self.stats.capped += outcome.capped
        return outcome.events

    def _boxes(self, now: Observation) -> Boxes | None:
        uses_boxes = self.config.method == "esim-ad" and self.config.gate == "radiance"
        return box_means(now, self.config.box) if uses_boxes else None

    def _gate(self, now: Observation, running: Pixels, boxes: Boxes | None) -> Verdict:
        if self.config.method != "esim-ad":
            everywhere = np.ones(len(running), dtype=bool)
            return Verdict(everywhere, np.zeros(len(running)), np.full(len(running), np.inf))
        ref = self.ref.reshape(-1)
        if self._kept is not None and len(running):
            if self.config.gate == "published":
                return published(self.model, self._kept, running, ref, self._history, self.config)
            return delta_r_exact(self.model, self._kept, running, ref, now, self.config)
        if boxes is not None:
            return radiance(self.model, running, ref, now, boxes, self.config)
        return delta_r(self.model, running, ref, now, self.config)

    def _regress(self, now: Observation, pixels: Pixels) -> tuple[F64, Fit | None]:
        if self.config.method not in REGRESSING:
            return now.brightness.ravel()[pixels], None
        fit = fit_pixels(self._history, pixels, self.config, self._solve)
        return level_of(fit.alpha, self.config), fit


def _nothing() -> Outcome:
    none = np.zeros(0)
    return Outcome(empty_batch(), none, np.zeros(0, dtype=bool), 0, 0, 0, none)
