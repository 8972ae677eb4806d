"""Events at their own times: pixels are traced between two frames until it is known when they cross a threshold.

Between frames brightness is taken for linear in time, which is wrong by what it bends. A pixel whose forecast bends
near a threshold is traced at the bends; then each piece in which a threshold is crossed is parted where the crossing is
expected, until what is found there no longer moves it: regula falsi with an estimate of the error, for all pixels at a
time. Steps in time that follow the brightness are ESIM's idea (Rebecq et al., CoRL 2018), there for whole pictures.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from clsim.detect.config import DetectorConfig
from clsim.detect.forecast import MOMENTS, Forecast
from clsim.detect.knots import TICKS_PER_S, Knots, join, ticks, vague
from clsim.detect.traced_levels import traced_levels
from clsim.frames import Frame, PixelTracer
from clsim.opencl import path as opencl_path
from clsim.opencl.path import BrightnessPath
from clsim.opencl.workplace import Buffer, Grid, Workplace

F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]
LONGEST_WAY_PX = 12.0
"""Where things go farther in a step, pictures between its ends are traced, so that ways are no longer."""
_MOST_PARTS = 32
_ROUNDS = 10
"""Most times that a step is looked at again: errors fall by more than a half each time."""


@dataclass
class RefineStats:
    """What refining took since the start.

    Attributes:
        requests: pixels traced between frames, each time counted.
        rounds: how often pixels were traced to time events better.
    """

    requests: int = 0
    rounds: int = 0


class Refiner:
    """Adds to brightness paths what must be known between frames.

    Attributes:
        stats: what it took.
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
        self._place, self._tracer = place, tracer
        self._shape = place.layout.height, place.layout.width
        self._on, self._off = config.threshold_on, config.threshold_off
        self._tolerance = tolerance_us * TICKS_PER_S / 1e6
        self._forecast = Forecast(place, self._on, self._off)
        self._levels = traced_levels(config, names, self._shape, tracer.lit)
        self.stats = RefineStats()
        self._between: list[Buffer] = []
        self._frames = 0

    def reset(self) -> None:
        """Forget the last frame."""
        self._frames = 0

    def refine(self, path: BrightnessPath, frame: Frame, references: Buffer) -> BrightnessPath:
        """Return the path with knots, and with the pixels that fire between its ends.

        Args:
            path: from the last frame to this one.
            frame: the frame.
            references: levels of the last events, ``[H, span]``; NaN where there is none.
        """
        self._levels.advance(frame)
        self._frames += 1
        if self._frames == 1:
            return path
        starts_s, ends_s = path.start_us * 1e-6, path.end_us * 1e-6
        # What has turned once by the end has gone far by the middle.
        halves = self._tracer.motion(starts_s, 0.5 * (starts_s + ends_s))
        ways = self._tracer.motion(starts_s, ends_s)
        if ways is None or halves is None:
            return path
        longest_px = max(_longest(ways), 2.0 * _longest(halves))
        start, end, ref = (self._image(buffer) for buffer in (path.start, path.end, references))
        self._levels.begin(start, end, ways)
        touched = (np.abs(ways) + np.abs(halves)).max(axis=(0, 1)) > 0
        times, levels = self._pictures(path, longest_px, touched, start.ravel(), end.ravel())
        ref = ref.ravel()
        with np.errstate(invalid="ignore"):
            reached = (levels[1:] - ref >= self._on) | (ref - levels[1:] >= self._off)
        may = np.asarray(reached.any(axis=0), np.bool_)
        marked, marks = self._marks(path, references, times, levels, ways)
        may[marked] = True
        active = np.flatnonzero(may & np.isfinite(levels[0]) & np.isfinite(levels[-1]) & np.isfinite(ref))
        if not len(active):
            return path
        place = np.full(len(ref), -1, np.int64)
        place[active] = np.arange(len(active))
        inside = place[marked] >= 0
        knots = self._first_knots(path, active, (place[marked[inside]], marks[inside]), times, levels[:, active])
        knots = self._sharpen(path, active, knots, ref[active].astype(np.float64))
        return self._with_knots(path, knots, active)

    def _pictures(
        self, path: BrightnessPath, longest_px: float, touched: npt.NDArray[np.bool_], start: F32, end: F32
    ) -> tuple[I64, F32]:
        """Return ticks ``[P]`` and levels ``[P, H·W]`` of both ends, and of times between where ways are long.

        They are traced for pixels that are ``touched`` by what moves; others' levels are straight in time.
        """
        parts = min(_MOST_PARTS, 2 ** max(0, int(np.ceil(np.log2(max(longest_px, 1e-6) / LONGEST_WAY_PX)))))
        times = np.linspace(ticks(path.start_us), ticks(path.end_us), parts + 1).round().astype(np.int64)
        levels = np.linspace(start, end, parts + 1, dtype=np.float32)
        levels[-1] = end
        pixels = np.flatnonzero(touched.ravel())
        if parts > 1 and len(pixels):
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
            grid = 2 ** max(0, ((closes - begins) // MOMENTS).bit_length() - 1)
            at = np.round((begins + moments * ((closes - begins) / MOMENTS)) / grid).astype(np.int64) * grid
            inside = (at > begins) & (at < closes)
            pixels.append(found[inside])
            marks.append(at[inside])
        return np.concatenate([*pixels, np.zeros(0, np.int64)]), np.concatenate([*marks, np.zeros(0, np.int64)])

    def _first_knots(self, path: BrightnessPath, active: I64, marks: tuple[I64, I64], times: I64, levels: F32) -> Knots:
        """Trace ``marks``, rows of ``active`` and ticks; ``levels`` ``[P, active]`` are known at ``times``."""
        rows, asked = marks
        every = np.arange(len(active))
        pixels = np.concatenate([np.tile(every, len(times)), rows])
        all_times = np.concatenate([np.repeat(times, len(active)), asked])
        found = np.concatenate([levels.ravel().astype(np.float64), self._trace(path, active[rows], asked)])
        order = np.lexsort((all_times, pixels))
        knots = Knots(pixels[order], all_times[order], found[order], np.full(len(pixels), np.inf))
        knots.guess_bulges()
        return knots

    def _sharpen(self, path: BrightnessPath, active: I64, knots: Knots, references: npt.NDArray[np.float64]) -> Knots:
        """Return what is known once it is known when thresholds are crossed."""
        least = max(2, int(self._tolerance))
        done: list[Knots] = []
        for _ in range(_ROUNDS):
            pieces, times = vague(knots, references, self._on, self._off, self._tolerance, least)
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

    def _trace(self, path: BrightnessPath, pixels: I64, times: I64) -> npt.NDArray[np.float64]:
        if not len(pixels):
            return np.zeros(0)
        self.stats.requests += len(pixels)
        times_s = times / TICKS_PER_S
        planes = self._tracer.trace(pixels.astype(np.int32), times_s)
        shares = (times_s * 1e6 - path.start_us) / (path.end_us - path.start_us)
        return self._levels.levels(planes, pixels, np.clip(shares, 0.0, 1.0))

    def _with_knots(self, path: BrightnessPath, knots: Knots, active: I64) -> BrightnessPath:
        place, (_, width) = self._place, self._shape
        span = place.layout.span
        codes = (active // width) * span + active % width
        listed = place.read(path.pixels)[: path.count]
        pixels = np.union1d(listed, codes).astype(np.int32)
        firsts = knots.firsts
        inside = ~firsts & ~np.append(firsts[1:], True)
        row = np.searchsorted(pixels, codes)[knots.pixels[inside]]
        offsets = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=len(pixels)))]).astype(np.int32)
        times_ns = np.round(knots.times[inside] * (1e9 / TICKS_PER_S)).astype(np.int64) - path.start_us * 1000
        longest = (path.end_us - path.start_us) * 1000 - 1
        times_ns = np.clip(times_ns, 1, longest)
        buffers = [
            self._upload(values) for values in (pixels, offsets, times_ns, knots.levels[inside].astype(place.real))
        ]
        return BrightnessPath(
            path.start_us, path.end_us, path.start, path.end, buffers[0], len(pixels),
            opencl_path.Knots(*buffers[1:]),
        )  # fmt: skip

    def _upload(self, values: npt.NDArray[np.generic]) -> Buffer:
        buffer = self._place.allocate((max(1, len(values)),), values.dtype)
        self._place.write(buffer, values)
        return buffer

    def _uploaded(self, number: int, levels: F32) -> Buffer:
        """Return an image on the device that holds levels ``[H·W]``."""
        height, width = self._shape
        if len(self._between) <= number:
            self._between.append(self._place.allocate(self._place.layout.image_shape))
        image = np.zeros(self._place.layout.image_shape, self._place.real)
        image[:, :width] = levels.reshape(height, width)
        self._place.write(self._between[number], image)
        return self._between[number]

    def _image(self, buffer: Buffer) -> npt.NDArray[np.float32]:
        return np.ascontiguousarray(self._place.read(buffer)[:, : self._shape[1]], np.float32)


def _longest(ways: F32) -> float:
    """Return the longest of ways ``[3, 2, H, W]`` [pixels]."""
    return float(np.sqrt(np.square(ways).sum(axis=1).max(initial=0.0)))
