"""Light selection probabilities: by the power that each light sends into the scene, within fair bounds.

Power says little of what a point sees: a sun has most of it wherever the scene is wide, and a lamp may light all of a
room. So what is far gets no more than all that is near, and what scattering finds never, or hardly ever, a least share.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

_F64 = npt.NDArray[np.float64]

LEAST_SHARE = 1 / 8
"""Of all draws, so many go evenly to lights without size and to spheres, where their power earns them less."""
_FAR = 4.0
"""A sphere light so many times the scene's radius away is far: only part of its power arrives."""


def arriving(distance_m: float, radius_m: float) -> float:
    """Return the share of a small light's power that arrives in a scene of that radius at that distance; 1 if near."""
    if distance_m <= _FAR * radius_m:
        return 1.0
    # The disc that the scene covers, of the sphere around the light.
    return radius_m**2 / (4.0 * distance_m**2)


def fair(power: _F64, far: npt.NDArray[np.bool_], small: int) -> _F64:
    """Return powers to draw by.

    Args:
        power: what each light sends into the scene [W].
        far: whether it comes from so far that it is spread over the whole scene: together they get at most half.
        small: how many lights, the last ones, scattering finds seldom or never.
    """
    fair_power: _F64 = power.copy()
    near_sum, far_sum = power[~far].sum(), power[far].sum()
    if 0 < near_sum < far_sum:
        fair_power[far] *= near_sum / far_sum
    if small:
        own = fair_power[-small:]
        least = LEAST_SHARE / small * fair_power.sum()
        fair_power[-small:] = np.where(own > 0, np.maximum(own, least), 0.0)
    return fair_power
