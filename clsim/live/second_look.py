"""How much of a run is noise: some pixels are looked at twice, and what one look fires and the other does not is noise.

Both looks are rendered alike, with first-hit rays of their own. Where light is kept they share its paths: there one
look is made somewhat brighter and the other darker, by how far the light might be off.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from clsim.detect.config import DetectorConfig
from clsim.errors import InputError

SEEN_TWICE = 61
"""One in so many pixels is looked at again."""
ENOUGH = 20
"""Events from which on their share means something."""
WITHIN_US = 25_000
"""Two looks' events are fellows if they are alike, at one pixel, and at most so far apart [µs]."""
_STRETCH_US = 1_000_000
"""Events of so much time are compared at once and forgotten [µs]."""
_MOST_EVENTS = 1 << 20
"""Events that are kept: of more, less time is compared at once."""
_MOST_OF_A_PIXEL = 1000
"""Events of one pixel in one step, as the ideal sensor has them (MAX_EVENTS in sensor_ideal.cl)."""

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]


@dataclass
class Look:
    """Ideal pixels, and what they fired since it was last asked.

    Attributes:
        level: of each pixel at the last frame where it was finite, NaN before the first [natural-log units].
        reference: of its last event; NaN before the first level.
        fired: of each frame, pixels and stamps [µs]; ON events have the pixel's number, OFF ones its complement ~pixel.
    """

    level: F64
    reference: F64
    fired: list[tuple[I64, I64]]

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

    def take(self) -> tuple[I64, I64]:
        """Return what was fired, and forget it."""
        empty = np.zeros(0, np.int64)
        pixels, stamps = zip((empty, empty), *self.fired, strict=True)
        self.fired = []
        return np.concatenate(pixels), np.concatenate(stamps)


class SecondLook:
    """Counts events of pixels that are seen twice, and those that one look alone has."""

    def __init__(self, config: DetectorConfig) -> None:
        """Prepare for brightness as ``config`` has it."""
        if config.response != "ln":
            raise InputError(f"a second look needs `response` ln, got {config.response}")
        self._config = config
        self._looks: list[Look] = []
        self._events = self._alone = 0
        self._since_us = self._time_us = 0

    def take(self, luminance: npt.NDArray[np.float32], time_us: int) -> None:
        """Go on to a frame, in which both looks saw ``luminance`` ``[2, n]``; an earlier time begins anew."""
        config = self._config
        level = np.log(np.maximum(config.scale * luminance.astype(np.float64), config.floor))
        if time_us <= self._time_us:
            self.begin_anew()
        if not self._looks:
            known = np.where(np.isfinite(level), level, np.nan)
            self._looks = [Look(each, each.copy(), []) for each in known]
            self._since_us = time_us
        else:
            for look, each in zip(self._looks, level, strict=True):
                look.step(each, config.threshold_on, config.threshold_off, self._time_us, time_us)
        self._time_us = time_us
        kept = sum(len(stamps) for look in self._looks for _, stamps in look.fired)
        if time_us - self._since_us >= _STRETCH_US or kept > _MOST_EVENTS:
            self._compare()

    def begin_anew(self) -> None:
        """Take the next frame for a first one, as the detector does where the samples of a pixel become others."""
        self._compare()
        self._looks = []

    @property
    def noise_share(self) -> float | None:
        """Share of the events that one look alone has; None where there are too few to tell."""
        self._compare()
        return self._alone / self._events if self._events >= ENOUGH else None

    def _compare(self) -> None:
        if not self._looks:
            return
        first, second = (look.take() for look in self._looks)
        events = len(first[0]) + len(second[0])
        self._alone += events - 2 * _pairs(first, second)
        self._events += events
        self._since_us = self._time_us


def _pairs(first: tuple[I64, I64], second: tuple[I64, I64]) -> int:
    """Return how many events of one look have a fellow of the other, at most; nobody is the fellow of two."""
    stamps = np.concatenate([first[1], second[1], [0]])
    # Pixels lie so far apart that nothing reaches from one to the next.
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
