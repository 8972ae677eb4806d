"""Duplicate sampling: some pixels are rendered twice, and events that only one of the two replicates has are noise.

Both replicates are rendered alike, each with its own primary rays. They share the radiance cache: one is raised and the
other lowered by the error of its light.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from clsim.detect.config import DetectorConfig
from clsim.errors import InputError

DUPLICATE_EVERY = 61
"""One in so many pixels is sampled twice."""
ENOUGH = 20
"""Events from which on their share means something."""
WITHIN_US = 25_000
"""Largest time between matched events, which are of the same polarity and pixel [µs]."""
_STRETCH_US = 1_000_000
"""Events of so much time are compared at once and forgotten [µs]."""
_MOST_EVENTS = 1 << 20
"""Events that are stored: of more, less time is compared at once."""
_MOST_OF_A_PIXEL = 1000
"""Events of one pixel in one step, as the ideal sensor has them (MAX_EVENTS in sensor/ideal.cl)."""

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Fired = tuple[I64, I64]
"""Pixels and stamps [µs] of events; ON events have the pixel's number, OFF ones its complement ~pixel."""
_NOTHING: Fired = (np.zeros(0, np.int64), np.zeros(0, np.int64))


def gathered(fired: Sequence[Fired]) -> Fired:
    """Return pixels and stamps of several frames as those of one."""
    pixels, stamps = zip(_NOTHING, *fired, strict=True)
    return np.concatenate(pixels), np.concatenate(stamps)


@dataclass
class IdealPixels:
    """Ideal pixels, and the events that they fired since it was last asked.

    Attributes:
        level: of each pixel at the last frame where it was finite, NaN before the first [natural-log units].
        reference: of its last event; NaN before the first level.
        fired: in each frame.
    """

    level: F64
    reference: F64
    fired: list[Fired]

    def step(self, level: F64, on: float, off: float, start_us: int, end_us: int) -> None:
        """Fire an event for each threshold crossed, as the ideal sensor does, brightness being linear in time."""
        level = np.where(np.isfinite(level), level, self.level)
        self.reference = np.where(np.isnan(self.reference), level, self.reference)
        change = level - self.reference
        step = np.where(change > 0, on, -off)
        crossed = np.nan_to_num(np.floor(change / step))
        written = np.minimum(crossed, _MOST_OF_A_PIXEL).astype(np.int64)
        pixel = np.repeat(np.arange(len(level)), written)
        nth = np.arange(len(pixel)) - np.repeat(np.cumsum(written) - written, written) + 1
        rise = level[pixel] - self.level[pixel]
        way = self.reference[pixel] + nth * step[pixel] - self.level[pixel]
        share = np.clip(way / np.where(rise == 0, 1.0, rise), 0.0, 1.0)
        stamp = start_us + np.ceil(share * (end_us - start_us)).astype(np.int64)
        self.fired.append((np.where(step[pixel] > 0, pixel, ~pixel), stamp))
        self.reference += crossed * step
        self.level = level

    def take(self) -> Fired:
        """Return what was fired, and forget it."""
        fired, self.fired = self.fired, []
        return gathered(fired)


class DuplicateSampling(ABC):
    """A noise meter: events of pixels that are sampled twice, and those that only one replicate has."""

    def __init__(self) -> None:
        """Begin with none."""
        self._events = self._unmatched = 0
        self._since_us = self._time_us = -1
        self._going = False

    def take(self, seen: F32, time_us: int) -> None:
        """Go on to a frame, of which the replicates are ``seen`` ``[2, …]``; an earlier time restarts."""
        if time_us <= self._time_us:
            self.restart()
        if not self._going:
            self._since_us, self._going = time_us, True
        self._step(seen, time_us)
        self._time_us = time_us
        if time_us - self._since_us >= _STRETCH_US or self._waiting() > _MOST_EVENTS:
            self._compare()

    def restart(self) -> None:
        """Take the next frame for a first one, as the detector does where the samples of a pixel become others."""
        self._compare()
        self._forget()
        self._going = False

    @property
    def noise_share(self) -> float | None:
        """Share of the events that only one replicate has; None where there are too few to tell."""
        self._compare()
        return self._unmatched / self._events if self._events >= ENOUGH else None

    @abstractmethod
    def _step(self, seen: F32, time_us: int) -> None:
        """Let both replicates fire their events from the last frame to this one."""

    @abstractmethod
    def _waiting(self) -> int:
        """Return how many events wait to be compared."""

    @abstractmethod
    def _taken(self) -> tuple[Fired, Fired]:
        """Return what each replicate fired, and forget it."""

    @abstractmethod
    def _forget(self) -> None:
        """Let both replicates have no past."""

    def _compare(self) -> None:
        first, second = self._taken()
        events = len(first[0]) + len(second[0])
        self._unmatched += events - 2 * _pairs(first, second)
        self._events += events
        self._since_us = self._time_us


class DuplicatePixels(DuplicateSampling):
    """A noise meter of single pixels, of which luminance ``[2, n]`` is sampled."""

    def __init__(self, config: DetectorConfig) -> None:
        """Prepare for brightness as ``config`` has it."""
        if config.response != "ln":
            raise InputError(f"duplicate pixels need `response` ln, got {config.response}")
        super().__init__()
        self._config = config
        self._replicas: list[IdealPixels] = []

    def _step(self, seen: F32, time_us: int) -> None:
        config = self._config
        level = np.log(np.maximum(config.scale * seen.astype(np.float64), config.floor))
        if not self._replicas:
            known = np.where(np.isfinite(level), level, np.nan)
            self._replicas = [IdealPixels(each, each.copy(), []) for each in known]
            return
        for replica, each in zip(self._replicas, level, strict=True):
            replica.step(each, config.threshold_on, config.threshold_off, self._time_us, time_us)

    def _waiting(self) -> int:
        return sum(len(stamps) for replica in self._replicas for _, stamps in replica.fired)

    def _taken(self) -> tuple[Fired, Fired]:
        first, second = (replica.take() for replica in self._replicas) if self._replicas else (_NOTHING, _NOTHING)
        return first, second

    def _forget(self) -> None:
        self._replicas = []


def _pairs(first: Fired, second: Fired) -> int:
    """Return how many events match one to one between the replicates, at most."""
    stamps = np.concatenate([first[1], second[1], [0]])
    # Stamps of different pixels are so far from each other that no match reaches from one to the next.
    span = int(stamps.max() - stamps.min()) + 2 * WITHIN_US + 1
    places, others = (np.sort(pixels * span + stamps) for pixels, stamps in (first, second))
    _, begins, group = np.unique(np.sort(first[0]), return_index=True, return_inverse=True)
    nth = np.arange(len(places)) - begins[group]
    turns = np.split(np.argsort(nth, kind="stable"), np.cumsum(np.bincount(nth))[:-1])
    pairs, free = 0, np.zeros(len(begins), np.int64)
    # In order of time each takes the earliest that is free: the first events of all pixels at once, then the second …
    for turn in turns:
        nearest = np.maximum(np.searchsorted(others, places[turn] - WITHIN_US), free[group[turn]])
        found = nearest < len(others)
        found[found] = others[nearest[found]] <= places[turn[found]] + WITHIN_US
        free[group[turn[found]]] = nearest[found] + 1
        pairs += int(np.count_nonzero(found))
    return pairs
