"""Events at their own times: pixels are traced between two frames until it is known when they cross a threshold.

Between frames brightness is taken for linear in time, which is wrong by what it bends. A pixel whose forecast bends
near a threshold is traced at the bends; then each piece in which a threshold is crossed is parted where the crossing is
expected, until what is found there no longer moves it: regula falsi with an estimate of the error, for all pixels at a
time. Steps in time that follow the brightness are ESIM's idea (Rebecq et al., CoRL 2018), there for whole pictures.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from clsim.detect.config import DetectorConfig
from clsim.detect.subframe.between import F32, I64, Between, Motion, union
from clsim.detect.subframe.flat_pixels import FlatBrightness, FlatPixels
from clsim.detect.subframe.forecast import MOMENTS, Forecast
from clsim.detect.subframe.knots import TICKS_PER_S, Knots, join, ticks, vague
from clsim.frames import Frame, PixelTracer
from clsim.opencl.path import BrightnessPath
from clsim.opencl.workplace import Buffer, Grid, Workplace

LONGEST_WAY_PX = 12.0
"""Where surfaces go farther in a step, pictures between its ends are traced, so that ways are no longer."""
_MOST_PARTS = 32


class Refiner(Between):
    """Traces pixels where and when they cross thresholds.

    Attributes:
        tolerance_us: error of an event's time that will do [µs].
    """

    def __init__(
        self,
        place: Workplace[Grid],
        config: DetectorConfig,
        names: tuple[str, ...],
        tracer: PixelTracer,
        tolerance_us: float,
    ) -> None:
        """Build the kernel.

        Args:
            place: where brightness is.
            config: thresholds and method.
            names: planes of the frames.
            tracer: traces pixels.
            tolerance_us: error of an event's time that will do [µs].
        """
        super().__init__(place, config, names, tracer)
        self.tolerance_us = tolerance_us
        self._linear_light = config.event_rule == "linear-light"
        self._forecast = Forecast(place, self._on, self._off, self._linear_light)
        self._flat = FlatPixels(config, names, self._shape)
        self._images: list[Buffer] = []

    def reset(self) -> None:
        """Forget the last frame."""
        super().reset()
        self._flat.reset()

    def _advance(self, frame: Frame, rested: bool) -> None:
        # Where nothing moves this is for nothing; so it is not known of the first step of a motion.
        if rested:
            self._flat.reset()
        else:
            self._flat.advance(frame, self._tracer)

    def _find(self, path: BrightnessPath, motion: Motion, references: Buffer) -> BrightnessPath:
        start, end, ref = (self._image(buffer).ravel() for buffer in (path.start, path.end, references))
        flat = self._flat.find(path, self._tracer, motion, (start, end), self.tolerance_us)
        traced = np.where(flat.known, np.nan, ref).astype(np.float32)
        times, levels = self._pictures(path, motion, ~flat.known, start, end)
        for level, time in zip(levels[1:-1], times[1:-1], strict=True):
            level[flat.pixels] = flat.knots.at(int(time))
        with np.errstate(invalid="ignore"):
            reached = (levels[1:] - traced >= self._on) | (traced - levels[1:] >= self._off)
        may = np.asarray(reached.any(axis=0), np.bool_)
        marked, marks = self._marks(path, self._uploaded(2, traced), times, levels, motion.ways)
        may[marked] = True
        peaked, peaks = self._peaks(flat, np.where(may, np.nan, ref), times)
        may[peaked] = True
        marked, marks = np.concatenate([marked, peaked]), np.concatenate([marks, peaks])
        active = np.flatnonzero(may & np.isfinite(levels[0]) & np.isfinite(levels[-1]) & np.isfinite(traced))
        place = np.full(len(ref), -1, np.int64)
        place[active] = np.arange(len(active))
        inside = place[marked] >= 0
        knots = self._first_knots(path, active, (place[marked[inside]], marks[inside]), times, levels[:, active])
        knots = self._sharpen(path, active, knots, ref[active].astype(np.float64))
        flat = flat.that_fire(ref, self._on, self._off)
        every = union(len(ref), active, flat.pixels)
        if not len(every):
            return path
        parts = (knots, active), (flat.knots, flat.pixels)
        both = join([part.renumbered(np.searchsorted(every, own)) for part, own in parts])
        return self._with_knots(path, both, every)

    def _pictures(
        self, path: BrightnessPath, motion: Motion, unknown: npt.NDArray[np.bool_], start: F32, end: F32
    ) -> tuple[I64, F32]:
        """Return ticks ``[P]`` and levels ``[P, H·W]`` of both ends, and of times between if ways are long or turn.

        They are traced for pixels that are ``unknown`` and touched by what moves; others' levels are straight in time.
        """
        halvings = int(np.ceil(np.log2(max(motion.longest_px, 1e-6) / LONGEST_WAY_PX)))
        parts = min(_MOST_PARTS, 2 ** max(1 if motion.turns else 0, halvings))
        times = np.linspace(ticks(path.start_us), ticks(path.end_us), parts + 1).round().astype(np.int64)
        levels = np.linspace(start, end, parts + 1, dtype=np.float32)
        levels[-1] = end
        if parts > 1:
            touched = np.any(motion.ways, axis=(0, 1)) | np.any(motion.halves, axis=(0, 1))
            pixels = np.flatnonzero(touched.ravel() & unknown)
            found = self._trace(path, np.tile(pixels, parts - 1), np.repeat(times[1:-1], len(pixels)))
            levels[1:-1, pixels] = found.reshape(parts - 1, -1)
        return times, levels

    def _marks(self, path: BrightnessPath, references: Buffer, times: I64, levels: F32, ways: F32) -> tuple[I64, I64]:
        """Return pixels, and ticks at which their brightness should be known, by forecasts between pictures."""
        pixels, marks = [], []
        ends = path.start, path.end
        for k, (begins, closes) in enumerate(pairwise(times.tolist())):
            if len(times) > 2:
                moved = self._tracer.motion(begins / TICKS_PER_S, closes / TICKS_PER_S)
                if moved is None:
                    continue
                ways = moved
                ends = self._uploaded(0, levels[k]), self._uploaded(1, levels[k + 1])
            found, moments = self._forecast.marks(*ends, references, ways)
            found, at = _on_grid(found, begins + moments * ((closes - begins) / MOMENTS), begins, closes)
            pixels.append(found)
            marks.append(at)
        return np.concatenate([*pixels, np.zeros(0, np.int64)]), np.concatenate([*marks, np.zeros(0, np.int64)])

    def _peaks(self, flat: FlatBrightness, references: F32, times: I64) -> tuple[I64, I64]:
        """Return pixels, and ticks at which they may fire by themselves, each once; at ``times`` they are known."""
        told = flat.peaks(references, self._on, self._off)
        pixels, at = np.unique(np.stack(_on_grid(*told, times[0], times[-1])), axis=1)
        new = ~np.isin(at, times)
        return pixels[new], at[new]

    def _first_knots(self, path: BrightnessPath, active: I64, marks: tuple[I64, I64], times: I64, levels: F32) -> Knots:
        """Trace ``marks``, rows of ``active`` and ticks; ``levels`` ``[P, active]`` are known at ``times``."""
        rows, asked = marks
        every = np.arange(len(active))
        pixels = np.concatenate([np.tile(every, len(times)), rows])
        all_times = np.concatenate([np.repeat(times, len(active)), asked])
        found = np.concatenate([levels.ravel().astype(np.float64), self._trace(path, active[rows], asked)])
        order = np.lexsort((all_times, pixels))
        unknown = np.full(len(pixels), np.inf)
        knots = Knots(pixels[order], all_times[order], found[order], unknown, self._linear_light)
        knots.guess_error_bounds()
        return knots

    def _sharpen(self, path: BrightnessPath, active: I64, knots: Knots, references: npt.NDArray[np.float64]) -> Knots:
        """Return what is known once it is known when thresholds are crossed."""
        tolerance = self.tolerance_us * TICKS_PER_S / 1e6
        least = max(2, int(tolerance))
        done: list[Knots] = []
        # Errors fall by more than a half each time.
        for _ in range(max(1, math.ceil((path.end_us - path.start_us) / self.tolerance_us).bit_length())):
            pieces, times = vague(knots, references, self._on, self._off, tolerance, least)
            wanting = np.zeros(len(active), bool)
            wanting[knots.pixels[pieces]] = True
            left = wanting[knots.pixels]
            done.append(knots.of(~left))
            pieces = (np.cumsum(left) - 1)[pieces]
            knots = knots.of(left)
            if not len(pieces):
                break
            knots.insert(pieces, times, self._trace(path, active[knots.pixels[pieces]], times))
            self.stats.rounds += 1
        return join([*done, knots])

    def _uploaded(self, number: int, levels: F32) -> Buffer:
        """Return an image on the device that holds levels ``[H·W]``."""
        height, width = self._shape
        while len(self._images) <= number:
            self._images.append(self._place.allocate(self._place.layout.image_shape))
        image = np.zeros(self._place.layout.image_shape, self._place.real)
        image[:, :width] = levels.reshape(height, width)
        self._place.write(self._images[number], image)
        return self._images[number]


def _on_grid(pixels: I64, times: npt.NDArray[np.floating | np.integer], begins: int, closes: int) -> tuple[I64, I64]:
    """Return pixels and ticks with these moved to where those of any frame rate are; none at the ends of a step."""
    grid = 2 ** max(0, (int(closes - begins) // MOMENTS).bit_length() - 1)
    at = np.round(times / grid).astype(np.int64) * grid
    inside = (at > begins) & (at < closes)
    return pixels[inside], at[inside]
