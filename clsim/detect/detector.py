"""The detector: frames in, events out, in OpenCL."""

from __future__ import annotations

import numpy as np

from clsim.detect.config import REGRESSING, DetectorConfig
from clsim.detect.engine import Engine
from clsim.detect.events import Interval
from clsim.detect.gate import Counts
from clsim.detect.irradiance import check_planes
from clsim.detect.pack import first_features
from clsim.detect.reference.observation import check_variance, feature_names
from clsim.detect.stats import DetectorStats
from clsim.detect.wlr import History
from clsim.errors import InputError
from clsim.events import EventBatch, empty_batch
from clsim.frames import RADIANCE, Frame, InterestMap
from clsim.frames.frame import FloatArray
from clsim.opencl.device import Device, choose_device

SPARSE_SHARE = 0.5
"""Below this share of pixels to solve, a list of them is faster than solving all (measured, random pixels)."""
_STATE_LEVEL = 1
"""Plane of the state that is called S_LEVEL in common.clh."""


class Detector:
    """Turns frames into events by the method, gate and rule of a `DetectorConfig`.

    The methods are ESIM, WLR + ESIM and ESIM with adaptive denoising (Tsuji et al., ICIP 2023), the latter also with
    the radiance gate, and ESIM on smoothed irradiance. `clsim.detect.reference` is the same in float64 numpy.
    """

    def __init__(
        self, config: DetectorConfig, width: int, height: int, names: tuple[str, ...], *, device: Device | None = None
    ) -> None:
        """Prepare for frames of ``width`` × ``height`` with the planes ``names``; kernels are built at the first frame.

        Raises:
            InputError: a plane is missing, the gate needs recorded frames, or there is no OpenCL device.
        """
        if config.method == "esim-ad" and config.gate not in ("delta-r", "radiance"):
            raise InputError(f"`gate` {config.gate} needs old windows; expected delta-r or radiance for a stream")
        if config.method in REGRESSING and config.bandwidth != "fixed":
            raise InputError(f"`bandwidth` {config.bandwidth} is for recorded frames; expected fixed for a stream")
        for name in RADIANCE:
            if name not in names:
                raise InputError(f"the frames have no plane {name!r}, expected {', '.join(RADIANCE)}")
        if config.method == "irradiance":
            check_planes(names)
        check_variance(config, names)
        self.config = config
        self.width, self.height, self.names = width, height, names
        self.device = device or choose_device()
        self.stats = DetectorStats()
        self._candidates = feature_names(config, names) if config.method in REGRESSING else ()
        self._engine: Engine | None = None
        self._constant = np.zeros((0, 2), dtype=np.float32)
        self._time_us = 0
        self._slot = 0
        self._frames = 0
        self._invalid = [0] * config.history
        self._any_ready = False
        self._interest_wanted = False

    @property
    def features(self) -> tuple[str, ...]:
        """Planes in the regression; those that have been constant so far are left out."""
        return self._engine.features if self._engine else ()

    def reset(self) -> None:
        """Forget all references, as at the seam of a loop: the next frame initialises again and fires nothing."""
        self._frames = 0
        self._any_ready = False
        if self._engine is not None:
            self._engine.forget()

    def close(self) -> None:
        """Release the device's memory; safe to call twice."""
        if self._engine is not None:
            self._engine.memory.close()
            self._engine = None

    def step(self, frame: Frame) -> EventBatch:
        """Process one frame and return its events, sorted by t, then (y, x).

        Raises:
            InputError: the frame has another size or other planes, or is not later than the one before.
        """
        self._check(frame)
        if self._engine is None:
            self._engine = self._build(first_features(frame, self._candidates))
        self._slot = (self._slot + 1) % self.config.history
        engine = self._engine = self._pack(frame, self._engine)
        self._frames = min(self._frames + 1, self.config.history)
        used = [self._invalid[(self._slot - age) % self.config.history] for age in range(self._frames)]
        history = History(self._slot, self._frames, any(used))
        if self._interest_wanted:
            engine.interest.keep(engine.state)
        events, counts = self._run(engine, history, frame.time_us)
        self._time_us = frame.time_us
        self._any_ready = self._any_ready or counts.listed + counts.kept > 0
        stats = self.stats
        stats.frames += 1
        stats.events += len(events)
        stats.initialised += counts.fresh
        stats.masked += counts.invalid
        stats.tested += counts.kept + counts.solved
        if self.config.method == "wlr-esim":
            stats.solved += counts.kept + counts.solved
        elif self.config.method == "esim-ad":
            stats.solved += counts.solved
        return events

    def level(self) -> FloatArray:
        """Return the brightness [natural-log units] of each pixel at the last frame, ``[H, W]``, for people to look at.

        It is the regression's or, where none was solved, what the model of the pixel's last event predicts; with
        ``irradiance``, the window's; with ``esim``, the frame's own. NaN before a pixel's first valid frame.
        """
        if self._engine is None:
            return np.full((self.height, self.width), np.nan, dtype=np.float32)
        state = self._engine.workplace.read(self._engine.state)
        return np.ascontiguousarray(state[:, _STATE_LEVEL, : self.width], dtype=np.float32)

    def interest(self) -> InterestMap:
        """Return how close each pixel is to firing after the last frame.

        Ask after every frame, from the first on: the first call begins to keep what later ones need, and its ``change``
        is 0. ``stderr`` is 0 but for method `irradiance`, where it is the weighted standard error of the window's mean.

        Raises:
            ValueError: there was no frame yet.
        """
        engine = self._engine
        if engine is None:
            raise ValueError("no frame yet")
        error = None
        if engine.smoothing is not None:
            if not self._interest_wanted:
                engine.smoothing.run(engine.pack.packed, with_error=True)
            error = engine.smoothing.error
        self._interest_wanted = True
        return InterestMap(self.stats.frames - 1, *engine.interest.measure(engine.state, error))

    def _check(self, frame: Frame) -> None:
        if (frame.width, frame.height) != (self.width, self.height):
            raise InputError(
                f"frame {frame.index} has {frame.width}×{frame.height} pixels, expected {self.width}×{self.height}"
            )
        if frame.names != self.names:
            raise InputError(f"frame {frame.index} has the planes {frame.names}, expected {self.names}")
        if self._any_ready and frame.time_us <= self._time_us:
            raise InputError(
                f"frame {frame.index} is at {frame.time_us} µs, expected a time after {self._time_us} µs (last frame)"
            )

    def _build(self, features: tuple[str, ...]) -> Engine:
        quiet = tuple(name for name in self._candidates if name not in features)
        self._constant = np.tile(np.array([np.inf, -np.inf], dtype=np.float32), (len(quiet), 1))
        return Engine(self.config, (self.width, self.height), self.names, features, quiet, self.device)

    def _pack(self, frame: Frame, engine: Engine) -> Engine:
        memory = engine.memory.lend(frame)
        invalid, extremes = engine.pack.run(memory, self._slot)
        grown = np.zeros(0, dtype=bool)
        if len(extremes):
            seen = self._constant.copy()
            self._constant[:, 0] = np.minimum(seen[:, 0], extremes[:, 0])
            self._constant[:, 1] = np.maximum(seen[:, 1], extremes[:, 1])
            grown = self._constant[:, 0] < self._constant[:, 1]
        if grown.any():
            woken = {name for name, is_grown in zip(engine.quiet, grown, strict=True) if is_grown}
            values = {name: float(lo) for name, (lo, _) in zip(engine.quiet, seen, strict=True)}
            kept = dict(zip(engine.quiet, self._constant, strict=True))
            larger = self._build(tuple(n for n in self._candidates if n in woken or n in engine.features))
            for i, name in enumerate(larger.quiet):
                self._constant[i] = kept[name]
            larger.take_over(engine, values)
            engine.memory.take_back(frame)
            engine.memory.close()
            memory = larger.memory.lend(frame)
            larger.pack.run(memory, self._slot)
            engine = larger
        engine.memory.take_back(frame)
        self._invalid[self._slot] = invalid
        return engine

    def _run(self, engine: Engine, history: History, time_us: int) -> tuple[EventBatch, Counts]:
        config, gate, fit = self.config, engine.gate, engine.regression
        packed, start, level = engine.pack.packed, engine.pack.offset(history.slot), engine.level(history.slot)
        if config.method == "esim-ad":
            gate.average(packed, start)
            gate.test_models(packed, start, engine.state)
        else:
            if fit is not None:
                fit.prepare(history.slot)
                fit.dense(history)
            if engine.smoothing is not None:
                engine.smoothing.run(packed, with_error=self._interest_wanted)
            gate.test_levels(packed, start, level, engine.state)
        counts = gate.collect()
        if config.method == "esim-ad" and fit is not None:
            if counts.listed or config.history > 1:
                fit.prepare(history.slot)
            if counts.listed > SPARSE_SHARE * self.width * self.height:
                fit.dense(history)
            elif counts.listed:
                fit.sparse(history, gate.pixels, counts.listed)
        if counts.listed == 0:
            return empty_batch(), counts
        fired = engine.rule.apply(counts.listed, level, engine.state, history, Interval(self._time_us, time_us))
        self.stats.many_crossings += fired.many_crossings
        self.stats.most_crossings = max(self.stats.most_crossings, fired.most_crossings)
        self.stats.capped += fired.capped
        return fired.events, counts
