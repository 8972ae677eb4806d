"""In float64, first stage: a frame becomes log brightness and features of the regression."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from clsim.detect.config import DetectorConfig
from clsim.errors import InputError
from clsim.frames import ALBEDO, COVERAGE, DEPTH, NORMAL, RADIANCE, Frame

REGRESSING = ("wlr-esim", "esim-ad")
"""Methods that regress brightness on features."""

F64 = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

FEATURE_PLANES = DEPTH + NORMAL + ALBEDO + COVERAGE
"""Planes that may be features, besides pixel x and y (Tsuji et al., ICIP 2023, section 3)."""

LUMINANCE_WEIGHTS = {"rec709": (0.2126, 0.7152, 0.0722), "rec601": (0.299, 0.587, 0.114)}

LARGEST_LUMINANCE = 1e12
"""Where luminance is regressed, larger values count as this: their squares would leave float32."""
VARIANCE = "Variance.Luminance"

LIN_LOG_KNEE = 20.0
"""Where the lin-log response turns from linear to logarithmic, on values 0…255."""


@dataclass(slots=True)
class Observation:
    """One frame as the regression sees it.

    Attributes:
        brightness: ``[H, W]``, what is regressed: L in natural-log units, or scaled luminance; 0 where invalid.
        features: ``[H, W, D]``, raw units: pixel x, pixel y, then the feature planes; 0 where invalid.
        valid: ``[H, W]``, whether radiance and all used planes of the pixel are finite.
        hit: ``[H, W]``, whether any sample of the pixel hit; True everywhere if the frame has no coverage plane.
        depth: index of depth among the features, or None.
        brightness_variance: ``[H, W]``, variance of ``brightness``; None where nothing asks for it.
        feature_variance: ``[H, W, D]``, variances of the features, 0 for pixel x and y; None without bandwidth
            selection.
    """

    brightness: F64
    features: F64
    valid: Mask
    hit: Mask
    depth: int | None
    brightness_variance: F64 | None = None
    feature_variance: F64 | None = None


def feature_names(config: DetectorConfig, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the planes to regress on, in the order of ``names``."""
    wanted = FEATURE_PLANES if config.features is None else config.features
    return tuple(name for name in names if name in wanted)


def weights_of(config: DetectorConfig) -> F64:
    """Return what brightness has of R, G and B."""
    chosen = config.luminance
    return np.asarray(LUMINANCE_WEIGHTS[chosen] if isinstance(chosen, str) else chosen)


def scaled_luminance(rgb: F64, config: DetectorConfig) -> F64:
    """Return the luminance of linear radiance ``[3, …]``, times the configured scale."""
    if config.mosaic is not None:
        height, width = rgb.shape[1:]
        square = np.array(config.mosaic).reshape(2, 2, 3)
        behind = square[np.arange(height)[:, None] % 2, np.arange(width) % 2]
        return np.asarray(np.einsum("yxc,cyx->yx", behind, rgb) * config.scale)
    weights = weights_of(config)
    result: F64 = np.tensordot(weights, rgb, axes=1) * config.scale
    return result


def log_brightness(y: F64, config: DetectorConfig) -> F64:
    """Return L of scaled luminance: natural log, or linear below a knee (``lin-log``, as v2e has it)."""
    if config.response == "ln":
        result: F64 = np.log(np.maximum(y, config.floor))
        return result
    value = 255.0 * y
    slope = np.log(LIN_LOG_KNEE) / LIN_LOG_KNEE
    return np.where(value <= LIN_LOG_KNEE, value * slope, np.log(np.maximum(value, LIN_LOG_KNEE)))


def observe(frame: Frame, planes: tuple[str, ...], config: DetectorConfig) -> Observation:
    """Turn a frame into brightness, features and masks; ``planes`` as `feature_names` gave them."""
    height, width = frame.height, frame.width
    rgb = np.stack([frame.plane(name) for name in RADIANCE]).astype(np.float64)
    stack = [frame.plane(name).astype(np.float64) for name in planes]
    read = [*rgb, *stack]
    hit = np.ones((height, width), dtype=bool)
    if COVERAGE[0] in frame.names:
        coverage = frame.plane(COVERAGE[0]).astype(np.float64)
        hit = coverage > 0
        read.append(coverage)
    valid = np.logical_and.reduce([np.isfinite(plane) for plane in read])
    ys, xs = np.mgrid[0:height, 0:width].astype(np.float64)
    features = np.stack([xs, ys, *stack], axis=-1)
    features[~valid] = 0.0
    brightness = scaled_luminance(np.where(valid, rgb, 1.0), config)
    brightness = np.minimum(brightness, LARGEST_LUMINANCE) if config.linear else log_brightness(brightness, config)
    brightness[~valid] = 0.0
    depth = 2 + planes.index(DEPTH[0]) if DEPTH[0] in planes else None
    observation = Observation(brightness, features, valid, hit & valid, depth)
    if config.method in REGRESSING and config.shrink > 0:
        variance = frame.plane(VARIANCE).astype(np.float64) * config.scale**2
        variance[~np.isfinite(variance)] = np.nan
        observation.brightness_variance = np.where(valid, variance, 0.0)
    return observation


def add_variances(observation: Observation, frame: Frame, planes: tuple[str, ...], config: DetectorConfig) -> None:
    """Add the variances of the means, from the planes ``Variance.*``; unknown (NaN) ones count as 0.

    Without ``Variance.Luminance`` the channels are taken to vary together, which bounds it from above.

    Raises:
        InputError: a variance plane is missing.
    """
    for name in (*RADIANCE, *planes):
        if f"Variance.{name}" not in frame.names:
            raise InputError(f"`bandwidth` {config.bandwidth} needs the plane 'Variance.{name}', which the frames lack")

    def variance(name: str) -> F64:
        return np.maximum(np.nan_to_num(frame.plane(f"Variance.{name}").astype(np.float64), posinf=0.0), 0.0)

    weights = weights_of(config)
    if "Variance.Luminance" in frame.names:
        luminance_variance = variance("Luminance")
    else:
        deviation = sum(w * np.sqrt(variance(name)) for w, name in zip(weights, RADIANCE, strict=True))
        luminance_variance = np.asarray(deviation) ** 2
    if config.linear:
        observation.brightness_variance = luminance_variance * config.scale**2
    else:
        luminance = np.tensordot(weights, np.stack([frame.plane(name) for name in RADIANCE]), axes=1)
        luminance = np.maximum(np.where(observation.valid, luminance, 1.0), config.floor / config.scale)
        observation.brightness_variance = luminance_variance / luminance**2
    nothing = np.zeros(observation.valid.shape)
    observation.feature_variance = np.stack([nothing, nothing, *(variance(name) for name in planes)], axis=-1)
