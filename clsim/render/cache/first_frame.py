"""The first frame in cached light: how bright light is, how many paths tell it, and so how often it is rendered."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

_FEW = 2
"""Paths of a pixel that tell how much they differ, at least."""
_NOISIEST = 12.5
"""Relative variance of a path, at most: light that a few paths in thousands find would take a start for ever."""
_UNIT = 4.0
"""Of the mean light, in a cell: so squares of light from a thousandth to a thousand times the mean are well told."""


def paths_wanted(lights: npt.NDArray[np.float32], positions: npt.NDArray[np.float32], error: float) -> float:
    """Return how many paths of a pixel tell its light to that ``error``, 0 where nobody knows.

    Args:
        lights: what the paths of the first pass found ``[paths, pixels, 3]``.
        positions: where they began ``[paths, pixels, 4]``; the last number is 0 where they hit nothing.
        error: relative standard error of their mean that is small enough.
    """
    if len(lights) < _FEW:
        return 0.0
    return min(_relative_variance(lights, positions[..., 3] > 0), _NOISIEST) / error**2


def unit_of(lights: npt.NDArray[np.float32], positions: npt.NDArray[np.float32]) -> float | None:
    """Return the unit in which cells hold light: a power of two, so that scenes in any unit have the same bits.

    It is None where paths find nothing. Arguments are those of `paths_wanted`.
    """
    found = lights[positions[..., 3] > 0]
    mean = float(found.mean(dtype=np.float64)) if len(found) else 0.0
    return None if mean <= 0.0 else _UNIT * 2.0 ** math.floor(math.log2(mean))


def _relative_variance(lights: npt.NDArray[np.float32], begin: npt.NDArray[np.bool_]) -> float:
    """Return how noisy light is: the mean over pixels of the variance of what their paths found, over its mean squared.

    Args:
        lights: what they found ``[paths, pixels, 3]``.
        begin: whether they hit anything ``[paths, pixels]``.
    """
    lit = begin.all(axis=0) & lights.any(axis=(0, 2))
    found = lights[:, lit].mean(axis=2)
    return float((found / found.mean(axis=0)).var(axis=0, ddof=1).mean()) if lit.any() else 0.0
