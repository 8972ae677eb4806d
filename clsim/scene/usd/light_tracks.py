"""Light of a USD file that changes with time: samples of what lamps and materials emit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from clsim.scene.modulation import Keyframed, Modulation
from clsim.scene.usd.stage import Stage
from clsim.scene.world import Vec3

_LINES = 8
"""Lines from sample to sample where several attributes multiply: their product is no line."""
Source = tuple[Any, Callable[[Any], Any]]
"""An attribute, and from its value, None where it has none, to a number or a colour."""


def brightest(stage: Stage, sources: Sequence[Source], *, repeat: bool) -> tuple[Vec3, Modulation | None]:
    """Return the product of attributes when it is brightest, and how it changes; None where it does not.

    Args:
        stage: the file.
        sources: what is multiplied.
        repeat: whether it starts anew at the end of the file's time.
    """

    def product(code: float) -> Vec3:
        value = np.ones(3)
        for attribute, read in sources:
            value = value * np.asarray(read(stage.value(attribute, code)), np.float64)
        r, g, b = np.nan_to_num(np.maximum(value, 0.0), posinf=3e38).tolist()
        return r, g, b

    changing = [stage.times(attribute) for attribute, _ in sources]
    codes = sorted({code for codes in changing for code in codes})
    if not codes:
        return product(stage.start), None
    if sum(map(bool, changing)) > 1:
        parts = np.linspace(0.0, 1.0, _LINES, endpoint=False)
        codes = [*(np.array(codes[:-1])[:, None] + np.diff(codes)[:, None] * parts).ravel().tolist(), codes[-1]]
    values = np.array([product(code) for code in codes])
    peak = values.max(axis=0)
    if (values == values[0]).all():
        return product(stage.start), None
    factors = values / np.where(peak > 0, peak, 1.0)
    times_s = tuple(stage.seconds(code) for code in codes)
    change = Keyframed(times_s, tuple((r, g, b) for r, g, b in factors.tolist()), False, repeat)
    return (float(peak[0]), float(peak[1]), float(peak[2])), change
