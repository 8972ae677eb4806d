"""What a recording of a flickering lamp tells of a sensor: its thresholds, their mismatch, its refractory period."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events import EventBatch
from clsim.sensor.fit.still import MEDIAN_ERROR, FloatArray, pixel_numbers

_BIN_S = 1e-3
_LONGEST_SPECTRUM_S = 60.0
_MOST_PAIRS = 4_000_000
_PAIRS_FOR_MODEL = 40_000
_FEWEST_PAIRS = 1000
_FEWEST_OF_PIXEL = 3
_OUTLIER = 0.02
"""Residuals of a level beyond this count less [natural-log units]: noise fires between."""


@dataclass(frozen=True)
class FlickerFit:
    """Numbers of a sensor, each with its standard error; see `clsim.sensor.pixel_stages` for what they are.

    Attributes:
        on, off: contrast thresholds [natural-log units].
        mismatch: standard deviation of both over the pixels [natural-log units].
        rest_us: refractory period [µs].
        silent_share: share of pixels without an event, of those that were asked for: they are dead.
        frequency_hz: of the lamp.
    """

    on: tuple[float, float]
    off: tuple[float, float]
    mismatch: tuple[float, float]
    rest_us: tuple[float, float]
    silent_share: tuple[float, float]
    frequency_hz: float


@dataclass(frozen=True)
class Pairs:
    """Successive events of a pixel, of one polarity.

    Attributes:
        pixel: y·width + x.
        on: whether both are ON.
        first_s, second_s: their times from the recording's first event [s].
    """

    pixel: npt.NDArray[np.int64]
    on: npt.NDArray[np.bool_]
    first_s: FloatArray
    second_s: FloatArray

    def __getitem__(self, chosen: npt.NDArray[np.bool_] | slice) -> Pairs:
        """Return some of them."""
        return Pairs(self.pixel[chosen], self.on[chosen], self.first_s[chosen], self.second_s[chosen])

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self.pixel)


def fit_flicker(
    batches: Iterable[EventBatch], width: int, height: int, contrast: float, usable: npt.NDArray[np.bool_] | None = None
) -> FlickerFit:
    """Return the thresholds and the refractory period that best explain a lamp whose light is a sine.

    The level is L(t) = ln(1 + contrast·sin(2π f (t − t0))). Between two events of a pixel, at t1 and t2, it moves by
    the threshold from the end of the rest after the first, but for what leaks: with ℓ = L + leak·t, θ = ℓ(t2) −
    ℓ(t1 + rest). f, t0, rest and leak are those with which the θ of each pixel differ least; the median of a pixel is
    its threshold.

    Args:
        batches: the recording.
        width, height: of the sensor [pixels].
        contrast: of the lamp, (brightest − darkest) / (brightest + darkest).
        usable: pixels that count, ``[H, W]``, such as those that are not hot; None takes all.

    Raises:
        InputError: the contrast is none, or too few pixels fire several times in each period.
    """
    if not 0 < contrast < 1:
        raise InputError(f"`contrast` must lie between 0 and 1, got {contrast:g}")
    chosen = np.ones(width * height, bool) if usable is None else usable.ravel()
    pairs, net, seen = _read(batches, width, height, chosen)
    frequency, t0 = _frequency_and_phase(net)
    pairs = pairs[pairs.second_s - pairs.first_s < 0.5 / frequency]
    if len(pairs) < _FEWEST_PAIRS:
        raise InputError(
            f"a fit needs pixels that fire several times in each period of the lamp; found {len(pairs)} pairs of "
            f"events at {frequency:.3g} Hz, expected {_FEWEST_PAIRS}: record longer, or with more contrast"
        )
    best = _fit_model(pairs, np.array([t0, frequency, 1e-4, 0.0]), contrast, loss="soft_l1")
    middles, _ = _medians(pairs, _moved(pairs, best, contrast))
    # Noise that fires between two crossings of a threshold makes pairs that tell nothing of it.
    pairs = pairs[abs(_moved(pairs, best, contrast) - middles) < _OUTLIER]
    best = _fit_model(pairs, best, contrast)
    # What parts of the pixels say, one by one, tells how well all know it.
    parts = [_fit_model(pairs[pairs.pixel % 8 == part], best, contrast)[2] for part in range(8)]
    rest_us = float(best[2]) * 1e6, float(np.std(parts, ddof=1)) * 1e6 / math.sqrt(8)
    thresholds = _thresholds(pairs, best, contrast)
    silent = float(1 - seen[chosen].mean())
    (on, on_spread, on_count), (off, off_spread, off_count) = thresholds
    mismatch = math.sqrt((on_spread**2 + off_spread**2) / 2)
    return FlickerFit(
        (on, MEDIAN_ERROR * on_spread / math.sqrt(on_count)),
        (off, MEDIAN_ERROR * off_spread / math.sqrt(off_count)),
        (mismatch, mismatch / math.sqrt(2 * (on_count + off_count))),
        rest_us,
        (silent, math.sqrt(silent * (1 - silent) / chosen.sum())),
        float(best[1]),
    )


def _read(
    batches: Iterable[EventBatch], width: int, height: int, chosen: npt.NDArray[np.bool_]
) -> tuple[Pairs, FloatArray, npt.NDArray[np.bool_]]:
    """Return pairs of events, ON less OFF events in bins of time, and which pixels fired."""
    last_s = np.full(width * height, -math.inf)
    last_on = np.zeros(width * height, bool)
    net = np.zeros(round(_LONGEST_SPECTRUM_S / _BIN_S))
    found: list[Pairs] = []
    count, first_us, longest = 0, None, 0
    for batch in batches:
        if not len(batch):
            continue
        first_us = int(batch["t"][0]) if first_us is None else first_us
        at = pixel_numbers(batch, width, height)
        kept = chosen[at]
        at, on, seconds = at[kept], batch["on"][kept], (batch["t"][kept] - first_us) * 1e-6
        bins = (seconds / _BIN_S).astype(np.int64)
        inside = bins < len(net)
        np.add.at(net, bins[inside], np.where(on[inside], 1.0, -1.0))
        longest = max(longest, int(bins.max(initial=0)))
        order = np.argsort(at, kind="stable")
        at, on, seconds = at[order], on[order], seconds[order]
        new = np.ones(len(at), bool)
        new[1:] = at[1:] != at[:-1]
        before_s = np.where(new, last_s[at], np.roll(seconds, 1))
        before_on = np.where(new, last_on[at], np.roll(on, 1))
        ends = np.roll(new, -1)
        last_s[at[ends]], last_on[at[ends]] = seconds[ends], on[ends]
        if count < _MOST_PAIRS:
            same = (before_on == on) & np.isfinite(before_s)
            found.append(Pairs(at[same], on[same], before_s[same], seconds[same]))
            count += len(found[-1])
    pairs = Pairs(*(np.concatenate([getattr(each, name) for each in found] or [[]]) for name in Pairs.__annotations__))
    return pairs, net[: min(longest + 1, len(net))], np.isfinite(last_s)


def _frequency_and_phase(net: FloatArray) -> tuple[float, float]:
    """Return the lamp's frequency [Hz], and when its light rises through the mean [s], roughly."""
    if len(net) < 100 or not net.any():
        raise InputError("a fit needs a recording of a flickering lamp, but there is none in this one: it is too short")
    size = 1 << (4 * len(net) - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(net, size))
    spectrum[: 2 * size // len(net)] = 0  # slower than two periods in all
    frequency = int(spectrum.argmax()) / (size * _BIN_S)
    seconds = (np.arange(len(net)) + 0.5) * _BIN_S
    # Events are where the level changes, and most ON events where it rises fastest: at the zero of the sine.
    phase = -np.angle(np.sum(net * np.exp(-2j * math.pi * frequency * seconds)))
    return frequency, float(phase / (2 * math.pi * frequency))


def _moved(pairs: Pairs, model: FloatArray, contrast: float) -> FloatArray:
    """Return by how much what is compared moved from the end of the rest to the second event, in the events' direction.

    ``model`` holds t0 [s], f [Hz], the rest [s] and the leak [natural-log units a second].
    """
    t0, frequency, rest, leak = model

    def level(seconds: FloatArray) -> FloatArray:
        return np.asarray(np.log1p(contrast * np.sin(2 * math.pi * frequency * (seconds - t0))) + leak * seconds)

    return np.asarray(np.where(pairs.on, 1.0, -1.0) * (level(pairs.second_s) - level(pairs.first_s + rest)))


def _groups(pairs: Pairs) -> npt.NDArray[np.int64]:
    """Return numbers from 0 on, one for each pixel and polarity."""
    return np.unique(2 * pairs.pixel + pairs.on, return_inverse=True)[1]


def _medians(pairs: Pairs, values: FloatArray) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Return, for each pair, the median over its pixel and polarity, and over how many."""
    group = _groups(pairs)
    sizes = np.bincount(group)
    starts = np.cumsum(sizes) - sizes
    middles = values[np.lexsort((values, group))][starts + sizes // 2]
    return middles[group], sizes[group]


def _fit_model(pairs: Pairs, start: FloatArray, contrast: float, loss: str = "linear") -> FloatArray:
    """Return the model (see `_moved`) with which thresholds of a pixel differ least from pair to pair."""
    from scipy.optimize import least_squares

    # Whole pixels, each with all its pairs.
    pairs = pairs[pairs.pixel // 8 % max(1, len(pairs) // _PAIRS_FOR_MODEL) == 0]
    group = _groups(pairs)
    sizes = np.bincount(group)

    def differences(model: FloatArray) -> FloatArray:
        moved = _moved(pairs, model, contrast)
        return np.asarray(moved - (np.bincount(group, moved) / sizes)[group], np.float64)

    longest_s = max(float(pairs.second_s.max()), 1.0)
    found = least_squares(
        differences,
        start,
        x_scale=[1e-4, 1e-3 / longest_s, 1e-4, 0.1],
        bounds=([-np.inf, 0.0, 0.0, -np.inf], [np.inf, np.inf, 0.25 / start[1], np.inf]),
        loss=loss,
        f_scale=_OUTLIER,
    )
    return np.asarray(found.x, np.float64)


def _thresholds(pairs: Pairs, model: FloatArray, contrast: float) -> list[tuple[float, float, int]]:
    """Return the median over the pixels, their spread without outliers, and how many pixels tell; ON, then OFF."""
    medians, sizes = _medians(pairs, _moved(pairs, model, contrast))
    result = []
    for polarity in (pairs.on, ~pairs.on):
        chosen = polarity & (sizes >= _FEWEST_OF_PIXEL)
        of_pixels = medians[chosen][np.unique(pairs.pixel[chosen], return_index=True)[1]]
        if not len(of_pixels):
            raise InputError("a fit needs pixels that fire several times in each period of the lamp, up and down")
        low, middle, high = np.quantile(of_pixels, [0.16, 0.5, 0.84])
        result.append((float(middle), float(high - low) / 2, len(of_pixels)))
    return result
