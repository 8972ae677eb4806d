# Warp: a variable that changes must be born by a call.
"""The exposure: what moves has a table of poses at equal steps through it, and a path blends two of them.

Between keys, matrices are blended linearly: at ``SHUTTER_KEYS`` = 9, something that turns by 90° within the exposure
shrinks by .5 % between keys. What deforms has a shape at each key instead, and a path sees the nearest one: an eighth
of the way that a vertex goes within the exposure should be less than a pixel, or edges show in steps.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import warp as wp

SHUTTER_KEYS = 9
"""Poses through the exposure, both ends included."""
_SEGMENTS = wp.constant(SHUTTER_KEYS - 1)


@wp.func
def shutter_key(time: float) -> int:
    """Return the key before a time, which goes from 0 to 1 through the exposure."""
    return wp.min(int(time * float(_SEGMENTS)), _SEGMENTS - 1)


@wp.func
def nearest_key(time: float) -> int:
    """Return the key nearest to a time."""
    return wp.clamp(int(time * float(_SEGMENTS) + 0.5), 0, _SEGMENTS)


@wp.func
def shutter_weight(time: float) -> float:
    """Return the weight of the key after a time."""
    return time * float(_SEGMENTS) - float(shutter_key(time))


def key_times(time_s: float, shutter_s: float) -> npt.NDArray[np.float64]:
    """Return the times of the keys of an exposure about ``time_s`` [s]; that time alone without one."""
    if shutter_s == 0:
        return np.array([time_s])
    return time_s + shutter_s * np.linspace(-0.5, 0.5, SHUTTER_KEYS)
