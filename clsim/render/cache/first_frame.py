"""The first frame in cached light: how often it is rendered, until its light is known."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

PASSES_OF_FIRST = 2
"""Times that the first frame is rendered, at least: nothing was known when it was rendered first."""
_FEW = 2
"""Paths of a pixel that tell how much they differ, at least."""
_NOISIEST = 12.5
"""Relative variance of a path, at most: light that a few paths in thousands find would take a start for ever."""


def passes_of_first(lights: npt.NDArray[np.float32], positions: npt.NDArray[np.float32], error: float) -> int:
    """Return how many times the first frame is rendered, so that memory for the paths of one pass is enough.

    Args:
        lights: what the paths of the first pass found ``[paths, pixels, 3]``.
        positions: where they began ``[paths, pixels, 4]``; the last number is 0 where they hit nothing.
        error: relative standard error of the light by a pixel's own paths, which is enough.
    """
    if len(lights) < _FEW:
        return PASSES_OF_FIRST
    wanted = min(_relative_variance(lights, positions[..., 3] > 0), _NOISIEST) / error**2
    return max(math.ceil(wanted / len(lights)), PASSES_OF_FIRST)


def _relative_variance(lights: npt.NDArray[np.float32], begin: npt.NDArray[np.bool_]) -> float:
    """Return how noisy light is: the mean over pixels of the variance of what their paths found, over its mean squared.

    Args:
        lights: what they found ``[paths, pixels, 3]``.
        begin: whether they hit anything ``[paths, pixels]``.
    """
    lit = begin.all(axis=0) & lights.any(axis=(0, 2))
    found = lights[:, lit].mean(axis=2)
    return float((found / found.mean(axis=0)).var(axis=0, ddof=1).mean()) if lit.any() else 0.0
