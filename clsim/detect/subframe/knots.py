"""Brightness at chosen times between two frames, pixel by pixel: what is known, and where more should be.

Times are counted in ticks of 2⁻¹⁵/30 s, about 1 µs, from time 0. New ones lie at multiples of powers of 2, whatever the
frames' times: so the same scene is asked at the same times at any frame rate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

TICKS_PER_S = 30 * 2**15
CAUTION = 1.25
"""Brightness may bend so many times as sharply as a parabola through what is known: it has corners."""
_NEAREST = 0.125
"""Share of a piece that a new time keeps from both its ends."""


def ticks(time_us: int) -> int:
    """Return the tick nearest to a time [µs]."""
    return round(time_us * TICKS_PER_S / 1e6)


@dataclass
class Knots:
    """Levels of some pixels at some times of a step, sorted by pixel, then by time; each has its first and its last.

    A *piece* is what lies between a knot and the one before it, and has the later one's number.

    Attributes:
        pixels: which pixel, a number from 0 on, ``[K]``.
        times: [ticks], ``[K]``.
        levels: [natural-log units], ``[K]``.
        error_bounds: by how much the level may leave the line of a piece, ``[K]``; infinite where nobody knows.
        linear_light: whether light is linear in time between knots; else its logarithm is, which levels are.
    """

    pixels: I64
    times: I64
    levels: F64
    error_bounds: F64
    linear_light: bool = False

    @property
    def firsts(self) -> Mask:
        """Which knots are the first of a pixel, so that no piece ends there."""
        return np.diff(self.pixels, prepend=-1) > 0

    def insert(self, before: I64, times: I64, levels: F64) -> None:
        """Add knots in the pieces ``before``, rising, one in each, and learn how their brightness bends."""
        last, first = before, before - 1
        span = (self.times[last] - self.times[first]).astype(np.float64)
        share = (times - self.times[first]) / span
        straight = self._on_line(self.levels[first], self.levels[last], share)
        # The parabola through the three leaves a line over the whole piece by so much.
        bend = CAUTION * np.abs(levels - straight) / (4.0 * share * (1.0 - share))
        self.error_bounds[last] = bend * (1.0 - share) ** 2
        self.pixels = np.insert(self.pixels, before, self.pixels[last])
        self.times = np.insert(self.times, before, times)
        self.levels = np.insert(self.levels, before, levels)
        self.error_bounds = np.insert(self.error_bounds, before, bend * share**2)

    def of(self, chosen: Mask) -> Knots:
        """Return the knots of some pixels, all of each."""
        rows = self.pixels[chosen], self.times[chosen], self.levels[chosen], self.error_bounds[chosen]
        return Knots(*rows, self.linear_light)

    def renumbered(self, numbers: I64) -> Knots:
        """Return the same with other numbers of pixels, rising, for those from 0 on."""
        return replace(self, pixels=numbers[self.pixels])

    def at(self, time: int) -> F64:
        """Return the level of each pixel at a time [ticks] within the step."""
        if not len(self.pixels):
            return np.zeros(0)
        later = int(self.times.max()) + 1
        last = np.searchsorted(self.pixels * later + self.times, np.arange(self.pixels[-1] + 1) * later + time)
        first = last - 1
        share = (time - self.times[first]) / (self.times[last] - self.times[first])
        return self._on_line(self.levels[first], self.levels[last], share)

    def guess_error_bounds(self) -> None:
        """Take what is not known of a piece from how the slope changes at both its ends."""
        inside = ~self.firsts
        spans = np.where(inside, np.diff(self.times, prepend=0), 1).astype(np.float64)
        heights = np.exp(self.levels) if self.linear_light else self.levels
        slopes = np.diff(heights, prepend=0.0) / spans
        # The second derivative at each knot that lies between two pieces of its pixel.
        bends = np.zeros(len(slopes) + 1)
        between = inside[:-1] & inside[1:]
        bends[1:-1] = np.where(between, np.abs(2.0 * np.diff(slopes) / (spans[1:] + spans[:-1])), 0.0)
        if self.linear_light:
            bends[:-1] /= heights
        bend = np.maximum(bends[:-1], bends[1:])
        guessed = inside & np.isinf(self.error_bounds) & (bend > 0)
        self.error_bounds[guessed] = CAUTION * bend[guessed] * spans[guessed] ** 2 / 8.0

    def crossed(self, pieces: I64, levels: F64) -> tuple[F64, F64]:
        """Return at which share of each piece its line is at a level, or next to it, and its rise in a piece there."""
        first, last = self.levels[pieces - 1], self.levels[pieces]
        with np.errstate(divide="ignore", invalid="ignore"):
            # Where a piece is level, and at that level from its start on, 0 / 0 is its start.
            if not self.linear_light:
                return np.nan_to_num(np.clip((levels - first) / (last - first), 0.0, 1.0)), last - first
            rise = np.expm1(last - first)
            share = np.nan_to_num(np.clip(np.expm1(levels - first) / rise, 0.0, 1.0))
            return share, rise / (1.0 + share * rise)

    def _on_line(self, first: F64, last: F64, share: F64) -> F64:
        if self.linear_light:
            return np.asarray(first + np.log1p(share * np.expm1(last - first)))
        return np.asarray(first + share * (last - first))

    def walk(self, references: F64, on: float, off: float) -> tuple[F64, I64]:
        """Let ideal pixels fire, brightness being linear between knots.

        Args:
            references: of each pixel, levels of the last events before the step.
            on, off: contrast thresholds.

        Returns:
            The reference before each piece, and how many thresholds are crossed in it, negative downwards, ``[K]``.
        """
        starts = np.flatnonzero(self.firsts)
        counts = np.diff(starts, append=len(self.pixels))
        order = np.argsort(-counts, kind="stable")
        starts, counts = starts[order], counts[order]
        ref = references[self.pixels[starts]]
        before, crossings = np.zeros(len(self.pixels)), np.zeros(len(self.pixels), np.int64)
        active = len(starts)
        for k in range(1, int(counts[0]) if active else 0):
            active = int(np.searchsorted(-counts, -k, side="left"))
            at, now = starts[:active] + k, ref[:active]
            change = self.levels[at] - now
            size = np.where(change > 0, on, off)
            fired = np.floor(np.abs(change) / size)
            before[at] = now
            crossings[at] = (np.sign(change) * fired).astype(np.int64)
            ref[:active] = now + np.sign(change) * fired * size
        return before, crossings


def join(parts: list[Knots]) -> Knots:
    """Return the knots of several parts, which have no pixel in common, in order."""
    pixels = np.concatenate([part.pixels for part in parts])
    order = np.argsort(pixels, kind="stable")
    times, levels, error_bounds = (
        np.concatenate([getattr(part, name) for part in parts])[order] for name in ("times", "levels", "error_bounds")
    )
    return Knots(pixels[order], times, levels, error_bounds, parts[0].linear_light)


def vague(knots: Knots, references: F64, on: float, off: float, tolerance: float, least: int) -> tuple[I64, I64]:
    """Return the pieces in which a threshold is crossed nobody knows well when, or may be crossed, and a time in each.

    Args:
        knots: what is known.
        references: of each pixel, levels of the last events before the step.
        on, off: contrast thresholds.
        tolerance: error of an event's time that will do [ticks].
        least: pieces that are no longer are left alone [ticks].
    """
    before, crossings = knots.walk(references, on, off)
    spans = np.diff(knots.times, prepend=0)
    long_enough = ~knots.firsts & (spans > least)
    crossed = np.flatnonzero(long_enough & (crossings != 0))
    error_bound, span = knots.error_bounds[crossed], spans[crossed]
    share, rise = knots.crossed(crossed, before[crossed] + np.where(crossings[crossed] > 0, on, -off))
    with np.errstate(divide="ignore", invalid="ignore"):
        # Near a piece's ends the parabola is near the line.
        way = np.where(np.abs(crossings[crossed]) == 1, 4.0 * share * (1.0 - share) * error_bound, error_bound)
        error = np.where(np.isinf(error_bound), span, way * span / np.abs(rise))
    vaguely = error > tolerance
    quiet = np.flatnonzero(long_enough & (crossings == 0) & np.isfinite(knots.error_bounds))
    first, last, error_bound = knots.levels[quiet - 1], knots.levels[quiet], knots.error_bounds[quiet]
    highest, lowest = np.maximum(first, last) + error_bound, np.minimum(first, last) - error_bound
    quiet = quiet[(highest - before[quiet] >= on) | (before[quiet] - lowest >= off)]
    # Those without a crossing are parted in the middle, so that neither their share nor their error matters.
    pieces = np.concatenate([crossed[vaguely], quiet])
    order = np.argsort(pieces, kind="stable")
    share, error = (np.concatenate([part[vaguely], np.zeros(len(quiet))])[order] for part in (share, error))
    pieces = pieces[order]
    span, single = spans[pieces], np.abs(crossings[pieces]) == 1
    share = np.where(single, np.clip(share, _NEAREST, 1.0 - _NEAREST), 0.5)
    # As coarse a grid as says something: the fewer different times there are, the cheaper they are traced.
    grid = _power_of_two(np.maximum(np.where(single, np.minimum(error, span), span) / 8.0, 2.0 * tolerance))
    start = knots.times[pieces - 1]
    times = np.round((start + share * span) / grid).astype(np.int64) * grid
    return pieces, np.clip(times, start + 1, start + span - 1)


def _power_of_two(values: F64) -> I64:
    """Return the largest powers of 2 that are no larger, and at least 1."""
    return (1 << np.floor(np.log2(np.maximum(values, 1.0))).astype(np.int64)).astype(np.int64)
