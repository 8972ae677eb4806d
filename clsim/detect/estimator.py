"""Frames in, brightness out, in OpenCL."""

from __future__ import annotations

from typing import Any

import numpy as np

from clsim.detect.config import DetectorConfig
from clsim.detect.gate import Counts, Levels
from clsim.detect.interest import Interest
from clsim.detect.methods import method_of
from clsim.detect.methods.base import Setting, Stages
from clsim.detect.pack import FrameMemory, first_features
from clsim.detect.wlr import History
from clsim.errors import InputError
from clsim.frames import Frame, InterestMap
from clsim.frames.frame import FloatArray
from clsim.opencl.device import Device
from clsim.opencl.path import BrightnessPath
from clsim.opencl.workplace import Buffer, Grid


class BrightnessEstimator:
    """Estimates how bright each pixel is, by the method of a `DetectorConfig`, and which pixels may fire.

    A step is `observe`, then, once a sensor has said which pixels fired, `learn`.

    Attributes:
        stages: the method's kernels and memory; None until `prepare` or the first frame has made them.
        levels: brightness at both ends of the last step; None as long.
    """

    def __init__(self, config: DetectorConfig, grid: Grid, names: tuple[str, ...], device: Device, queue: Any) -> None:
        """Prepare for frames with the planes ``names``; kernels are built at the first frame.

        Raises:
            InputError: a plane is missing, or ``config`` asks for what takes recorded frames.
        """
        config.check_stream()
        method = method_of(config.method)
        method.check_planes(config, names)
        self._method = method
        self._setting = Setting(config, names, grid, device, queue)
        self._candidates = method.candidates(config, names)
        self.stages: Stages | None = None
        self._memory = FrameMemory(device, queue)
        self.levels: Levels | None = None
        self._interest: Interest | None = None
        self._constant = np.zeros((0, 2), dtype=np.float32)
        self._time_us = 0
        self._slot = 0
        self._frames = 0
        self._history = History(0, 0, False)
        self._invalid = [0] * config.history
        self._any_ready = False

    @property
    def features(self) -> tuple[str, ...]:
        """Planes in the regression; those that have been constant so far are left out."""
        return self.stages.features if self.stages else ()

    def reset(self) -> None:
        """Forget all levels: the next frame is a first one."""
        self._frames = 0
        self._any_ready = False
        if self.levels is not None and self.stages is not None:
            for buffer in (self.levels.start, self.levels.end):
                self.stages.place.write(buffer, np.full(buffer.shape, np.nan, dtype=buffer.dtype))

    def close(self) -> None:
        """Release the device's memory; safe to call twice."""
        self._memory.close()
        self.stages = self.levels = self._interest = None

    def solved(self, counts: Counts) -> int:
        """Return how many regressions of tested pixels were solved in a step."""
        return self._method.solved(counts)

    def prepare(self, references: Buffer) -> None:
        """Build kernels now, unless they depend on what the first frame shows; ``references`` as in `observe`."""
        if self.stages is None and not self._candidates:
            self._begin((), references)

    def observe(self, frame: Frame, references: Buffer) -> tuple[BrightnessPath, Counts]:
        """Return the brightness from the last frame to this one, and how many pixels of each kind there are.

        Args:
            frame: the frame, with the planes and size prepared for.
            references: ``[H, span]``, level of each pixel's last event, as the sensor keeps it; NaN where it has none.

        Raises:
            InputError: the frame has another size or other planes, or is not later than the one before.
        """
        self._check(frame)
        config = self._setting.config
        if self.stages is None:
            self._begin(first_features(frame, self._candidates), references)
        assert self.stages is not None and self.levels is not None, "both are made together"
        self._slot = (self._slot + 1) % config.history
        stages = self.stages = self._pack(frame, self.stages)
        self._frames = min(self._frames + 1, config.history)
        used = [self._invalid[(self._slot - age) % config.history] for age in range(self._frames)]
        self._history = History(self._slot, self._frames, any(used))
        self.levels.advance()
        counts = stages.observe(self._history, self.levels, references, with_error=self._interest is not None)
        levels, pixels = self.levels, stages.gate.pixels
        path = BrightnessPath(self._time_us, frame.time_us, levels.start, levels.end, pixels, counts.listed)
        self._time_us = frame.time_us
        self._any_ready = self._any_ready or counts.listed + counts.kept > 0
        return path, counts

    def learn(self, path: BrightnessPath, crossings: Buffer) -> None:
        """Take notice of which pixels fired: ``crossings`` is not 0 there, for each listed pixel of ``path``."""
        if self.stages is not None:
            self.stages.learn(path.count, crossings, self._history)

    def level(self) -> FloatArray:
        """Return the brightness [natural-log units] of each pixel at the last frame, ``[H, W]``.

        It is the regression's or, where none was solved, what the model of the pixel's last event predicts; with
        ``irradiance``, the window's; with ``esim``, the frame's own. NaN before a pixel's first valid frame.
        """
        grid = self._setting.grid
        if self.stages is None or self.levels is None:
            return np.full((grid.height, grid.width), np.nan, dtype=np.float32)
        level = self.stages.place.read(self.levels.end)
        return np.ascontiguousarray(level[:, : grid.width], dtype=np.float32)

    def error(self) -> FloatArray | None:
        """Return the standard error of brightness at the last frame, ``[H, W]``; None where nobody knows it."""
        found = None if self.stages is None else self.stages.error
        if self.stages is None or found is None:
            return None
        return np.asarray(self.stages.place.read(found)[:, : self._setting.grid.width], dtype=np.float32)

    def interest(self, number: int, references: Buffer) -> InterestMap:
        """Return how close each pixel is to firing after the last frame, which is the ``number``-th.

        Ask after every frame. ``stderr`` is 0 but for method `irradiance`, where it is the weighted standard error of
        the window's mean.

        Raises:
            ValueError: there was no frame yet.
        """
        if self.stages is None or self.levels is None:
            raise ValueError("no frame yet")
        if self._interest is None:
            self._interest = Interest(self.stages.place)
        return InterestMap(number, *self._interest.measure(self.levels, references, self.stages.error))

    def _check(self, frame: Frame) -> None:
        grid, names = self._setting.grid, self._setting.names
        if (frame.width, frame.height) != (grid.width, grid.height):
            raise InputError(
                f"frame {frame.index} has {frame.width}×{frame.height} pixels, expected {grid.width}×{grid.height}"
            )
        if frame.names != names:
            raise InputError(f"frame {frame.index} has the planes {frame.names}, expected {names}")
        if self._any_ready and frame.time_us <= self._time_us:
            raise InputError(
                f"frame {frame.index} is at {frame.time_us} µs, expected a time after {self._time_us} µs (last frame)"
            )

    def _begin(self, features: tuple[str, ...], references: Buffer) -> None:
        config = self._setting.config
        self.stages = self._build(features)
        start, end = (self.stages.place.allocate(references.shape, fill=np.nan) for _ in range(2))
        self.levels = Levels(start, end, config.threshold_on, config.threshold_off)

    def _build(self, features: tuple[str, ...]) -> Stages:
        quiet = tuple(name for name in self._candidates if name not in features)
        self._constant = np.tile(np.array([np.inf, -np.inf], dtype=np.float32), (len(quiet), 1))
        return self._method.build(self._setting, features, quiet)

    def _pack(self, frame: Frame, stages: Stages) -> Stages:
        stages.pack.run(self._memory.lend(frame), self._slot)
        self._memory.take_back(frame)
        self._invalid[self._slot], extremes = stages.found()
        return self._grown(frame, stages, extremes) if len(extremes) else stages

    def _grown(self, frame: Frame, stages: Stages, extremes: FloatArray) -> Stages:
        """Return stages that regress on what is constant no longer, too, with the frame packed."""
        seen = self._constant.copy()
        self._constant[:, 0] = np.minimum(seen[:, 0], extremes[:, 0])
        self._constant[:, 1] = np.maximum(seen[:, 1], extremes[:, 1])
        grown = self._constant[:, 0] < self._constant[:, 1]
        if not grown.any():
            return stages
        woken = {name for name, is_grown in zip(stages.quiet, grown, strict=True) if is_grown}
        values = {name: float(lo) for name, (lo, _) in zip(stages.quiet, seen, strict=True)}
        kept = dict(zip(stages.quiet, self._constant, strict=True))
        larger = self._build(tuple(n for n in self._candidates if n in woken or n in stages.features))
        for i, name in enumerate(larger.quiet):
            self._constant[i] = kept[name]
        larger.take_over(stages, values, self._setting.config.history)
        larger.pack.run(self._memory.lend(frame), self._slot)
        self._memory.take_back(frame)
        return larger
