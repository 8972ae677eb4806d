"""Events as arrays of fixed size, as networks take them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events.batch import EventBatch

F32 = npt.NDArray[np.float32]


def histogram(events: EventBatch, width: int, height: int) -> F32:
    """Return how many OFF and ON events each pixel has, float32 ``[2, H, W]``."""
    pixels = events["on"].astype(np.int64) * (height * width) + _pixels(events, width)
    return np.bincount(pixels, minlength=2 * height * width).reshape(2, height, width).astype(np.float32)


def voxel_grid(events: EventBatch, width: int, height: int, bins: int, start_us: int, end_us: int) -> F32:
    """Return polarities spread over points in time, float32 ``[bins, H, W]``.

    The points lie evenly from ``start_us`` to ``end_us``, both included. An event gives the two points around it shares
    of +1 or −1 that fall off linearly with the distance. One point takes all. Source: Zhu et al., "Unsupervised
    Event-based Learning of Optical Flow, Depth, and Egomotion", CVPR 2019.

    Raises:
        InputError: there is no bin, or the end is not after the start.
    """
    if bins < 1 or end_us <= start_us:
        raise InputError(
            f"expected at least 1 bin and an end after the start, got {bins} from {start_us} to {end_us} µs"
        )
    place = (events["t"] - start_us) * ((bins - 1) / (end_us - start_us))
    first = np.clip(place.astype(np.int64), 0, max(bins - 2, 0))
    share = np.clip(place - first, 0.0, 1.0)
    sign = np.where(events["on"], 1.0, -1.0)
    pixels = _pixels(events, width)
    size = height * width
    grid = np.bincount(first * size + pixels, sign * (1.0 - share), bins * size)
    if bins > 1:
        grid += np.bincount((first + 1) * size + pixels, sign * share, bins * size)
    return grid.reshape(bins, height, width).astype(np.float32)


def _pixels(events: EventBatch, width: int) -> npt.NDArray[np.int64]:
    pixels: npt.NDArray[np.int64] = events["y"].astype(np.int64) * width + events["x"]
    return pixels
