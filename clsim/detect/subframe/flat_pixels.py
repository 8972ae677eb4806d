"""Brightness of pixels that show one flat surface all through a step: albedo is known, and light changes little.

Nothing is traced for them. Whether something else comes over a pixel within the step is told by what surrounds it: all
that could is somewhere around it in the frames at both ends, no farther than surfaces go; so one of them clears it, if
nothing is there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from clsim.detect.config import DetectorConfig
from clsim.detect.features import luminance_weights
from clsim.detect.subframe.between import Motion
from clsim.detect.subframe.knots import Knots, ticks
from clsim.frames import ALBEDO, COVERAGE, RADIANCE, Fineness, Frame, PixelTracer
from clsim.opencl.path import BrightnessPath

F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

_TILE_PX, _EVERY_PX = 8, 2
"""Ways are alike in squares so wide: where the camera alone moves they are those of every other pixel (retracer.py)."""
_SHADOW = 0.2
"""Difference of the log of light, as a mean over nine pixels, between neighbours from which on there is an edge."""
_MOST_LIGHT = 0.25
"""Change of the log of light in a step that may be taken for a straight line."""
_EVEN = 0.015
"""Difference of the log of light from the mean over nine pixels, beyond which rays have found it: it goes in stairs."""
_SAME = 0.02
"""Relative difference from what the frames show, beyond which a pixel shows something else too."""
_LEAST = 0.005
"""Share of a threshold by which brightness may leave the lines between knots."""
_PROMPT = 0.5
"""Share of the error in time that will do, by which it may be late."""
_NEAR = 0.8
"""Share of a threshold from which on a pixel that may show something else is traced."""
_LONGEST = 2.5
"""Thresholds that brightness may go from knot to knot."""


@dataclass(frozen=True)
class FlatBrightness:
    """What is known of pixels that show one flat surface in a step.

    Attributes:
        known: where it is known, ``[H·W]``.
        pixels: those of them where it does not go straight from its start to its end, rising, ``[P]``.
        knots: theirs, numbered from 0.
        unsure: more pixels, of which the same is known unless something else comes over them.
        unsure_knots: theirs, numbered from 0.
    """

    known: Mask
    pixels: I64
    knots: Knots
    unsure: I64
    unsure_knots: Knots

    def peaks(self, references: F32, on: float, off: float) -> tuple[I64, I64]:
        """Return those of the unsure pixels that come near a threshold within the step, and ticks when most so."""
        knots = self.unsure_knots
        if not len(self.unsure):
            return self.unsure, knots.times
        firsts = np.flatnonzero(knots.firsts)
        away = knots.levels - references[self.unsure][knots.pixels]
        farthest = np.zeros(len(away), np.bool_)
        for share in (away / on, -away / off):
            most = np.maximum.reduceat(share, firsts)
            farthest |= (share == most[knots.pixels]) & (share >= _NEAR)
        return self.unsure[knots.pixels[farthest]], knots.times[farthest]

    def that_fire(self, references: F32, on: float, off: float) -> FlatBrightness:
        """Return those pixels that leave the thresholds around their references ``[H·W]``, and come to be known."""
        if not len(self.pixels):
            return self
        firsts = np.flatnonzero(self.knots.firsts)
        highest, lowest = (extreme.reduceat(self.knots.levels, firsts) for extreme in (np.maximum, np.minimum))
        ref = references[self.pixels]
        fires = (highest - ref >= on) | (ref - lowest >= off)
        knots = self.knots.of(fires[self.knots.pixels])
        return replace(self, pixels=self.pixels[fires], knots=knots.renumbered(np.cumsum(fires) - 1))


class FlatPixels:
    """Finds them, and their brightness within a step."""

    def __init__(self, config: DetectorConfig, names: tuple[str, ...], shape: tuple[int, int]) -> None:
        """Prepare for frames with those planes, and that height and width."""
        self._linear = config.event_rule == "linear-light"
        self._threshold = min(config.threshold_on, config.threshold_off)
        self._scale, self._floor, self._shape = config.scale, config.floor, shape
        self._weights = np.array(luminance_weights(config), np.float32)
        self._planes = [names.index(name) for name in (*RADIANCE, *ALBEDO, *COVERAGE) if name in names]
        self._told = len(self._planes) == 7
        self._ends: list[tuple[F32, F32, Mask, Mask]] = []

    def reset(self) -> None:
        """Forget all frames."""
        self._ends.clear()

    def advance(self, frame: Frame, tracer: PixelTracer) -> None:
        """Take notice of the light and of the bounds of surfaces in a frame."""
        bounds = tracer.bounds() if self._told else None
        if bounds is None:
            self._ends.clear()
            return
        planes = frame.planes.reshape(len(frame.names), -1)[self._planes]
        radiance, albedo, coverage = planes[:3], planes[3:6], planes[6]
        weighted = self._weights[:, None] * radiance
        light = np.where(coverage > 0.999, weighted / np.maximum(albedo, 1e-6), np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):
            sharp = np.log(light.sum(axis=0)).reshape(self._shape)
            bright = _blurred(sharp)
            even = np.abs(sharp - bright) < _EVEN
            steep = ~(np.abs(np.diff(bright, axis=1, append=bright[:, -1:])) < _SHADOW)
            steep |= ~(np.abs(np.diff(bright, axis=0, append=bright[-1:])) < _SHADOW)
        self._ends = [*self._ends[-1:], (light, weighted.sum(axis=0), bounds | steep, even)]

    def find(
        self, path: BrightnessPath, tracer: PixelTracer, motion: Motion, ends: tuple[F32, F32], tolerance_us: float
    ) -> FlatBrightness:
        """Return what is known of a step.

        Args:
            path: of the step.
            tracer: what knows what is reflected.
            motion: where surfaces go; nothing is known where they turn back.
            ends: levels at both ends, ``[H·W]``.
            tolerance_us: error of an event's time that will do [µs].
        """
        known = np.zeros(self._shape[0] * self._shape[1], np.bool_)
        nowhere, nothing = np.zeros(0, np.int64), np.zeros(0)
        no_knots = Knots(nowhere, nowhere, nothing, nothing, self._linear)
        none = FlatBrightness(known, nowhere, no_knots, nowhere, no_knots)
        if len(self._ends) < 2 or motion.turns:
            return none
        (light, before, bounds, even), (later, after, later_bounds, later_even) = self._ends
        lowest, highest = _reach(motion.ways)
        # What passes over a pixel was there at the start, and will be there at the end: either of both tells all.
        calm = _free(bounds, -highest, -lowest) | _free(later_bounds, lowest, highest)
        calm = calm.ravel() & ((even & later_even).ravel() | tracer.steady_shadows())
        with np.errstate(divide="ignore", invalid="ignore"):
            steady = np.abs(np.log(later.sum(axis=0) / light.sum(axis=0))) < _MOST_LIGHT
        flat = ~(bounds | later_bounds).ravel()
        pixels = np.flatnonzero(flat & steady & np.isfinite(ends[0]) & np.isfinite(ends[1]))
        if not len(pixels):
            return none
        start, end = ticks(path.start_us), ticks(path.end_us)
        late, finest = _PROMPT * tolerance_us / (path.end_us - path.start_us), 4.0 / (end - start)
        fineness = Fineness(_LEAST * self._threshold, late, _LONGEST * self._threshold, finest, self._linear)
        both = np.concatenate([light, later])
        found = tracer.reflected(pixels, both, path.start_us * 1e-6, path.end_us * 1e-6, fineness)
        known[found.known] = calm[found.known]
        firsts, lasts = found.firsts[:-1], found.firsts[1:] - 1
        like = np.abs(found.values[firsts] / before[found.pixels] - 1.0) < _SAME
        like &= np.abs(found.values[lasts] / after[found.pixels] - 1.0) < _SAME
        known[found.pixels[~like]] = False
        lengths = np.diff(found.firsts)
        number = np.repeat(np.arange(len(lengths)), lengths)
        levels = np.log(np.maximum(self._scale * found.values, self._floor)).astype(np.float64)
        levels[firsts], levels[lasts] = ends[0][found.pixels], ends[1][found.pixels]
        times = np.round(start + found.shares.astype(np.float64) * (end - start)).astype(np.int64)
        parts = []
        for chosen in (like & calm[found.pixels], like & ~calm[found.pixels]):
            kept = chosen[number]
            order = np.cumsum(chosen) - 1
            knots = Knots(order[number[kept]], times[kept], levels[kept], np.zeros(int(kept.sum())), self._linear)
            parts.append((found.pixels[chosen], knots))
        return FlatBrightness(known, *parts[0], *parts[1])


def _reach(ways: F32) -> tuple[I64, I64]:
    """Return how far left and up, and right and down, surfaces near each square go in a step, ``[2, rows, columns]``.

    Squares are `_TILE_PX` pixels wide and high.
    """
    height, width = ways.shape[2:]
    ways = ways[:, :, ::_EVERY_PX, ::_EVERY_PX]
    rows, columns, part = -(-height // _TILE_PX), -(-width // _TILE_PX), _TILE_PX // _EVERY_PX
    more = ((0, 0), (0, rows * part - ways.shape[2]), (0, columns * part - ways.shape[3]))
    found = []
    for extreme, sign in ((ways.max(axis=0), 1), (-ways.min(axis=0), -1)):
        tiled = np.pad(extreme, more, mode="edge").reshape(2, rows, part, columns * part).max(axis=2)
        tiled = np.maximum(tiled.reshape(2, rows, columns, part).max(axis=3), 0.0)
        found.append((tiled, sign))
    # Nothing farther away than the longest way comes over a pixel.
    near = int(np.ceil(max(float(tiled.max()) for tiled, _ in found) / _TILE_PX))
    reach = []
    for tiled, sign in found:
        padded = np.pad(tiled, ((0, 0), (near, near), (near, near)), mode="edge")
        along = np.lib.stride_tricks.sliding_window_view(padded, 2 * near + 1, axis=2).max(axis=3)
        around = np.lib.stride_tricks.sliding_window_view(along, 2 * near + 1, axis=1).max(axis=3)
        reach.append(sign * np.ceil(around).astype(np.int64))
    return reach[1], reach[0]


def _blurred(image: F32) -> F32:
    """Return the mean of each pixel and its eight neighbours, ``[H, W]``."""
    padded = np.pad(image, 1, mode="edge")
    rows = padded[:-2] + padded[1:-1] + padded[2:]
    return np.asarray((rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]) / 9, np.float32)


def _free(bounds: Mask, lowest: I64, highest: I64) -> Mask:
    """Return which pixels have no bound from ``lowest`` to ``highest`` away; there are some outside.

    Both are those of squares, ``[2, rows, columns]``.
    """
    height, width = bounds.shape
    rows, columns = lowest.shape[1:]
    sums = np.zeros((height + 1, width + 1), np.int32)
    sums[1:, 1:] = bounds.cumsum(axis=0, dtype=np.int32).cumsum(axis=1)
    # A pixel is a square and a place in it: [rows, place, columns, place].
    x = np.arange(columns * _TILE_PX).reshape(columns, _TILE_PX)
    y = np.arange(rows * _TILE_PX).reshape(rows, _TILE_PX)[:, :, None]
    left, right = (x + along[0, :, None, :, None] for along in (lowest, highest + 1))
    top, bottom = (y[..., None] + down[1, :, None, :, None] for down in (lowest, highest + 1))
    inside = ((left >= 0) & (right <= width)) & ((top >= 0) & (bottom <= height))
    left, right = np.clip(left, 0, width), np.clip(right, 0, width)
    top, bottom = (np.clip(side, 0, height) * (width + 1) for side in (top, bottom))
    count = sums.take(bottom + right) - sums.take(top + right) - sums.take(bottom + left) + sums.take(top + left)
    free = (inside & (count == 0)).reshape(rows * _TILE_PX, columns * _TILE_PX)
    return np.asarray(free[:height, :width], np.bool_)
