"""v2e's pixel by its published equations (Hu, Liu, Delbruck, CVPRW 2021), with the defaults of its command line.

Own code, from the equations; nothing of v2e's is in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from clsim.events import EventBatch, empty_batch

LINEAR_DN = 20.0
"""Below it, of 255, brightness is linear."""


@dataclass(frozen=True)
class Defaults:
    """Numbers of its pixel: natural-log units, hertz and seconds."""

    threshold: float = 0.2
    mismatch: float = 0.03
    cutoff_hz: float = 300.0
    leak_hz: float = 0.01
    shot_hz: float = 0.001
    rest_s: float = 0.0005


class V2e:
    """Pixels that see frames of 8-bit brightness."""

    def __init__(self, width: int, height: int, numbers: Defaults | None = None, seed: int = 0) -> None:
        """Draw their thresholds."""
        self._numbers = numbers or Defaults()
        self._random = np.random.default_rng(seed)
        size, n = (height, width), self._numbers
        self._on, self._off = (np.maximum(self._random.normal(n.threshold, n.mismatch, size), 0.01) for _ in range(2))
        self._seen = self._memory = np.zeros(size)
        self._last_s = np.full(size, -math.inf)
        self._time_s: float | None = None

    def frame(self, time_s: float, brightness: npt.NDArray[np.float64]) -> EventBatch:
        """Return the events up to a frame, of brightness from 0 to 255; the first fires nothing."""
        n = self._numbers
        level = np.where(
            brightness <= LINEAR_DN, brightness * math.log(LINEAR_DN) / LINEAR_DN, np.log(np.maximum(brightness, 1e-9))
        )
        light = (brightness + 20) / 275
        if self._time_s is None:
            self._time_s, self._seen, self._memory = time_s, level, level.copy()
            return empty_batch(0)
        step_s, start_s, self._time_s = time_s - self._time_s, self._time_s, time_s
        share = np.minimum(light * step_s * 2 * math.pi * n.cutoff_hz, 1.0)
        self._seen = self._seen + share * (level - self._seen)
        self._memory = self._memory - step_s * n.leak_hz * self._on
        moved = self._seen - self._memory
        ups, downs = (np.floor(np.maximum(sign * moved, 0) / size) for sign, size in ((1, self._on), (-1, self._off)))
        self._memory = self._memory + ups * self._on - downs * self._off
        batches = self._spread(ups.astype(int), downs.astype(int), start_s, step_s)
        batches.append(self._noise(light, step_s, time_s))
        return np.concatenate(batches)

    def _spread(self, ups: npt.NDArray, downs: npt.NDArray, start_s: float, step_s: float) -> list[EventBatch]:
        """Return the events of a frame: so many times as the busiest pixel fires, at which all others fire too."""
        most = int(max(ups.max(), downs.max()))
        found = []
        for nth in range(most):
            time_s = start_s + step_s * (nth + 1) / most
            rested = time_s - self._last_s >= self._numbers.rest_s
            for counts, on in ((ups, True), (downs, False)):
                fires = (counts > nth) & rested
                self._last_s[fires] = time_s
                found.append(_events(fires, time_s, on))
        return found

    def _noise(self, light: npt.NDArray[np.float64], step_s: float, time_s: float) -> EventBatch:
        n = self._numbers
        chance = 0.5 * n.shot_hz * step_s * (1 - 0.75 * light) * n.threshold
        drawn = self._random.uniform(size=light.shape)
        on, off = drawn < chance / self._on, drawn > 1 - chance / self._off
        self._memory = np.where(on | off, self._seen, self._memory)
        return np.concatenate([_events(on, time_s, True), _events(off, time_s, False)])


def _events(fires: npt.NDArray[np.bool_], time_s: float, on: bool) -> EventBatch:
    y, x = np.nonzero(fires)
    events = empty_batch(len(x))
    events["t"], events["x"], events["y"], events["on"] = round(1e6 * time_s), x, y, on
    return events
