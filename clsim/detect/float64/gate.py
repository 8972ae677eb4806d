"""In float64, third stage: which pixels need a new regression.

A pixel keeps the plane of the frame of its last event. The gates predict from it how far brightness has moved, and
ask for a new fit only where that reaches the contrast threshold. All need O(1) memory per pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from clsim.detect.config import DetectorConfig
from clsim.detect.float64.fit import Fit, Pixels, empty_fit, put_fit
from clsim.detect.float64.observation import F64, Mask, Observation, log_brightness

RANGE_MARGIN = 1e-3
"""How far a feature may leave its old window's range, as a share of its size, before the radiance gate solves."""


@dataclass(slots=True)
class Boxes:
    """Means over the valid pixels of each pixel's box.

    Attributes:
        brightness: ``[N]``, mean of L.
        features: ``[N, D]``, raw units; misses count as depth 0.
        misses: ``[N]``, share of valid pixels that are misses; their depth is filled in per model.
    """

    brightness: F64
    features: F64
    misses: F64


def box_means(observation: Observation, box: int) -> Boxes:
    """Average brightness and features over the valid pixels of box × box pixels, clipped at the image border."""
    o = observation
    features = o.features
    miss = o.valid & ~o.hit
    if o.depth is not None and miss.any():
        features = features.copy()
        features[..., o.depth][miss] = 0.0
    stack = np.concatenate(
        [o.valid[..., None], np.where(o.valid, o.brightness, 0.0)[..., None], features, miss[..., None]], axis=-1
    )
    sums = _box_sum(_box_sum(stack, box, axis=0), box, axis=1).reshape(-1, stack.shape[-1])
    means = sums[:, 1:] / np.maximum(sums[:, :1], 1.0)
    return Boxes(means[:, 0], means[:, 1:-1], means[:, -1])


def _box_sum(values: F64, box: int, axis: int) -> F64:
    reach = box // 2
    size = values.shape[axis]
    padded = np.pad(values, [(reach, reach) if i == axis else (0, 0) for i in range(values.ndim)])
    total: F64 = np.sum([np.take(padded, range(k, k + size), axis=axis) for k in range(box)], axis=0)
    return total


class Model:
    """What each pixel remembers of its last event: the plane, the centre, the window's extremes and the box means."""

    def __init__(self, count: int, dimensions: int, depth: int | None) -> None:
        """Make room for ``count`` pixels with ``dimensions`` features."""
        self.fit: Fit = empty_fit(count, dimensions)
        self.box_brightness: F64 = np.zeros(count)
        self.box_features: F64 = np.zeros((count, dimensions))
        self.depth = depth

    def replace(self, pixels: Pixels, fit: Fit, boxes: Boxes | None) -> None:
        """Take over new planes (and box means, where the gate uses them) at ``pixels``."""
        put_fit(self.fit, pixels, fit)
        if boxes is not None:
            self.box_brightness[pixels] = boxes.brightness[pixels]
            self.box_features[pixels] = self.fill_box_depth(pixels, boxes)

    def fill_box_depth(self, pixels: Pixels, boxes: Boxes) -> F64:
        """Return box means of the features in which misses have the old window's largest depth."""
        features = boxes.features[pixels]
        if self.depth is not None:
            features[:, self.depth] += boxes.misses[pixels] * self.fit.hi[pixels, self.depth]
        return features

    def centre(self, pixels: Pixels, observation: Observation) -> F64:
        """Return the current centre features ``[n, D]`` as the old plane sees them.

        A miss takes the old window's largest depth, as misses did in the regression: a pixel that missed then and
        misses now has δ_depth = 0, and one that hit then is predicted where the plane has its misses.
        """
        features = observation.features.reshape(-1, observation.features.shape[2])[pixels]
        if self.depth is not None:
            hit = observation.hit.ravel()[pixels]
            features[:, self.depth] = np.where(hit, features[:, self.depth], self.fit.hi[pixels, self.depth])
        return features


@dataclass(slots=True)
class Verdict:
    """What a gate says about n pixels.

    Attributes:
        solve: ``[n]``, whether a new regression is due.
        predicted: ``[n]``, the level that the old plane predicts.
        margin: ``[n]``, distance of the nearest test to its threshold (log units; of ranges, relative): pixels where
            it is tiny may legitimately be decided otherwise in another precision.
    """

    solve: Mask
    predicted: F64
    margin: F64


def beyond(change: F64, config: DetectorConfig, share: float = 1.0) -> tuple[Mask, F64]:
    """Return whether ``change`` exceeds ``share`` of the ON or OFF threshold, and its distance to the nearer one."""
    on, off = share * config.threshold_on, share * config.threshold_off
    return (change > on) | (change < -off), np.minimum(np.abs(change - on), np.abs(change + off))


def level_of(value: F64, config: DetectorConfig) -> F64:
    """Return the level of regressed values: themselves, or their log where luminance is regressed."""
    return log_brightness(value, config) if config.linear else value


def delta_r(model: Model, pixels: Pixels, ref: F64, observation: Observation, config: DetectorConfig) -> Verdict:
    """Test ΔR = (βᵀδ)² against C² (Tsuji et al., ICIP 2023, proposition 1, in closed form).

    The change is counted from ``ref``, the level at which the last event fired, so that the test also holds where the
    reference steps by C; where ref = α it is the paper's.
    """
    predicted = level_of(_moved(model, pixels, observation), config)
    solve, margin = beyond(predicted - ref[pixels], config)
    return Verdict(solve, predicted, margin)


def radiance(
    model: Model, pixels: Pixels, ref: F64, observation: Observation, boxes: Boxes, config: DetectorConfig
) -> Verdict:
    """Test ΔR, and also what the features cannot explain: shadows, moving lamps, reflections, new features.

    d = βᵀδ + [(ȳ_new − ȳ_old) − βᵀ(x̄_new − x̄_old)] over the box means.
    """
    by_features = delta_r(model, pixels, ref, observation, config)
    box_moved = model.fill_box_depth(pixels, boxes) - model.box_features[pixels]
    brighter = boxes.brightness[pixels] - model.box_brightness[pixels]
    unexplained = brighter - np.einsum("nj,nj->n", model.fit.slope[pixels], box_moved)
    predicted = level_of(_moved(model, pixels, observation) + unexplained, config)
    by_box, box_margin = beyond(predicted - ref[pixels], config, config.gate_scale)
    out_of_range, range_margin = leaves_range(model, pixels, observation)
    margin = np.minimum(np.minimum(by_features.margin, box_margin), range_margin)
    return Verdict(by_features.solve | by_box | out_of_range, predicted, margin)


def _moved(model: Model, pixels: Pixels, observation: Observation) -> F64:
    """Return α + βᵀδ: the old plane at the current centre features."""
    fit = model.fit
    delta = model.centre(pixels, observation) - fit.centre[pixels]
    result: F64 = fit.alpha[pixels] + np.einsum("nj,nj->n", fit.slope[pixels], delta)
    return result


def leaves_range(model: Model, pixels: Pixels, observation: Observation) -> tuple[Mask, F64]:
    """Return whether a centre feature left its old window's range, and how near the nearest is to doing so."""
    lo, hi = model.fit.lo[pixels], model.fit.hi[pixels]
    x = model.centre(pixels, observation)
    size = np.maximum(np.abs(lo), np.abs(hi))
    slack = RANGE_MARGIN * size
    outside: Mask = (x < lo - slack) | (x > hi + slack)
    distance = np.minimum(np.abs(x - (lo - slack)), np.abs(x - (hi + slack)))
    # A feature that is and was 0 everywhere is not near its threshold: no rounding moves it.
    extent = np.maximum(size, np.abs(x))
    relative = np.where(extent > 0, distance / np.where(extent > 0, extent, 1.0), np.inf)
    return np.any(outside, axis=1), np.min(relative, axis=1)
