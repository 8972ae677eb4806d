"""The float64 reference of smoothed irradiance: the oracle of irradiance.cl."""

from __future__ import annotations

import numpy as np

from clsim.detect.config import DetectorConfig
from clsim.detect.float64.observation import (
    F64,
    LARGEST_LUMINANCE,
    Mask,
    Observation,
    log_brightness,
    scaled_luminance,
    weights_of,
)
from clsim.frames import ALBEDO, COVERAGE, DEPTH, EMISSION, NORMAL, RADIANCE, SAMPLES, Frame

LEAST_REFLECTANCE = 1e-3
"""Surfaces that reflect less than this tell nothing of the light that falls on them."""
NORMAL_SIGMA = 0.2
DEPTH_SIGMA = 0.02
"""Of the centre's depth; the slope of depth adds to it."""
CUT = 20.0
"""Weights below exp(−20) are 0, so that one surface does not mix with another."""
BOX_REACH = 4
"""Half the side of the square in which details are set against noise [pixels]."""
EXCESS = 2.0
"""Details shrink by this many times noise's share: measured in few pixels, noise may seem half of what it is."""
LEAST_OF_FOUR = 1.678
"""Mean of the least square of a pixel's four second differences, in normal noise of variance 1 (simulated)."""


def observe_irradiance(frame: Frame, config: DetectorConfig) -> Observation:
    """Turn a frame into the brightness of its smoothed irradiance; there are no features."""
    level, _, valid = smoothed_level(frame, config)
    level[~valid] = 0.0
    return Observation(level, np.zeros((*level.shape, 2)), valid, valid, None)


def smoothed_level(frame: Frame, config: DetectorConfig) -> tuple[F64, F64, Mask]:
    """Return L, its standard error (both in natural-log units) and which pixels are valid, each ``[H, W]``.

    E = (luminance − emission) / (albedo · coverage) is averaged over a window of `config.side` with Gaussian weights of
    distance (σ: half the window's reach), normal and depth, and L = ln(emission + E · albedo · coverage).

    The mean gives way to that of the inner 3×3 pixels, and this to the pixel itself, each by the share of the
    difference that noise does not explain: 1 − `EXCESS` · noise / energy where that is positive (the idea of James and
    Stein, 1961), both summed over the square around the pixel. Noise is what second differences of E − mean leave,
    which see neither slopes nor straight edges (after Immerkær, "Fast noise variance estimation", CVIU 1996). The
    standard error is that of the window's mean.
    """
    shape = (frame.height, frame.width)

    def planes(names: tuple[str, ...]) -> F64:
        return np.stack([frame.plane(name).astype(np.float64) for name in names])

    def optional(names: tuple[str, ...], value: float) -> F64:
        return planes(names)[0] if names[0] in frame.names else np.full(shape, value)

    weights = weights_of(config)
    rgb, albedo, normal, depth = planes(RADIANCE), planes(ALBEDO), planes(NORMAL), planes(DEPTH)[0]
    coverage, emission, samples = optional(COVERAGE, 1.0), optional(EMISSION, 0.0), optional(SAMPLES, 1.0)
    valid = np.isfinite(np.concatenate([rgb, albedo, normal, [depth, coverage, emission]])).all(axis=0)
    rgb, albedo, normal, coverage, emission, depth = (
        np.where(valid, values, 0.0) for values in (rgb, albedo, normal, coverage, emission, depth)
    )
    y, emission = scaled_luminance(rgb, config), emission * config.scale
    reflectance = np.tensordot(weights, albedo, axes=1) * coverage
    bright = valid & (reflectance > LEAST_REFLECTANCE)
    usable = bright & (samples > 0)
    e = np.maximum(y - emission, 0.0) / np.where(bright, reflectance, 1.0)
    e = np.where(usable, np.minimum(e, LARGEST_LUMINANCE), 0.0)
    mean, inner, error = _smooth(e, usable, normal, depth, valid & (coverage > 0), config.side // 2)
    best = _give_way(e, inner, mean, usable, config.side // 2)
    smooth = emission + mean * reflectance
    relative = np.where(bright, error * reflectance / np.where(smooth > 0, smooth, 1.0), 0.0)
    return log_brightness(np.where(bright, emission + best * reflectance, y), config), relative, valid


def detail_noise(reach: int) -> tuple[float, float]:
    """Return the variances of inner mean − window mean, and of pixel − inner mean, where E is noise of variance 1.

    All weights are those of distance: on one surface, far from its edges.
    """
    x, y = np.meshgrid(*2 * [np.arange(-reach, reach + 1)])
    window = np.exp(-(x * x + y * y) / (2 * (reach / 2) ** 2))
    inner = window * (np.maximum(np.abs(x), np.abs(y)) <= 1)
    pixel = (x == 0) & (y == 0)
    window, inner = window / window.sum(), inner / inner.sum()
    return float(((inner - window) ** 2).sum()), float(((pixel - inner) ** 2).sum())


def _give_way(e: F64, inner: F64, mean: F64, usable: Mask, reach: int) -> F64:
    """Return ``mean`` where its difference from ``inner`` and ``e`` is noise, these where it is not."""
    coarse, fine = np.where(usable, inner - mean, 0.0), np.where(usable, e - inner, 0.0)
    noise = _noise_variance(coarse + fine, usable)

    def share(detail: F64, variance: float) -> F64:
        energy = np.maximum(_box_sum(detail**2), 1e-290)
        return np.maximum(1 - EXCESS * variance * noise / energy, 0.0)

    coarse_noise, fine_noise = detail_noise(reach)
    return mean + share(coarse, coarse_noise) * (coarse + share(fine, fine_noise) * fine)


def _noise_variance(rest: F64, usable: Mask) -> F64:
    """Return the variance of white noise in ``rest``, times the usable pixels of the square around each pixel.

    It is the lesser of two estimates, each of which takes some edges for noise: second differences across second
    differences see no upright and no level edge, the least of four none that is straight for three pixels.
    """
    across, down, rising, falling = (_second_difference(rest, dx, dy) for dx, dy in ((1, 0), (0, 1), (1, -1), (1, 1)))
    twice = _second_difference(across, 0, 1) ** 2 / 36
    least = np.min([across**2, down**2, rising**2, falling**2], axis=0) / LEAST_OF_FOUR
    return np.minimum(*(_box_sum(np.where(usable, squares, 0.0)) for squares in (twice, least)))


def _second_difference(plane: F64, dx: int, dy: int) -> F64:
    return _moved(plane, dx, dy) + _moved(plane, -dx, -dy) - 2 * plane


def _box_sum(plane: F64) -> F64:
    """Return sums over squares of `BOX_REACH`; nothing is outside."""
    steps = range(-BOX_REACH, BOX_REACH + 1)
    rows = np.sum([_moved(plane, dx, 0) for dx in steps], axis=0)
    total: F64 = np.sum([_moved(rows, 0, dy) for dy in steps], axis=0)
    return total


def _smooth(e: F64, usable: Mask, normal: F64, depth: F64, hit: Mask, reach: int) -> tuple[F64, F64, F64]:
    """Return the weighted mean of ``e`` in each pixel's window, of its inner 3×3, and the former's standard error."""
    normal, depth = np.where(hit, normal, 0.0), np.where(hit, depth, 0.0)
    slope_x, slope_y = _slope(depth, hit, 1), _slope(depth, hit, 0)
    taps, values, within = [], [], []
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            n, d, near, value = (_moved(p, dx, dy) for p in (normal, depth, usable.astype(np.float64), e))
            allowed = DEPTH_SIGMA * np.abs(depth) + slope_x * abs(dx) + slope_y * abs(dy) + 1e-6
            exponent = (
                (dx * dx + dy * dy) / (2 * (reach / 2) ** 2)
                + ((n - normal) ** 2).sum(axis=0) / (2 * NORMAL_SIGMA**2)
                + ((d - depth) / allowed) ** 2 / 2
            )
            taps.append(near * np.where(exponent < CUT, np.exp(-exponent), 0.0))
            values.append(value)
            within.append(max(abs(dx), abs(dy)) <= 1)
    w, v, i = np.stack(taps), np.stack(values), np.array(within)
    total, squares = w.sum(axis=0), (w * w).sum(axis=0)
    mean = (w * v).sum(axis=0) / np.where(total > 0, total, 1.0)
    inner_total = w[i].sum(axis=0)
    inner = (w[i] * v[i]).sum(axis=0) / np.where(inner_total > 0, inner_total, 1.0)
    variance = (w * (v - mean) ** 2).sum(axis=0) / np.where(total > 0, total, 1.0)
    effective = total**2 / np.where(squares > 0, squares, 1.0)
    return mean, inner, np.sqrt(variance / np.maximum(effective - 1, 1.0))


def _slope(depth: F64, hit: Mask, axis: int) -> F64:
    """Return half the difference of the two neighbours' depth, absolute; 0 at the border and beside a miss."""
    result = np.zeros_like(depth)
    d, h, out = np.moveaxis(depth, axis, 0), np.moveaxis(hit, axis, 0), np.moveaxis(result, axis, 0)
    out[1:-1] = np.where(h[2:] & h[:-2], np.abs(d[2:] - d[:-2]) / 2, 0.0)
    return result


def _moved(plane: F64, dx: int, dy: int) -> F64:
    """Return the values at (x + dx, y + dy) of the last two axes; 0 outside."""
    height, width = plane.shape[-2:]
    result = np.zeros_like(plane)
    if abs(dy) < height and abs(dx) < width:
        to = (..., slice(max(-dy, 0), height - max(dy, 0)), slice(max(-dx, 0), width - max(dx, 0)))
        source = (..., slice(max(dy, 0), height - max(-dy, 0)), slice(max(dx, 0), width - max(-dx, 0)))
        result[to] = plane[source]
    return result
