"""The float64 reference of smoothed irradiance: the oracle of irradiance.cl."""

from __future__ import annotations

import numpy as np

from clsim.detect.config import DetectorConfig
from clsim.detect.reference_observation import (
    F64,
    LARGEST_LUMINANCE,
    LUMINANCE_WEIGHTS,
    Mask,
    Observation,
    log_brightness,
    scaled_luminance,
)
from clsim.frames import ALBEDO, COVERAGE, DEPTH, EMISSION, NORMAL, RADIANCE, SAMPLES, Frame

LEAST_REFLECTANCE = 1e-3
"""Surfaces that reflect less than this tell nothing of the light that falls on them."""
NORMAL_SIGMA = 0.2
DEPTH_SIGMA = 0.02
"""Of the centre's depth; the slope of depth adds to it."""
CUT = 20.0
"""Weights below exp(−20) are 0, so that one surface does not mix with another."""


def observe_irradiance(frame: Frame, config: DetectorConfig) -> Observation:
    """Turn a frame into the brightness of its smoothed irradiance; there are no features."""
    level, _, valid = smoothed_level(frame, config)
    level[~valid] = 0.0
    return Observation(level, np.zeros((*level.shape, 2)), valid, valid, None)


def smoothed_level(frame: Frame, config: DetectorConfig) -> tuple[F64, F64, Mask]:
    """Return L, its standard error (both in natural-log units) and which pixels are valid, each ``[H, W]``.

    E = (luminance − emission) / (albedo · coverage) is averaged over a window of `config.side` with Gaussian weights of
    distance (σ: half the window's reach), normal and depth, and L = ln(emission + mean E · albedo · coverage).
    """
    shape = (frame.height, frame.width)

    def planes(names: tuple[str, ...]) -> F64:
        return np.stack([frame.plane(name).astype(np.float64) for name in names])

    def optional(names: tuple[str, ...], value: float) -> F64:
        return planes(names)[0] if names[0] in frame.names else np.full(shape, value)

    weights = np.asarray(LUMINANCE_WEIGHTS[config.luminance])
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
    mean, error = _smooth(e, usable, normal, depth, valid & (coverage > 0), config.side // 2)
    shown = np.where(bright, emission + mean * reflectance, y)
    relative = np.where(bright, error * reflectance / np.where(shown > 0, shown, 1.0), 0.0)
    return log_brightness(shown, config), relative, valid


def _smooth(e: F64, usable: Mask, normal: F64, depth: F64, hit: Mask, reach: int) -> tuple[F64, F64]:
    """Return the weighted mean of ``e`` in each pixel's window, and the mean's standard error."""
    normal, depth = np.where(hit, normal, 0.0), np.where(hit, depth, 0.0)
    slope_x, slope_y = _slope(depth, hit, 1), _slope(depth, hit, 0)
    taps, values = [], []
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
    w, v = np.stack(taps), np.stack(values)
    total, squares = w.sum(axis=0), (w * w).sum(axis=0)
    mean = (w * v).sum(axis=0) / np.where(total > 0, total, 1.0)
    variance = (w * (v - mean) ** 2).sum(axis=0) / np.where(total > 0, total, 1.0)
    effective = total**2 / np.where(squares > 0, squares, 1.0)
    return mean, np.sqrt(variance / np.maximum(effective - 1, 1.0))


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
