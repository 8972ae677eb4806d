"""In float64: regressions that choose their bandwidth, as Moon, Carr, Yoon, ToG 2014, do.

Tsuji et al., ICIP 2023, section 3, found that this gives no better events at about 8 times the cost; these variants
let that be checked. Their steps:

* `tsvd`: features are noisy, so directions of feature space whose singular values do not exceed the noise are left
  out: s ≤ ‖E‖_F with ‖E‖_F² the sum of the features' variances over the window.
* `optimised`: on top of that, each remaining direction gets a bandwidth b_j = 1/√|f''_j|, f'' from a local quadratic
  fit; and the common factor h is the one of `CANDIDATES_H` with the least expected square error, the bias being what
  the curvature leaves in the linear fit, the variance what the smoother passes on of the brightness's own.

Where the original fits parametric curves of bias and variance over h, here the candidates are compared directly.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from clsim.detect.config import Bandwidth, DetectorConfig
from clsim.detect.float64.fit import TINY_RIDGE, Fit, Windows, feature_scale, kernel_weights, solve_windows
from clsim.detect.float64.observation import F64

CANDIDATES_H = (0.2, 0.4, 0.6, 0.8, 1.0)
"""Values of h to choose from, times the configured bandwidth."""
B_RANGE = (0.25, 4.0)
"""Limits of b_j: a direction without curvature would otherwise get an infinite one."""


def subspace(windows: Windows) -> tuple[F64, F64, F64]:
    """Project the scaled features on the directions that rise above their noise.

    Returns:
        ``z [n, m, D]``, the projected differences from the centre (0 in truncated directions); ``basis [n, D, D]``,
        the directions as columns, truncated ones 0; ``scale [n, D]``, of the raw features.
    """
    if windows.x_variance is None:
        raise ValueError("windows without variances")
    scale = feature_scale(windows.lo, windows.hi)
    x = (windows.x - windows.centre[:, None]) * scale[:, None] * windows.mask[..., None]
    noise = np.einsum("nmj,nj->n", windows.x_variance * windows.mask[..., None], scale * scale)
    # Eigenvectors of XᵀX are the right singular vectors of X, its eigenvalues their squared singular values.
    squares, vectors = np.linalg.eigh(x.transpose(0, 2, 1) @ x)
    basis = vectors * (squares > np.maximum(noise, TINY_RIDGE)[:, None])[:, None, :]
    return x @ basis, basis, scale


def solve_tsvd(windows: Windows, config: DetectorConfig) -> Fit:
    """Solve the WLR in the truncated feature space, with the configured bandwidth."""
    z, basis, scale = subspace(windows)
    weights = windows.mask * kernel_weights(z / config.bandwidth_h, config.kernel)
    return _fit(windows, z, weights, basis, scale, config)[0]


def solve_optimised(windows: Windows, config: DetectorConfig) -> Fit:
    """Solve the WLR in the truncated feature space, with b from the curvature and h from bias and variance."""
    if windows.y_variance is None:
        raise ValueError("windows without variances")
    z, basis, scale = subspace(windows)
    second = curvature(z, windows, config)
    b = np.clip(1.0 / np.sqrt(np.maximum(np.abs(second), 1e-300)), *B_RANGE)
    best: Fit | None = None
    least = np.full(len(z), np.inf)
    remainder = 0.5 * np.einsum("nmj,nj->nm", z * z, second)
    for h in CANDIDATES_H:
        width = h * config.bandwidth_h * b
        weights = windows.mask * kernel_weights(z / width[:, None], config.kernel)
        fit, smoother = _fit(windows, z, weights, basis, scale, config)
        bias = np.einsum("nm,nm->n", smoother, remainder)
        variance = np.einsum("nm,nm->n", smoother**2, windows.y_variance)
        error = bias**2 + variance
        if best is None:
            best = fit
        else:
            better = error < least
            for name in Fit.__slots__:
                getattr(best, name)[better] = getattr(fit, name)[better]
        least = np.minimum(least, error)
    if best is None:
        raise ValueError("no candidate for h")
    return best


def curvature(z: F64, windows: Windows, config: DetectorConfig) -> F64:
    """Return ∂²L/∂z_j² ``[n, D]`` at the centres, from a fit with squares of each direction."""
    design = np.concatenate([z, 0.5 * z * z], axis=2)
    weights = windows.mask * kernel_weights(z / config.bandwidth_h, config.kernel)
    slope, _, _ = _regress(design, windows.y, weights, config.ridge)
    return slope[:, z.shape[2] :]


def _fit(windows: Windows, z: F64, weights: F64, basis: F64, scale: F64, config: DetectorConfig) -> tuple[Fit, F64]:
    """Fit a plane over z; return it in raw units, and the smoother l ``[n, m]`` with α = Σ l_i y_i."""
    slope, alpha, smoother = _regress(z, windows.y, weights, config.ridge)
    r = windows.y - alpha[:, None] - np.einsum("nmj,nj->nm", z, slope)
    residual = np.einsum("nm,nm->n", weights, r * r) / weights.sum(axis=1)
    raw = np.einsum("njk,nk->nj", basis, slope) * scale
    return Fit(alpha, raw, residual, np.zeros_like(alpha), windows.centre, windows.lo, windows.hi), smoother


def _regress(design: F64, y: F64, weights: F64, ridge: float) -> tuple[F64, F64, F64]:
    """Return slope, intercept at 0 and the intercept's smoother, of y over ``design [n, m, D]``."""
    share = weights / weights.sum(axis=1)[:, None]
    mean = np.einsum("nm,nmj->nj", share, design)
    d = design - mean[:, None]
    moments = (d * share[..., None]).transpose(0, 2, 1) @ d
    diagonal = np.einsum("njj->nj", moments)
    diagonal += ridge * diagonal + TINY_RIDGE
    mean_y = np.einsum("nm,nm->n", share, y)
    right = np.einsum("nm,nmj->nj", share * (y - mean_y[:, None]), d)
    solved = np.linalg.solve(moments, np.stack([right, mean], axis=2))
    slope = solved[..., 0]
    smoother = share * (1.0 - np.einsum("nmj,nj->nm", d, solved[..., 1]))
    return slope, np.asarray(mean_y - np.einsum("nj,nj->n", slope, mean)), smoother


SOLVERS: Mapping[Bandwidth, Callable[[Windows, DetectorConfig], Fit]] = {
    "fixed": solve_windows,
    "tsvd": solve_tsvd,
    "optimised": solve_optimised,
}
