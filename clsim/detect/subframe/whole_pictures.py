"""Whole pictures between two frames, as many as the fastest motion in the picture asks for.

That is ESIM's second rule (Rebecq et al., CoRL 2018, section 4.2, λ_v): from one picture to the next nothing goes
farther than λ pixels. So one fast pixel sets the pace of all; it is here as what tracing chosen pixels must beat.
"""

from __future__ import annotations

import math

import numpy as np

from clsim.detect.config import DetectorConfig
from clsim.detect.subframe.between import F32, Between, Motion
from clsim.detect.subframe.knots import Knots, ticks
from clsim.frames import Frame, PixelTracer
from clsim.opencl.path import BrightnessPath
from clsim.opencl.workplace import Buffer, Grid, Workplace

MOST_PARTS = 1024
"""Parts of a step at most, so that memory does not grow."""


class WholePictures(Between):
    """Traces all pixels at equal steps between two frames."""

    def __init__(
        self, place: Workplace[Grid], config: DetectorConfig, names: tuple[str, ...], tracer: PixelTracer, way_px: float
    ) -> None:
        """Prepare; between two pictures nothing goes farther than ``way_px`` [pixels]."""
        super().__init__(place, config, names, tracer)
        self._way_px = way_px

    def _advance(self, frame: Frame, rested: bool) -> None:
        """Take notice of nothing: all of a picture is traced."""

    def _find(self, path: BrightnessPath, motion: Motion, references: Buffer) -> BrightnessPath:
        parts = min(MOST_PARTS, math.ceil(motion.longest_px / self._way_px))
        if parts < 2:
            return path
        start, end, ref = (self._image(buffer).ravel() for buffer in (path.start, path.end, references))
        times = np.linspace(ticks(path.start_us), ticks(path.end_us), parts + 1).round().astype(np.int64)
        pixels = np.flatnonzero(np.isfinite(start) & np.isfinite(end) & np.isfinite(ref))
        levels: F32 = np.empty((parts + 1, len(pixels)), np.float32)
        levels[0], levels[-1] = start[pixels], end[pixels]
        for k in range(1, parts):
            levels[k] = self._trace(path, pixels, np.full(len(pixels), times[k]))
        self.stats.rounds += parts - 1
        change = levels[1:] - ref[pixels]
        fires = ((change >= self._on) | (-change >= self._off)).any(axis=0)
        fired = int(np.count_nonzero(fires))
        found = levels[:, fires].T.astype(np.float64).ravel()
        knots = Knots(np.repeat(np.arange(fired), parts + 1), np.tile(times, fired), found, np.zeros(len(found)))
        return self._with_knots(path, knots, pixels[fires]) if fired else path
