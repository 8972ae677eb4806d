# ruff: noqa: UP018
"""The MIS weight of light that scattering finds (Veach 1997), as a Warp function."""

from typing import Any

import warp as wp

from clsim.render.features.features import Features
from clsim.render.sampling import sampling


def make_weight(features: Features) -> Any:
    """Return the Warp function ``weight(alone, analytic, scattered, drawn)``."""
    by_light = features.strategy != "scatter"
    by_scatter = features.strategy != "light"

    @wp.func
    def weight(alone: bool, analytic: bool, scattered: float, drawn: float) -> float:
        """MIS weight of light that scattering found, given both densities; 0 where direct light is ``analytic``."""
        w = float(1.0)
        if not alone:
            if wp.static(not by_scatter):
                w = 0.0
            elif wp.static(by_light):
                w = sampling.power_heuristic(scattered, drawn)
        if analytic and drawn > 0.0:
            w = 0.0
        return w

    return weight
