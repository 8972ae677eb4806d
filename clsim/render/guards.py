# Warp: a variable that changes must be born by a call.
# ruff: noqa: UP018
"""Room around what moves: a ray that stays out of it meets what it met before.

Each thing that moves has a box that is larger than itself and reaches to where it goes (`guard_keeper.py`).
"""

import warp as wp

from clsim.render.geometry import Geometry

_LEAST = wp.constant(1.0e-12)
"""Stands for a part of a direction that is smaller."""


@wp.func
def meets_guard(geometry: Geometry, origin: wp.vec3, direction: wp.vec3, far: float) -> bool:
    """Whether a ray leads through room that something moving may take, before it comes so far."""
    met = bool(False)
    for k in range(geometry.guard_count):
        lower = geometry.guards[2 * k] - origin
        upper = geometry.guards[2 * k + 1] - origin
        enters = float(0.0)
        leaves = float(far)
        for c in range(3):
            d = wp.where(wp.abs(direction[c]) < _LEAST, _LEAST, direction[c])
            enters = wp.max(enters, wp.min(lower[c] / d, upper[c] / d))
            leaves = wp.min(leaves, wp.max(lower[c] / d, upper[c] / d))
        met = met or enters <= leaves
    return met
