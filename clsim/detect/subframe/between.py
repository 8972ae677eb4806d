"""Brightness between two frames, of chosen pixels: what all that asks for it has in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from clsim.detect.config import DetectorConfig
from clsim.detect.subframe.knots import TICKS_PER_S, Knots
from clsim.detect.subframe.traced_levels import traced_levels
from clsim.frames import Frame, PixelTracer
from clsim.opencl import path as opencl_path
from clsim.opencl.path import BrightnessPath
from clsim.opencl.workplace import Buffer, Grid, Workplace

F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]


@dataclass
class BetweenStats:
    """What was traced between frames since the start.

    Attributes:
        requests: pixels traced, each time counted.
        rounds: how often pixels were traced to time events better.
    """

    requests: int = 0
    rounds: int = 0


@dataclass(frozen=True)
class Motion:
    """The motion field of a step: where surfaces go.

    Attributes:
        ways: to its end, ``[3, 2, H, W]`` [pixels]; see `clsim.frames.PixelTracer.motion`.
        halves: to its middle.
    """

    ways: F32
    halves: F32

    @property
    def longest_px(self) -> float:
        """The longest way of all."""
        # What has turned once by the end has gone far by the middle.
        to_end, to_middle = self._longest_px
        return max(to_end, 2.0 * to_middle)

    @property
    def turns(self) -> bool:
        """Whether motion comes back within the step, so that it went farther than the ways to its end tell."""
        to_end, to_middle = self._longest_px
        return to_middle > to_end

    @cached_property
    def _longest_px(self) -> tuple[float, float]:
        return _longest(self.ways), _longest(self.halves)


class Between(ABC):
    """Adds to brightness paths what must be known between frames.

    Attributes:
        stats: what it took.
    """

    def __init__(
        self, place: Workplace[Grid], config: DetectorConfig, names: tuple[str, ...], tracer: PixelTracer
    ) -> None:
        """Prepare.

        Args:
            place: where brightness is.
            config: thresholds and method.
            names: planes of the frames.
            tracer: traces pixels.
        """
        self._place, self._tracer = place, tracer
        self._shape = place.layout.height, place.layout.width
        self._on, self._off = config.threshold_on, config.threshold_off
        self._levels = traced_levels(config, names, self._shape, tracer.lit)
        self.stats = BetweenStats()
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
        motion = self._motion(path) if self._frames > 1 else None
        self._advance(frame, self._frames > 1 and motion is None)
        if motion is None:
            return path
        self._levels.begin(self._image(path.start), self._image(path.end), motion.ways)
        return self._find(path, motion, references)

    def _motion(self, path: BrightnessPath) -> Motion | None:
        """Return where surfaces go in a step; None where all rests."""
        starts_s, ends_s = path.start_us * 1e-6, path.end_us * 1e-6
        ways = self._tracer.motion(starts_s, ends_s)
        halves = None if ways is None else self._tracer.motion(starts_s, 0.5 * (starts_s + ends_s))
        return None if ways is None else Motion(ways, np.zeros_like(ways) if halves is None else halves)

    @abstractmethod
    def _advance(self, frame: Frame, rested: bool) -> None:
        """Take notice of a frame, and of whether all has rested since the one before."""

    @abstractmethod
    def _find(self, path: BrightnessPath, motion: Motion, references: Buffer) -> BrightnessPath:
        """Return the path of a step in which something moves, with what is found between its ends."""

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
        pixels = union(self._shape[0] * span, listed, codes).astype(np.int32)
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


def union(end: int, *parts: npt.NDArray[np.integer]) -> I64:
    """Return the numbers from 0 up to ``end`` that are in any of the parts, rising: far quicker than to sort them."""
    found = np.zeros(end, np.bool_)
    for part in parts:
        found[part] = True
    return np.flatnonzero(found)


def _longest(ways: F32) -> float:
    """Return the longest of ways ``[3, 2, H, W]`` [pixels]."""
    return float(np.sqrt(np.square(ways).sum(axis=1).max(initial=0.0)))
