"""Whether one half of a recording of a still scene tells of the other."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from clsim.sensor.fit.still import Counts, StillFit, fit_still

_RESAMPLED = 200


@dataclass(frozen=True)
class Predicted:
    """A number of the second half.

    Attributes:
        name: what it is of.
        expected: what the first half says, with its standard error for the second.
        found: what the second half has.
    """

    name: str
    expected: tuple[float, float]
    found: float

    @property
    def errors_off(self) -> float:
        """By how many standard errors the first half was wrong."""
        return abs(self.found - self.expected[0]) / self.expected[1] if self.expected[1] > 0 else math.inf


def predicted(quarters: Sequence[Counts]) -> tuple[StillFit, list[Predicted]]:
    """Fit the first two quarters of a recording, and return what they say of the last two, beside what these have.

    Rates are those of a mean pixel that the fit finds not hot; how much they differ from quarter to quarter, by chance
    and otherwise, is the error. Flips are events of another polarity than the pixel's last one.

    Raises:
        InputError: the first half has too few events to be fitted.
    """
    first, second = _sum(quarters[:2]), _sum(quarters[2:])
    fit = fit_still(first)
    return fit, list(_rows(quarters, first, second, ~fit.hot))


def _sum(parts: Sequence[Counts]) -> Counts:
    names = ("on", "off", "seconds", "next_alike", "next_opposite")
    return Counts(**{name: sum(getattr(part, name) for part in parts) for name in names})


def _rows(
    quarters: Sequence[Counts], first: Counts, second: Counts, quiet: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
) -> Iterator[Predicted]:
    pixels = int(quiet.sum())
    for name in ("on", "off"):
        halves = [float(getattr(half, name)[quiet].sum()) / pixels / half.seconds for half in (first, second)]
        # Quarters differ by chance, which is a half's error; and each of both halves errs so.
        apart = getattr(quarters[0], name)[quiet] - getattr(quarters[1], name)[quiet]
        each = math.sqrt(float(np.square(apart).sum()))
        longer = first.seconds / second.seconds
        error = each * math.sqrt(1 + longer) / pixels / first.seconds
        yield Predicted(f"{name.upper()} [1/s]", (halves[0], error), halves[1])
    alike, opposite = first.next_alike[quiet], first.next_opposite[quiet]
    if (alike + opposite).sum() and (second.next_alike + second.next_opposite)[quiet].sum():
        draw = np.random.default_rng(0)
        drawn = [draw.integers(0, pixels, pixels) for _ in range(_RESAMPLED)]
        shares = [opposite[each].sum() / max(1, (alike + opposite)[each].sum()) for each in drawn]
        theirs = int(second.next_opposite[quiet].sum())
        pairs = theirs + int(second.next_alike[quiet].sum())
        ours = int((alike + opposite).sum())
        error = float(np.std(shares)) * math.sqrt(1 + ours / pairs)
        yield Predicted("flips", (float(opposite.sum()) / ours, error), theirs / pairs)
