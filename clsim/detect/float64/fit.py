"""In float64, second stage: weighted local regression (WLR).

Moon, Carr, Yoon, "Adaptive Rendering Based on Weighted Local Regression", ToG 2014, as used by Tsuji et al.,
ICIP 2023, section 2.1, equations 2…5. Everything is two-pass (means first, then moments of the differences), because
this is the oracle for faster code.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from clsim.detect.config import DetectorConfig
from clsim.detect.float64.observation import F64, Mask, Observation

Pixels = npt.NDArray[np.int64]
"""Indices into the flattened image, row by row."""
Kernel = Literal["gaussian", "epanechnikov"]

CONSTANT_RANGE = 1e-6
"""A feature whose range in the window is at most this share of its size is constant: rounding, not signal."""
TINY_RIDGE = 1e-12
"""Absolute part of the ridge: gives constant features slope 0 without a special case."""
EPANECHNIKOV_FLOOR = 1e-8
_CHUNK_VALUES = 1_500_000
"""Feature values gathered at a time: bounds the memory, not the result."""


@dataclass(slots=True)
class Windows:
    """The samples of n windows: ``x [n, m, D]``, ``y [n, m]``, ``mask [n, m]``, and the centres ``[n, D]``.

    Depth of misses has been replaced already, so that x is what the regression uses; ``lo``, ``hi`` ``[n, D]`` are
    the extremes over the valid samples (of depth: over those that hit; 0 where none did). The variances, shaped as
    x and y, are there if the observations have them.
    """

    x: F64
    y: F64
    mask: Mask
    centre: F64
    lo: F64
    hi: F64
    x_variance: F64 | None = None
    y_variance: F64 | None = None


@dataclass(slots=True)
class Fit:
    """Planes y ≈ α + βᵀ(x − x_c) fitted to n windows.

    Attributes:
        alpha: ``[n]``, the regressed brightness (or luminance, where that is regressed) at the centre.
        slope: ``[n, D]``, β in brightness per raw unit of each feature.
        residual: ``[n]``, R = (1/W) Σ w r².
        noise: ``[n]``, (1/W) Σ w v of the samples' variances v; 0 where they are not asked for.
        centre: ``[n, D]``, x_c in raw units (a miss has its window's largest depth).
        lo: ``[n, D]``, smallest value of each feature in the window.
        hi: ``[n, D]``, largest value.
    """

    alpha: F64
    slope: F64
    residual: F64
    noise: F64
    centre: F64
    lo: F64
    hi: F64

    def take(self, where: Mask) -> Fit:
        """Return the planes of some of the windows."""
        return Fit(*(getattr(self, name)[where] for name in Fit.__slots__))


def tap_offsets(window: int, stride: int) -> npt.NDArray[np.int64]:
    """Return the offsets along one axis: the multiples of ``stride`` inside the window, 0 among them."""
    reach = window // 2 // stride * stride
    return np.arange(-reach, reach + 1, stride)


def chunks(pixels: Pixels, samples: int, dimensions: int) -> Iterator[slice]:
    """Cut a pixel list into pieces whose windows fit into a modest amount of memory."""
    step = max(1, _CHUNK_VALUES // (samples * dimensions))
    for start in range(0, len(pixels), step):
        yield slice(start, min(start + step, len(pixels)))


def gather(history: Sequence[Observation], pixels: Pixels, window: int, stride: int) -> Windows:
    """Collect the windows round ``pixels`` from the last T frames (``history[-1]`` is the current one)."""
    offsets = tap_offsets(window, stride)
    reach = int(offsets[-1])
    width = history[-1].valid.shape[1]
    pitch = width + 2 * reach
    taps = (offsets[:, None] * pitch + offsets[None, :]).ravel()
    centres = (pixels // width + reach) * pitch + pixels % width + reach
    index = centres[:, None] + taps[None, :]
    border = ((reach, reach), (reach, reach))
    x = np.concatenate(
        [np.pad(o.features, (*border, (0, 0))).reshape(-1, o.features.shape[2])[index] for o in history], axis=1
    )
    y = np.concatenate([np.pad(o.brightness, border).ravel()[index] for o in history], axis=1)
    mask = np.concatenate([np.pad(o.valid, border).ravel()[index] for o in history], axis=1)
    hit = np.concatenate([np.pad(o.hit, border).ravel()[index] for o in history], axis=1)
    now = history[-1]
    centre = now.features.reshape(-1, x.shape[2])[pixels]
    windows = make_windows(x, y, mask, centre, hit, now.hit.ravel()[pixels], now.depth)
    if now.brightness_variance is not None:
        windows.y_variance = np.concatenate(
            [
                np.pad(o.brightness_variance, border).ravel()[index]
                for o in history
                if o.brightness_variance is not None
            ],
            axis=1,
        )
    if now.feature_variance is not None:
        windows.x_variance = np.concatenate(
            [
                np.pad(o.feature_variance, (*border, (0, 0))).reshape(-1, x.shape[2])[index]
                for o in history
                if o.feature_variance is not None
            ],
            axis=1,
        )
    return windows


def make_windows(
    x: F64, y: F64, mask: Mask, centre: F64, hit: Mask | None = None, centre_hit: Mask | None = None,
    depth: int | None = None,
) -> Windows:  # fmt: skip
    """Find the extremes and give misses their window's largest depth. Shapes as in `Windows`; x may be changed."""
    lo = np.where(mask[..., None], x, np.inf).min(axis=1)
    hi = np.where(mask[..., None], x, -np.inf).max(axis=1)
    if depth is not None and hit is not None and centre_hit is not None and not hit[mask].all():
        lo[:, depth] = np.where(hit, x[..., depth], np.inf).min(axis=1)
        hi[:, depth] = np.where(hit, x[..., depth], -np.inf).max(axis=1)
        none = ~hit.any(axis=1)
        lo[none, depth] = hi[none, depth] = 0.0
        x[..., depth] = np.where(hit, x[..., depth], hi[:, None, depth])
        centre = centre.copy()
        centre[:, depth] = np.where(centre_hit, centre[:, depth], hi[:, depth])
    return Windows(x, y, mask, centre, lo, hi)


def feature_scale(lo: F64, hi: F64) -> F64:
    """Return 1/(hi − lo), or 0 for a feature that is constant but for rounding."""
    spread = hi - lo
    constant = spread <= CONSTANT_RANGE * np.maximum(np.abs(lo), np.abs(hi))
    return np.where(constant, 0.0, 1.0 / np.where(constant, 1.0, spread))


def kernel_weights(t: F64, kernel: Kernel) -> F64:
    """Return Π_j k(t_j) over the last axis."""
    if kernel == "gaussian":
        result: F64 = np.exp(-0.5 * np.einsum("...j,...j->...", t, t))
        return result
    product: F64 = np.maximum(0.75 * (1.0 - t * t), EPANECHNIKOV_FLOOR).prod(axis=-1)
    return product


def solve_windows(windows: Windows, config: DetectorConfig) -> Fit:
    """Solve the WLR of each window; the centre must be valid.

    The ridge is on β alone: then Σ w r = 0 holds exactly and with it ΔR = (βᵀδ)².
    """
    scale = feature_scale(windows.lo, windows.hi)
    x = (windows.x - windows.centre[:, None, :]) * scale[:, None, :]
    w = windows.mask * kernel_weights(x / config.bandwidth_h, config.kernel)
    total = w.sum(axis=1)
    share = w / total[:, None]
    mean_x = np.einsum("nm,nmj->nj", share, x)
    mean_y = np.einsum("nm,nm->n", share, windows.y)
    dx = x - mean_x[:, None, :]
    dy = windows.y - mean_y[:, None]
    weighted = (dx * share[..., None]).transpose(0, 2, 1)
    C = weighted @ dx
    c = weighted @ dy[..., None]
    diagonal = np.einsum("njj->nj", C)
    diagonal += config.ridge * diagonal + TINY_RIDGE
    b = np.linalg.solve(C, c)[..., 0]
    alpha = mean_y - np.einsum("nj,nj->n", b, mean_x)
    r = dy - np.einsum("nmj,nj->nm", dx, b)
    residual = np.einsum("nm,nm->n", share, r * r)
    noise = np.zeros_like(alpha) if windows.y_variance is None else np.einsum("nm,nm->n", share, windows.y_variance)
    return Fit(alpha, b * scale, residual, noise, windows.centre, windows.lo, windows.hi)


def shrink(fit: Fit, y: F64, factor: float) -> None:
    """Move α towards ``y [n]``, the centres' own values, as far as the residual is more than noise.

    Where the window is nothing but a plane and noise, R comes to the samples' variance (a little less: the plane has
    taken part of it) and α stays. Where R is much larger, the plane misses detail, and y has it: James and Stein,
    "Estimation with quadratic loss", 1961, for the pair of α and y, with R for their expected distance.
    """
    noise = factor * fit.noise
    # A pixel of one sample has no variance: noise is NaN in every window with such a pixel, and the fit stays.
    detail = fit.residual > noise
    weight = np.where(detail, 1.0 - noise / np.where(detail, fit.residual, 1.0), 0.0)
    fit.alpha += weight * (y - fit.alpha)


def fit_pixels(
    history: Sequence[Observation],
    pixels: Pixels,
    config: DetectorConfig,
    solve: Callable[[Windows, DetectorConfig], Fit] = solve_windows,
) -> Fit:
    """Fit the windows round ``pixels``, whose centres must be valid in the current frame."""
    dimensions = history[-1].features.shape[2]
    fit = empty_fit(len(pixels), dimensions)
    samples = len(history) * len(tap_offsets(config.side, config.stride)) ** 2
    for part in chunks(pixels, samples, dimensions):
        put_fit(fit, part, solve(gather(history, pixels[part], config.side, config.stride), config))
    if config.shrink > 0:
        shrink(fit, history[-1].brightness.ravel()[pixels], config.shrink)
    return fit


def empty_fit(count: int, dimensions: int) -> Fit:
    """Return room for the planes of ``count`` pixels, all 0."""
    shape = (count, dimensions)
    alpha, residual, noise = np.zeros((3, count))
    return Fit(alpha, np.zeros(shape), residual, noise, np.zeros(shape), np.zeros(shape), np.zeros(shape))


def put_fit(out_fit: Fit, where: slice | Pixels, fit: Fit) -> None:
    """Write ``fit`` into the places ``where`` of ``out_fit``."""
    for name in Fit.__slots__:
        getattr(out_fit, name)[where] = getattr(fit, name)
