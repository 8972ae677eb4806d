"""Events at their own times: pixels are traced between two frames until it is known when they cross a threshold.

Between frames brightness is taken for linear in time, which is wrong by what it bends. A pixel whose forecast bends
near a threshold is traced at the bends; then each piece in which a threshold is crossed is parted where the crossing is
expected, until what is found there no longer moves it: regula falsi with an estimate of the error, for all pixels at a
time. Steps in time that follow the brightness are ESIM's idea (Rebecq et al., CoRL 2018), there for whole pictures.
"""

from __future__ import annotations

from dataclasses import dataclass

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
        self._levels = traced_levels(config, names, self._shape)
        self.stats = RefineStats()
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
        ways = self._tracer.motion(path.start_us * 1e-6, path.end_us * 1e-6)
        if ways is None:
            return path
        start, end, ref = (self._image(buffer) for buffer in (path.start, path.end, references))
        self._levels.begin(start, end, ways)
        pixels, moments = self._forecast.marks(path.start, path.end, references, ways)
        start, end, ref = start.ravel(), end.ravel(), ref.ravel()
        marked = np.zeros(len(ref), bool)
        marked[pixels] = True
        fires = (end - ref >= self._on) | (ref - end >= self._off)
        known = np.isfinite(start) & np.isfinite(end)
        active = np.flatnonzero((marked | fires) & known)
        if not len(active):
            return path
        inside = known[pixels]
        rows = np.searchsorted(active, pixels[inside])
        knots = self._first_knots(path, active, rows, moments[inside], start[active], end[active])
        knots = self._sharpen(path, active, knots, ref[active].astype(np.float64))
        return self._with_knots(path, knots, active)

    def _first_knots(self, path: BrightnessPath, active: I64, rows: I64, moments: I64, start: F32, end: F32) -> Knots:
        """Trace the ``moments`` of the pixels ``active[rows]``; ``start`` and ``end`` are levels of all active ones."""
        begins, ends = ticks(path.start_us), ticks(path.end_us)
        grid = 2 ** max(0, ((ends - begins) // MOMENTS).bit_length() - 1)
        times = np.round((begins + moments * ((ends - begins) / MOMENTS)) / grid).astype(np.int64) * grid
        inside = (times > begins) & (times < ends)
        rows, times = rows[inside], times[inside]
        every = np.arange(len(active))
        pixels = np.concatenate([every, rows, every])
        times = np.concatenate([np.full(len(active), begins), times, np.full(len(active), ends)])
        traced = self._trace(path, active[rows], times[len(active) : -len(active)])
        levels = np.concatenate([start.astype(np.float64), traced, end.astype(np.float64)])
        order = np.lexsort((times, pixels))
        knots = Knots(pixels[order], times[order], levels[order], np.full(len(pixels), np.inf))
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

    def _image(self, buffer: Buffer) -> npt.NDArray[np.float32]:
        return np.ascontiguousarray(self._place.read(buffer)[:, : self._shape[1]], np.float32)
