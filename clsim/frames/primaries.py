"""Colours of files whose primaries are not Rec. 709's."""

from __future__ import annotations

from typing import Any

import numpy as np

from clsim.frames.frame import FloatArray

_REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
"""x and y of red, green, blue and white."""
_ALIKE = 2e-3
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
"""Lam, "Metamerism and colour constancy", 1985: XYZ as what cones see, in which whites are made alike."""


def luminance_weights(told: Any) -> tuple[float, float, float]:
    """Return the weights of R, G and B in luminance by primaries as OpenEXR tells them, or else Rec. 709's."""
    primaries = _usable(told)
    if primaries is None:
        return 0.2126, 0.7152, 0.0722
    red, green, blue = _xyz(primaries)[1].tolist()
    return red, green, blue


def to_rec709(told: Any) -> FloatArray | None:
    """Return the matrix from colours of those primaries to Rec. 709, white to white; None where they are alike."""
    primaries = _usable(told)
    if primaries is None or np.abs(primaries - _REC709).max() <= _ALIKE:
        return None
    source, target = _xyz(primaries), _xyz(np.array(_REC709))
    seen, wanted = (_BRADFORD @ each.sum(axis=1) for each in (source, target))
    adapted = np.linalg.inv(_BRADFORD) @ np.diag(wanted / seen) @ _BRADFORD
    return np.asarray(np.linalg.inv(target) @ adapted @ source, np.float32)


def _usable(told: Any) -> Any:
    """Return the eight numbers that are told; None where they are not as many, or make no colours."""
    found = np.ravel(told).astype(np.float64)
    if len(found) != 8 or not np.isfinite(found).all() or np.abs(found[1::2]).min() < 1e-6:
        return None
    return found if abs(np.linalg.det(_directions(found)[:, :3])) > 1e-6 else None


def _directions(primaries: Any) -> Any:
    """Return XYZ of each primary and of white at a luminance of 1 ``[3, 4]``."""
    x, y = primaries.reshape(4, 2).T
    return np.stack([x / y, np.ones(4), (1 - x - y) / y])


def _xyz(primaries: Any) -> Any:
    """Return XYZ of R, G and B ``[3, 3]``, which have luminances with which they make white."""
    each = _directions(primaries)
    return each[:, :3] * np.linalg.solve(each[:, :3], each[:, 3])
