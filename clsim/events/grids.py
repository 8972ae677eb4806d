"""Events as arrays of fixed size, as networks take them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events.batch import EventBatch

F32 = npt.NDArray[np.float32]


def histogram(events: EventBatch, width: int, height: int) -> F32:
    """Return how many OFF and ON events each pixel has, float32 ``[2, H, W]``.

    Raises:
        InputError: an event lies outside.
    """
    pixels = events["on"].astype(np.int64) * (height * width) + _pixels(events, width, height)
    return np.bincount(pixels, minlength=2 * height * width).reshape(2, height, width).astype(np.float32)


def voxel_grid(events: EventBatch, width: int, height: int, bins: int, start_us: int, end_us: int) -> F32:
    """Return polarities spread over points in time, float32 ``[bins, H, W]``.

    The points lie evenly from ``start_us`` to ``end_us``, both included. An event gives the two points around it shares
    of +1 or −1 that fall off linearly with the distance. One point takes all. Source: Zhu et al., "Unsupervised
    Event-based Learning of Optical Flow, Depth, and Egomotion", CVPR 2019.

    Raises:
        InputError: there is no bin, the end is not after the start, or an event lies outside.
    """
    if bins < 1 or not end_us > start_us:
        raise InputError(
            f"expected at least 1 bin and an end after the start, got {bins} from {start_us} to {end_us} µs"
        )
    place = (events["t"] - start_us) * ((bins - 1) / (end_us - start_us))
    first = np.clip(place.astype(np.int64), 0, max(bins - 2, 0))
    share = np.clip(place - first, 0.0, 1.0)
    sign = np.where(events["on"], 1.0, -1.0)
    pixels = _pixels(events, width, height)
    size = height * width
    grid = np.bincount(first * size + pixels, sign * (1.0 - share), bins * size)
    if bins > 1:
        grid += np.bincount((first + 1) * size + pixels, sign * share, bins * size)
    return grid.reshape(bins, height, width).astype(np.float32)


def _pixels(events: EventBatch, width: int, height: int) -> npt.NDArray[np.int64]:
    outside = (events["x"] >= width) | (events["y"] >= height)
    if outside.any():  # else it would count for a pixel of another row
        first = events[outside.argmax()]
        raise InputError(f"an event at x={first['x']}, y={first['y']} lies outside {width} × {height} pixels")
    pixels: npt.NDArray[np.int64] = events["y"].astype(np.int64) * width + events["x"]
    return pixels
