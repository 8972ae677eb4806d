"""Transfer functions: from what a picture stores to linear light.

What is wanted is the light that fell on the sensor, so of standards for cameras the inverse of the camera's curve
(OETF) is taken, not what a display makes of it. Only ratios of light make events; units matter for the floor alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from clsim.footage import Transfer
from clsim.frames.frame import FloatArray

REFERENCE_WHITE = 203.0
"""Luminance [cd/m²] of diffuse white in PQ video (ITU-R BT.2408): decoded, it is 1."""

_PQ_M1, _PQ_M2 = 2610 / 16384, 2523 / 4096 * 128
_PQ_C1, _PQ_C2, _PQ_C3 = 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32
_HLG_A = 0.17883277
_HLG_B = 1 - 4 * _HLG_A
_HLG_C = 0.5 - _HLG_A * math.log(4 * _HLG_A)


def decode(encoded: FloatArray, transfer: Transfer) -> None:
    """Turn stored values into linear light, in place; 0 is black, 1 nominal white, what is below black becomes 0.

    ``srgb``: IEC 61966-2-1. ``bt709``: inverse OETF of ITU-R BT.709, also that of BT.601 and BT.2020. ``pq``: EOTF of
    SMPTE ST 2084 in units of `REFERENCE_WHITE`. ``hlg``: inverse OETF of ITU-R BT.2100, scene light up to 1.
    ``linear`` and ``as-is`` keep the values: the first says that they are light, the second that it shall not matter.
    """
    np.maximum(encoded, 0, out=encoded)
    curve = _CURVES.get(transfer)
    if curve is not None:
        encoded[...] = curve(encoded)


def _srgb(v: FloatArray) -> FloatArray:
    curve: FloatArray = ((v + np.float32(0.055)) / np.float32(1.055)) ** np.float32(2.4)
    return np.where(v <= 0.04045, v / np.float32(12.92), curve)


def _bt709(v: FloatArray) -> FloatArray:
    curve: FloatArray = ((v + np.float32(0.099)) / np.float32(1.099)) ** np.float32(1 / 0.45)
    return np.where(v < 0.081, v / np.float32(4.5), curve)


def _pq(v: FloatArray) -> FloatArray:
    # Steep powers: float32 would lose three digits.
    root = np.minimum(v, 1).astype(np.float64) ** (1 / _PQ_M2)
    light = (np.maximum(root - _PQ_C1, 0) / (_PQ_C2 - _PQ_C3 * root)) ** (1 / _PQ_M1)
    return (light * (10000 / REFERENCE_WHITE)).astype(np.float32)


def _hlg(v: FloatArray) -> FloatArray:
    return np.where(v <= 0.5, v * v / 3, (np.exp((v - np.float32(_HLG_C)) / np.float32(_HLG_A)) + _HLG_B) / 12)


_CURVES: dict[str, Callable[[FloatArray], FloatArray]] = {"srgb": _srgb, "bt709": _bt709, "pq": _pq, "hlg": _hlg}


def quantisation_floor(transfer: Transfer, steps: int, contrast: float) -> float:
    """Return the light from which on a single step of stored values changes its log by ``contrast`` at most.

    There are ``steps`` of them from black to white. Below it, noise of one step would make several events. Where every
    step is coarser (few bits, small contrast), it is white's.
    """
    light = np.arange(steps + 1, dtype=np.float32) / np.float32(steps)
    decode(light, transfer)
    with np.errstate(divide="ignore"):
        rise = np.diff(np.log(light.astype(np.float64)))
    coarse = np.flatnonzero(~(rise <= contrast))
    return float(light[coarse[-1] + 1]) if coarse.size else float(light[1])
