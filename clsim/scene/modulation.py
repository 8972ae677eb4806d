"""How the light of a lamp, a surface or the sky changes with time: factors on its radiance.

What is seen within an exposure is the mean over it. It is taken in closed form, so that no flicker is too fast for it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

Vec3 = tuple[float, float, float]
F64 = npt.NDArray[np.float64]

SAMPLES_PER_SINE = 10
"""Frames per period at which the straight lines between frames miss a sine's height by 5 %."""
_EDGE = 1e-9
"""Share of a period by which an edge counts as reached: times of frames are rounded."""


class Modulation(Protocol):
    """Factors on a radiance over time."""

    @property
    def duration_s(self) -> float:
        """When it has ended [s]; 0 where it goes on for ever."""
        ...

    @property
    def least_fps(self) -> float:
        """Frames per second below which frames miss what it does; 0 where any number will do."""
        ...

    @property
    def largest(self) -> float:
        """The largest factor that it ever has, in any colour."""
        ...

    def mean(self, start_s: float, end_s: float) -> F64:
        """Return the mean factors of R, G and B, ``[3]``, over a time [s]; where both ends are one, those of then."""
        ...


@dataclass(frozen=True)
class Sine:
    """Light on alternating current: 1 + depth·sin(2π·frequency·t + phase).

    Attributes:
        frequency_hz: of the light, twice that of the mains.
        depth: (largest − smallest) / (largest + smallest), "percent flicker" over 100; 0 … 1.
        phase_deg: angle at time 0.
    """

    frequency_hz: float
    depth: float = 1.0
    phase_deg: float = 0.0

    @property
    def duration_s(self) -> float:
        """It goes on for ever."""
        return 0.0

    @property
    def least_fps(self) -> float:
        """Ten frames a period."""
        return SAMPLES_PER_SINE * self.frequency_hz if self.depth > 0 else 0.0

    @property
    def largest(self) -> float:
        """The crest."""
        return 1.0 + self.depth

    def mean(self, start_s: float, end_s: float) -> F64:
        """Return the mean of a sine: its value in the middle, times sinc."""
        turns = self.frequency_hz * 0.5 * (start_s + end_s) + self.phase_deg / 360.0
        share = float(np.sinc(self.frequency_hz * (end_s - start_s)))
        return np.full(3, 1.0 + self.depth * share * math.sin(2 * math.pi * turns))


@dataclass(frozen=True)
class Pwm:
    """A lamp that is switched: 1 for a share ``duty`` of each period, from its start on, then ``low``.

    Attributes:
        frequency_hz: of the switching.
        duty: share of the period in which it is on; 0 … 1.
        low: factor while it is off.
        phase_deg: how much of a period has passed at time 0.
    """

    frequency_hz: float
    duty: float = 0.5
    low: float = 0.0
    phase_deg: float = 0.0

    @property
    def duration_s(self) -> float:
        """It goes on for ever."""
        return 0.0

    @property
    def least_fps(self) -> float:
        """Two frames for the shorter of on and off."""
        shorter = min(self.duty, 1.0 - self.duty)
        return 2.0 * self.frequency_hz / shorter if shorter > 0 and self.low != 1.0 else 0.0

    @property
    def largest(self) -> float:
        """What it is while on, or while off where that is more."""
        return max(1.0, self.low)

    def mean(self, start_s: float, end_s: float) -> F64:
        """Return the share of the time in which it is on."""
        start, end = (self.frequency_hz * time_s + self.phase_deg / 360.0 for time_s in (start_s, end_s))
        if end > start:
            share = (self._periods_on(end) - self._periods_on(start)) / (end - start)
        else:
            share = float((start + _EDGE) % 1.0 < self.duty)
        return np.full(3, self.low + (1.0 - self.low) * share)

    def _periods_on(self, turns: float) -> float:
        """Return for how long it was on until then, in periods."""
        whole = math.floor(turns)
        return whole * self.duty + min(turns - whole, self.duty)


@dataclass(frozen=True)
class Keyframed:
    """Factors at times, joined by straight lines or held.

    Attributes:
        times_s: increasing, from 0 or later [s].
        factors: of R, G and B at these times; the first and the last are held before and after.
        step: whether each is held until the next, instead of lines.
        repeat: whether all starts anew at the last time.
        finest_s: the shortest time in which something happens, where lines stand for a curve; 0: from key to key.
    """

    times_s: tuple[float, ...]
    factors: tuple[Vec3, ...]
    step: bool = False
    repeat: bool = False
    finest_s: float = 0.0

    @property
    def duration_s(self) -> float:
        """When the last key comes; 0 where it starts anew then."""
        return 0.0 if self.repeat else self.times_s[-1]

    @property
    def least_fps(self) -> float:
        """Two frames from key to key."""
        gaps_s = np.diff(self.times_s)
        return 2.0 / (self.finest_s or float(gaps_s.min())) if len(gaps_s) else 0.0

    @property
    def largest(self) -> float:
        """The largest factor of a key."""
        return float(np.max(self.factors))

    def mean(self, start_s: float, end_s: float) -> F64:
        """Return the mean of what the lines are."""
        if end_s > start_s:
            return np.asarray((self._integral(end_s) - self._integral(start_s)) / (end_s - start_s), np.float64)
        times_s, factors, _ = self._tables
        if self._repeats:
            start_s = (start_s + _EDGE * times_s[-1]) % times_s[-1]
        if self.step:
            now = max(int(np.searchsorted(times_s, start_s, side="right")) - 1, 0)
            return np.array(factors[now], np.float64)
        return np.array([np.interp(start_s, times_s, factor) for factor in factors.T])

    @property
    def _repeats(self) -> bool:
        return self.repeat and self.times_s[-1] > 0

    @cached_property
    def _tables(self) -> tuple[F64, F64, F64]:
        """Return times, factors and the integrals of these until each key."""
        times_s, factors = np.array(self.times_s), np.array(self.factors, np.float64).reshape(-1, 3)
        ends = factors[:-1] if self.step else 0.5 * (factors[:-1] + factors[1:])
        sums = np.concatenate([np.zeros((1, 3)), np.cumsum(ends * np.diff(times_s)[:, None], axis=0)])
        return times_s, factors, sums

    def _integral(self, time_s: float) -> F64:
        if not self._repeats:
            return self._once(time_s)
        period_s = self.times_s[-1]
        passes = math.floor(time_s / period_s)
        return passes * (self._once(period_s) - self._once(0.0)) + self._once(time_s - passes * period_s)

    def _once(self, time_s: float) -> F64:
        """Return the integral from the first key to a time, which may be before it."""
        times_s, factors, sums = self._tables
        j = int(np.searchsorted(times_s, time_s, side="right")) - 1
        if j < 0:
            return np.asarray((time_s - times_s[0]) * factors[0], np.float64)
        gone_s = time_s - float(times_s[j])
        held = sums[j] + gone_s * factors[j]
        if self.step or j == len(times_s) - 1:
            return np.asarray(held, np.float64)
        slope = (factors[j + 1] - factors[j]) / (times_s[j + 1] - times_s[j])
        return np.asarray(held + 0.5 * gone_s**2 * slope, np.float64)


class Paced(Protocol):
    """What changes so fast that it takes frames enough to see it."""

    @property
    def least_fps(self) -> float:
        """Frames per second below which frames miss what it does."""
        ...


def missed(changes: Sequence[tuple[str, Paced]], fps: float) -> str | None:
    """Return a sentence about light that changes too fast for so many frames per second; None where none does.

    Args:
        changes: names of what changes, and how.
        fps: frames per simulated second.
    """
    # What is asked for is rounded up; a frame rate of hardly less will do.
    missed_by = [(change.least_fps, name) for name, change in changes if change.least_fps > fps * (1 + 1e-6)]
    if not missed_by:
        return None
    needed, name = max(missed_by)
    return (
        f"the light of {name} changes too fast for {fps:g} frames per simulated second, so that it looks slower than "
        f"it is, or constant: expected `fps` of at least {math.ceil(needed * (1 - 1e-9))}"
    )
