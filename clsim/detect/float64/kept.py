"""In float64, third stage continued: gates that need the old windows themselves.

`delta-r-exact` takes the residual of proposition 1 (Tsuji et al., ICIP 2023, equation 6) by brute force, to check the
closed form. `published` does what the authors' program does, which is not what the paper says: it weighs the old
window again round the new centre, after normalising that centre by the *new* frame's window. Both keep K²·T samples per
pixel, so they are for recorded sequences.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from clsim.detect.config import DetectorConfig
from clsim.detect.float64.fit import (
    Pixels,
    Windows,
    chunks,
    feature_scale,
    gather,
    kernel_weights,
    tap_offsets,
)
from clsim.detect.float64.gate import Model, Verdict
from clsim.detect.float64.observation import F64, Mask, Observation


class KeptWindows:
    """The samples that each pixel's plane was fitted to."""

    def __init__(self, count: int) -> None:
        """Make room for ``count`` pixels; the windows' size shows with the first of them."""
        self._count = count
        self.x: F64 = np.zeros((count, 0, 0))
        self.y: F64 = np.zeros((count, 0))
        self.mask: Mask = np.zeros((count, 0), dtype=bool)

    def replace(self, history: Sequence[Observation], pixels: Pixels, config: DetectorConfig) -> None:
        """Take over the windows round ``pixels`` of the last T frames (fewer than T at the start)."""
        taps = len(tap_offsets(config.side, config.stride)) ** 2
        dimensions = history[-1].features.shape[2]
        if self.x.shape[2] != dimensions:
            samples = taps * config.history
            self.x = np.zeros((self._count, samples, dimensions))
            self.y = np.zeros((self._count, samples))
            self.mask = np.zeros((self._count, samples), dtype=bool)
        for part in chunks(pixels, taps * len(history), dimensions):
            windows = gather(history, pixels[part], config.side, config.stride)
            filled = windows.y.shape[1]
            self.x[pixels[part], :filled] = windows.x
            self.y[pixels[part], :filled] = windows.y
            self.mask[pixels[part], :filled] = windows.mask
            self.mask[pixels[part], filled:] = False


def delta_r_exact(
    model: Model, kept: KeptWindows, pixels: Pixels, ref: F64, observation: Observation, config: DetectorConfig
) -> Verdict:
    """Test ΔR = |R̂ − R| against C², R̂ over the old window with the plane moved to the new centre.

    The plane is also moved by α − ref, which is 0 under the rule `frame`.
    """
    fit = model.fit
    scale = feature_scale(fit.lo[pixels], fit.hi[pixels])
    slope = fit.slope[pixels]
    moved_to = model.centre(pixels, observation)
    moved_residual = np.empty(len(pixels))
    for part in chunks(pixels, kept.x.shape[1], kept.x.shape[2]):
        places = pixels[part]
        from_centre = (kept.x[places] - fit.centre[places][:, None]) * scale[part][:, None]
        weights = kept.mask[places] * kernel_weights(from_centre / config.bandwidth_h, config.kernel)
        r = (
            kept.y[places]
            - ref[places][:, None]
            - np.einsum("nmj,nj->nm", kept.x[places] - moved_to[part][:, None], slope[part])
        )
        moved_residual[part] = np.einsum("nm,nm->n", weights, r * r) / weights.sum(axis=1)
    predicted = fit.alpha[pixels] + np.einsum("nj,nj->n", slope, moved_to - fit.centre[pixels])
    return _verdict(np.abs(moved_residual - fit.residual[pixels]), predicted, ref[pixels], config)


def published(
    model: Model, kept: KeptWindows, pixels: Pixels, ref: F64, history: Sequence[Observation], config: DetectorConfig
) -> Verdict:
    """Test ΔR as the authors' program computes it; each side is normalised to 0…1 by its own window.

    A new centre is thus the same as an old one where it lies at the same place between its window's extremes, so
    changes that move the whole window go unseen.
    """
    fit = model.fit
    delta = np.empty(len(pixels))
    predicted = np.empty(len(pixels))
    for part in chunks(pixels, kept.x.shape[1], kept.x.shape[2]):
        places = pixels[part]
        lo = fit.lo[places]
        scale = feature_scale(lo, fit.hi[places])
        slope = np.where(scale > 0, fit.slope[places] / np.where(scale > 0, scale, 1.0), 0.0)
        new = _normalised_centre(gather(history, places, config.side, config.stride))
        old = (fit.centre[places] - lo) * scale
        from_new = (kept.x[places] - lo[:, None]) * scale[:, None] - new[:, None]
        weights = kept.mask[places] * kernel_weights(from_new / config.bandwidth_h, config.kernel)
        r = kept.y[places] - ref[places][:, None] - np.einsum("nmj,nj->nm", from_new, slope)
        residual = np.einsum("nm,nm->n", weights, r * r) / weights.sum(axis=1)
        delta[part] = np.abs(residual - fit.residual[places])
        predicted[part] = fit.alpha[places] + np.einsum("nj,nj->n", slope, new - old)
    return _verdict(delta, predicted, ref[pixels], config)


def _normalised_centre(windows: Windows) -> F64:
    return (windows.centre - windows.lo) * feature_scale(windows.lo, windows.hi)


def _verdict(delta_r: F64, predicted: F64, ref: F64, config: DetectorConfig) -> Verdict:
    """Compare ΔR with C² of the side to which brightness is predicted to move."""
    threshold = np.where(predicted >= ref, config.threshold_on, config.threshold_off)
    return Verdict(delta_r > threshold**2, predicted, np.abs(np.sqrt(delta_r) - threshold))
