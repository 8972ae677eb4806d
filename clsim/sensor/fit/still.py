"""What a recording of a still scene tells of a sensor: its leak, its noise and its hot pixels."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events import EventBatch

FloatArray = npt.NDArray[np.float64]
MEDIAN_ERROR = 1.25
"""Times by which the median of normal numbers errs more than their mean."""
_DECADE = math.log(10.0)
_HOT_SIGMAS = 5.0
"""A pixel is hot whose rate is so many standard deviations, of the log of rates, above the median."""
_SMALLEST_SIGMA = 0.1 * _DECADE
_FEWEST_OF_HOT = 10
_FEWEST_EVENTS = 100
_FEW_EACH = 4
"""Events of a median pixel, below which their number says little of its rate."""
_USUAL_SIGMA, _CHANCE = 0.25 * _DECADE, 1e-9
_ROUNDS = 5
"""In which the mean without hot pixels settles."""
_RESAMPLED = 100
_QUANTILES = 400
"""Pixels that stand for all, where a mean over a lognormal distribution is not smooth."""
_FEW = 1e-3
"""Noise events in a period of leak, below which they change nothing."""


@dataclass
class Counts:
    """Events of each pixel of a still scene, over all its recordings.

    Attributes:
        on, off: how many there were, ``[H, W]``.
        seconds: how long was recorded, from each recording's first event to its last [s].
        next_alike, next_opposite: how many had the polarity of the one before them in their recording, and how many the
            other, ``[H, W]``.
    """

    on: npt.NDArray[np.int64]
    off: npt.NDArray[np.int64]
    seconds: float = 0.0
    next_alike: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros((1, 1), np.int64))
    next_opposite: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros((1, 1), np.int64))

    @classmethod
    def of_size(cls, width: int, height: int) -> Counts:
        """Return those of no recording."""
        on, off, alike, opposite = (np.zeros((height, width), np.int64) for _ in range(4))
        return cls(on, off, 0.0, alike, opposite)

    def add(self, batches: Iterable[EventBatch]) -> None:
        """Count a recording's events.

        Raises:
            InputError: an event lies outside.
        """
        first_us = last_us = None
        height, width = self.on.shape
        before = np.zeros(width * height, np.int8)  # 1 is ON, -1 OFF
        for batch in batches:
            if not len(batch):
                continue
            first_us = int(batch["t"][0]) if first_us is None else first_us
            last_us = int(batch["t"][-1])
            at = pixel_numbers(batch, width, height)
            for counts, chosen in ((self.on, batch["on"]), (self.off, ~batch["on"])):
                counts += np.bincount(at[chosen], minlength=width * height).reshape(height, width)
            self._add_pairs(at, np.where(batch["on"], 1, -1).astype(np.int8), before)
        if first_us is not None and last_us is not None:
            self.seconds += (last_us - first_us) * 1e-6

    def _add_pairs(self, at: npt.NDArray[np.int64], sign: npt.NDArray[np.int8], before: npt.NDArray[np.int8]) -> None:
        """Count which events have the sign of their pixel's last one; ``before`` keeps these."""
        order = np.argsort(at, kind="stable")
        at, sign = at[order], sign[order]
        firsts = np.append(True, at[1:] != at[:-1])
        product = sign * np.where(firsts, before[at], np.roll(sign, 1))
        shape = self.on.shape
        for counts, wanted in ((self.next_alike, 1), (self.next_opposite, -1)):
            counts += np.bincount(at[product == wanted], minlength=self.on.size).reshape(shape)
        lasts = np.append(firsts[1:], True)
        before[at[lasts]] = sign[lasts]


def pixel_numbers(batch: EventBatch, width: int, height: int) -> npt.NDArray[np.int64]:
    """Return y·width + x of each event.

    Raises:
        InputError: an event lies outside.
    """
    x, y = batch["x"].astype(np.int64), batch["y"].astype(np.int64)
    if len(batch) and (x.max() >= width or y.max() >= height):
        raise InputError(f"`resolution` is {width}x{height}, but there is an event at x {x.max()}, y {y.max()}")
    return y * width + x


@dataclass(frozen=True)
class StillFit:
    """Numbers of a sensor, each with its standard error; see `clsim.sensor.pixel_stages` for what they are.

    Attributes:
        noise_hz: rate of noise events of each polarity, of a median pixel [1/s].
        noise_decades: standard deviation of log10 of that rate over the pixels.
        leak_hz: rate at which a median pixel leaks, were there no noise [1/s].
        leak_decades: as of noise; it holds the mismatch of thresholds too, over which pixels leak. Where a mean pixel
            leaks for less than a period, the recording does not tell it: it is that of a measured camera.
        hot: which pixels are hot, ``[H, W]``.
        hot_hz, hot_decades: of the hot pixels; None where there are too few.
    """

    noise_hz: tuple[float, float]
    noise_decades: tuple[float, float]
    leak_hz: tuple[float, float]
    leak_decades: tuple[float, float]
    hot: npt.NDArray[np.bool_]
    hot_hz: tuple[float, float] | None
    hot_decades: tuple[float, float] | None

    @property
    def hot_share(self) -> tuple[float, float]:
        """Share of pixels that are hot."""
        share = float(self.hot.mean())
        return share, math.sqrt(share * (1 - share) / self.hot.size)


def fit_still(counts: Counts) -> StillFit:
    """Return the sensor that best explains a still scene.

    OFF events are noise; noise fires as many ON events; all other ON events are leak. Rates are lognormal over pixels.
    They follow from mean and variance of the pixels' counts: those of noise, where the rate is lognormal with the mean
    m and a standard deviation of its log of s, have the variance m + m² (exp(s²) − 1).

    Raises:
        InputError: there are too few events to tell anything.
    """
    total = int(counts.on.sum() + counts.off.sum())
    if total < _FEWEST_EVENTS or counts.seconds <= 0:
        raise InputError(f"a fit needs {_FEWEST_EVENTS} events of a still scene at least, got {total}; record longer")
    hot = _hot_pixels(counts)
    on, off = (each[~hot].astype(np.float64) for each in (counts.on, counts.off))
    # In less than a period a pixel has one event of leak or none, however its rate differs from others'.
    told = bool(on.mean() - off.mean() >= 1)
    best = _rates(on, off, counts.seconds, told)
    draw = np.random.default_rng(0)
    chosen = [draw.integers(0, len(on), len(on)) for _ in range(_RESAMPLED)]
    errors = np.std([_rates(on[each], off[each], counts.seconds, told) for each in chosen], axis=0)
    noise, noise_decades, leak, leak_decades = (
        (float(value), float(error)) for value, error in zip(best, errors, strict=True)
    )
    if leak[0] > 0 and not told:
        leak_decades = leak_decades[0], _USUAL_SIGMA / _DECADE
    hot_hz = hot_decades = None
    if hot.sum() >= 3:
        logs = np.log10((counts.on + counts.off)[hot] / counts.seconds)
        decades = float(np.std(logs, ddof=1))
        median = float(10 ** np.median(logs))
        hot_hz = median, MEDIAN_ERROR * median * _DECADE * decades / math.sqrt(len(logs))
        hot_decades = decades, decades / math.sqrt(2 * len(logs))
    return StillFit(noise, noise_decades, leak, leak_decades, hot, hot_hz, hot_decades)


def _hot_pixels(counts: Counts) -> npt.NDArray[np.bool_]:
    total = (counts.on + counts.off).astype(np.float64)
    if np.median(total) < _FEW_EACH:
        return _hot_of_few(total)
    # Pixels that never fired are as quiet as those that fired once, for all that is known.
    logs = np.log(np.maximum(total, 1.0))
    low, middle = np.quantile(logs, [0.16, 0.5])
    # Of the quiet side alone: hot pixels lie on the other. Counting itself spreads by the root of the count.
    sigma = max(middle - low, _SMALLEST_SIGMA, math.exp(-middle / 2))
    return np.asarray((total >= _FEWEST_OF_HOT) & (logs > middle + _HOT_SIGMAS * sigma))


def _hot_of_few(total: FloatArray) -> npt.NDArray[np.bool_]:
    """Return which pixels are hot where most fired so seldom that their counts do not tell how rates spread.

    Rates are taken to spread as a measured camera's: a pixel is hot that fires more often than chance lets one do whose
    rate is `_HOT_SIGMAS` of that above the mean of those that are not hot.
    """
    from scipy.special import pdtrik

    hot = np.zeros(total.shape, bool)
    for _ in range(_ROUNDS):
        highest = total[~hot].mean() * math.exp(_HOT_SIGMAS * _USUAL_SIGMA)
        hot = total >= max(_FEWEST_OF_HOT, pdtrik(1 - _CHANCE, highest))
    return hot


def _rates(on: FloatArray, off: FloatArray, seconds: float, told: bool) -> tuple[float, float, float, float]:
    """Return median and spread [decades] of noise and of leak; that of leak is `_USUAL_SIGMA` unless it is ``told``."""
    noise, noise_square = off.mean(), 0.0
    if noise > 0:
        noise_square = math.log1p(max(off.var() - noise, 0.0) / noise**2)
    noise_hz, noise_sigma = noise / seconds * math.exp(-noise_square / 2), math.sqrt(noise_square)
    leaked = on.mean() - noise
    if leaked <= 0:
        return noise_hz, noise_sigma / _DECADE, 0.0, 0.0
    leak_sigma = _USUAL_SIGMA
    if told:
        of_others = noise + noise**2 * math.expm1(noise_square)
        of_others += _of_phases(leaked * math.exp(-(leak_sigma**2) / 2), leak_sigma)
        leak_sigma = math.sqrt(math.log1p(max(on.var() - of_others, 0.0) / leaked**2))
    start = math.log(leaked / seconds) - leak_sigma**2 / 2, max(leak_sigma, 0.01)
    variance = float(on.var()) if told else None
    leak_hz, leak_sigma = _leak_of(float(on.mean()), variance, seconds, 2 * noise_hz, noise_sigma, start)
    return noise_hz, noise_sigma / _DECADE, leak_hz, leak_sigma / _DECADE


def _of_phases(periods: float, sigma: float) -> float:
    """Return the variance of the number of leak's periods that phases at random make, on average over the pixels.

    A pixel that leaks for p periods ends ⌊p⌋ of them or one more: that varies by f (1 − f), f the fraction of p.
    ``periods`` are those of a median pixel; the log of p has the standard deviation ``sigma``.
    """
    from scipy.special import ndtri

    fraction = periods * np.exp(sigma * ndtri((np.arange(_QUANTILES) + 0.5) / _QUANTILES)) % 1
    return float((fraction * (1 - fraction)).mean())


def _leak_of(
    mean: float, variance: float | None, seconds: float, noise_hz: float, noise_sigma: float, start: tuple[float, float]
) -> tuple[float, float]:
    """Return median and spread [ln] of leak with which ON events have this mean and variance over the pixels.

    Without a variance the spread is that of ``start``.
    Each noise event, of which there are ``noise_hz`` of both polarities, takes back what has leaked. Leak and noise
    are lognormal, and integrated over by Gauss and Hermite.
    """
    from scipy.optimize import least_squares

    nodes, weights = np.polynomial.hermite_e.hermegauss(15)
    weights = weights / weights.sum()
    both = weights[:, None] * weights
    noise = noise_hz * np.exp(noise_sigma * nodes)[:, None]

    def misses(guess: FloatArray) -> FloatArray:
        rate, fano = _on_events(noise, np.exp(guess[0] + guess[1] * nodes))
        counts = rate * seconds
        found = (both * counts).sum()
        if variance is None:
            return np.array([found / mean - 1, guess[1] - start[1]])
        spread = (both * counts**2).sum() - found**2 + (both * fano).sum() * seconds
        spread += _of_phases(math.exp(guess[0]) * seconds, guess[1])
        return np.array([found / mean - 1, (spread - variance) / mean**2])

    found = least_squares(misses, start, bounds=([-np.inf, 0.0], [np.inf, np.inf]), x_scale=(1.0, 0.1)).x
    return float(math.exp(found[0])), float(found[1])


def _on_events(noise: FloatArray, leak: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of the number of ON events in a second, of pixels with these rates of noise and leak.

    After a noise event the pixel leaks anew: until the next, X / noise later, X exponential, it fires ⌊X / x⌋ times,
    x = noise / leak, and then once more if that one is ON. Means and variances are those of renewal theory.
    """
    x = np.maximum(noise / leak, _FEW)
    noise = x * leak
    p, rest = np.exp(-x), -np.expm1(-x)
    fires, squares, with_wait = p / rest, p * (1 + p) / rest**2, p / rest + x * p / rest**2
    in_all = 0.5 + fires
    variance = (0.5 + fires + squares) - 2 * in_all * (0.5 + with_wait) + 2 * in_all**2
    return noise * in_all, noise * variance
