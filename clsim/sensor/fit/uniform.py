"""Thresholds, photons and leak from still, even scenes alone, each in another light.

A pixel looks again and again, each time for as long as it takes to forget, and counts photons: n, Poisson, of mean
λ = α·E in light E, and θ more that the dark adds. It fires if ln((n + θ) / (m + θ)), m being what it counted the look
before, reaches a threshold. So few photons fire often and of both polarities, and many hardly ever; what ON events
bright light has beside, leaks. The idea, to find thresholds, photons and leak in such rates, is that of Noise2Params
(arXiv 2605.16317); the equations are clsim's own.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.sensor.fit.still import Counts

FloatArray = npt.NDArray[np.float64]
FEWEST_LIGHTS = 5
"""Illuminances that seven numbers take, with two rates in each."""
_MANY = 150.0
"""Photons a look from which on their number is normal."""
_MISMATCH = 0.1
"""Relative spread of thresholds over the pixels, that of measured cameras."""
_NODES = 15
_LOG_MOST = 0.5
"""Standard error of a number's logarithm from which on it is not known."""
_THRESHOLDS, _DARK, _TRIED = (0.07, 0.12, 0.2, 0.34), (0.3, 1.0, 3.0, 10.0), 3
"""Where a search begins, and how many of the best it goes on from."""
_AS_WELL = 4.0
"""Squares of standard errors, of all rates, by which another fit is no worse: within two standard errors."""
_FARTHEST = 30.0
"""Largest logarithm of what is sought; a threshold's is 3."""
_STEP = 0.02
"""Of logarithms, by which rates are seen to change."""
_MISFIT = 25.0
"""Squares of standard errors, a rate on average, by which rates of another model are off."""


@dataclass(frozen=True)
class Rates:
    """Mean rates over the pixels in one light.

    Attributes:
        lux: illuminance of the sensor [lux].
        on_hz, off_hz: of a mean pixel, each with its standard error [1/s].
    """

    lux: float
    on_hz: tuple[float, float]
    off_hz: tuple[float, float]


def rates_of(lux: float, counts: Counts, quiet: npt.NDArray[np.bool_]) -> Rates:
    """Return the rates of the pixels that are ``quiet`` in a recording of that illuminance.

    Raises:
        InputError: it is too short to have any.
    """
    if counts.seconds <= 0:
        raise InputError(f"the recording at {lux:g} lux has no two events: record longer")
    pixels = int(quiet.sum())

    def rate(events: npt.NDArray[np.int64]) -> tuple[float, float]:
        each = events[quiet].astype(np.float64)
        # Of no event nobody knows more than that there was less than one.
        error = max(float(each.std(ddof=1)) * math.sqrt(pixels), 1.0)
        return float(each.mean()) / counts.seconds, error / pixels / counts.seconds

    return Rates(lux, rate(counts.on), rate(counts.off))


@dataclass(frozen=True)
class UniformFit:
    """What the rates tell, each number with its standard error; None where they do not tell it.

    Attributes:
        on, off: contrast thresholds [natural-log units].
        photons_per_lux: that a look counts for each lux, α.
        dark_photons: that the dark adds to each count, θ.
        look_s: how long a look takes [s].
        leak_hz, leak_hz_per_lux: rate of ON events that leak, in the dark and for each lux.
        misfit: mean square of what rates are off by, in standard errors.
    """

    on: tuple[float, float] | None
    off: tuple[float, float] | None
    photons_per_lux: tuple[float, float] | None
    dark_photons: tuple[float, float] | None
    look_s: tuple[float, float] | None
    leak_hz: tuple[float, float]
    leak_hz_per_lux: tuple[float, float]
    misfit: float


def look_probabilities(photons: float, dark: float, on: float, off: float) -> tuple[float, float]:
    """Return how likely a look fires ON, and OFF, of a mean pixel.

    Args:
        photons: mean number in a look.
        dark: what the dark adds to each count.
        on, off: mean contrast thresholds; pixels differ.
    """
    from scipy.special import ndtr, pdtr

    if photons > _MANY:
        nodes, weights = np.polynomial.hermite_e.hermegauss(_NODES)
        spread, weights, level = 1 + _MISMATCH * nodes, weights / weights.sum(), photons + dark
        up, down = np.exp(on * spread), np.exp(-off * spread)
        rises = ndtr(-level * (up - 1) / np.sqrt(photons * (1 + up**2)))
        falls = ndtr(-level * (1 - down) / np.sqrt(photons * (1 + down**2)))
        return float(weights @ rises), float(weights @ falls)
    reach = 7 * math.sqrt(photons) + 8
    counts = np.arange(max(0, math.floor(photons - reach)), math.ceil(photons + reach) + 1)
    chance = np.diff(pdtr(counts, photons), prepend=pdtr(counts[0] - 1, photons) if counts[0] else 0.0)
    level = np.log(counts + dark)
    rise = level - level[:, None]  # from each count to each
    both = chance[:, None] * chance
    chances = (both * (way > 0) * ndtr((way / mean - 1) / _MISMATCH) for way, mean in ((rise, on), (-rise, off)))
    rises, falls = (float(each.sum()) for each in chances)
    return rises, falls


def fit_uniform(rates: Sequence[Rates]) -> UniformFit:
    """Return what best explains the rates in several lights, by least squares.

    Errors are those of the rates and, where these are off by more, of that, and how far apart numbers are that explain
    the rates as well. Thresholds and photons are None where the lights do not tell them, or the noise is not of such
    looks.

    Raises:
        InputError: there are too few lights.
    """
    from scipy.optimize import least_squares, nnls

    lux = np.array([each.lux for each in rates])
    if len(set(lux.tolist())) < FEWEST_LIGHTS:
        raise InputError(f"thresholds of even scenes take {FEWEST_LIGHTS} illuminances at least, got {len(set(lux))}")
    found, errors = (np.array([[each.on_hz[k], each.off_hz[k]] for each in rates]) for k in range(2))

    weights = 1 / errors.ravel()

    def explained(shape: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Return what light makes of the rates, and the best looks a second and leaks to go with it, and the misfit."""
        on, off, per_lux, dark, _ = _numbers([*shape, 0.0])
        parts = np.zeros((len(lux), 2, 3))
        parts[..., 0] = [look_probabilities(per_lux * each, dark, on, off) for each in lux]
        parts[:, 0, 1], parts[:, 0, 2] = 1.0, lux
        table = parts.reshape(-1, 3) * weights[:, None]
        best, off_by = nnls(table, found.ravel() * weights)
        return table, best, off_by**2

    def misses(shape: FloatArray) -> FloatArray:
        table, best, _ = explained(shape)
        return np.asarray(table @ best - found.ravel() * weights)

    # Where noise falls, a threshold squared times the photons is about 1.
    squares = np.geomspace(0.3 / lux.max(), 3 / lux.min(), 10)
    starts = [np.log(each) for each in itertools.product(_THRESHOLDS, (0.8, 1.25), squares, _DARK)]

    def best_near(start: FloatArray) -> Any:
        return least_squares(misses, start, x_scale=0.1, diff_step=1e-3, max_nfev=40)

    tried = [best_near(start) for start in sorted(starts, key=lambda shape: explained(shape)[2])[:_TRIED]]
    first = min(tried, key=lambda each: float(each.cost)).x
    # Other thresholds, with as many more photons, may explain them as well.
    away = [math.log(on) - first[0] for on in _THRESHOLDS]
    tried += [best_near(first + by * np.array([1, 0, 0, -2])) for by in away if abs(by) > _LOG_MOST]
    shape = min(tried, key=lambda each: float(each.cost)).x
    table, linear, misfit = explained(shape)
    degrees = max(1, 2 * len(rates) - 7)
    allowed = misfit + _AS_WELL * max(1.0, misfit / degrees)
    others = [each.x - shape for each in tried if 2 * each.cost < allowed]
    slopes = [
        (explained(shape + step)[0] - explained(shape - step)[0]) @ linear / (2 * _STEP) for step in _STEP * np.eye(4)
    ]
    jacobian = np.column_stack([*slopes, table])
    jacobian[:, 4] *= linear[0]  # of the logarithm of looks a second
    return _told(shape, linear, jacobian, misfit / degrees, np.array(others))


def _numbers(guess: Any) -> tuple[float, float, float, float, float]:
    """Return thresholds, photons a lux, photons of the dark and a look's length [s], of what is sought.

    Thresholds and photons are nearly one number: rates hang on on² · photons, and on both apart where these are few.
    A search may try what is far beyond all sense; then the farthest counts that can be computed with.
    """
    on, ratio, squared, dark, look_s = np.exp(np.clip(guess, -_FARTHEST, (3.0, *4 * (_FARTHEST,)))).tolist()
    return on, on * ratio, squared / on**2, dark, look_s


def _told(shape: FloatArray, linear: FloatArray, jacobian: FloatArray, misfit: float, others: FloatArray) -> UniformFit:
    """Return the numbers of a fit with their errors; ``others`` ``[N, 4]`` are as good, at such distances."""
    # What the rates do not hang on has an error of a thousand.
    covariance = np.linalg.inv(jacobian.T @ jacobian + 1e-6 * np.eye(7)) * max(1.0, misfit)
    # Each number's logarithm is a sum of those sought: of `_numbers`.
    made = np.array([[1, 0, 0, 0, 0], [1, 1, 0, 0, 0], [-2, 0, 1, 0, 0], [0, 0, 0, 1, 0], [0, 0, 0, 0, 1]])
    of_logs = np.sqrt(np.diag(made @ covariance[:5, :5] @ made.T))
    of_logs = np.maximum(of_logs, np.abs(made[:, :4] @ others.T).max(axis=1)).tolist()
    # Where no threshold is known, looks are of any length.
    told = misfit < _MISFIT and linear[0] > 0 and max(of_logs[:2]) < _LOG_MOST
    values = _numbers([*shape, -math.log(linear[0]) if told else 0.0])
    numbers = [
        (value, value * error) if told and error < _LOG_MOST else None
        for value, error in zip(values, of_logs, strict=True)
    ]
    errors = np.sqrt(np.diag(covariance))
    leak, per_lux = ((float(linear[k]), float(errors[4 + k])) for k in (1, 2))
    on, off, photons, dark, look_s = numbers
    return UniformFit(on, off, photons, dark, look_s, leak, per_lux, misfit)
