# ruff: noqa: UP018, SIM102, SIM110
"""The trail of a stored path: its vertices, and the points on lights that these sampled, as Warp functions.

While nothing moves in or out of the way between two of these, the path finds what it found.
"""

from typing import Literal

import warp as wp

from clsim.render.accel.geometry import Geometry, Hit, mat34, transform_point

PLACES = wp.constant(8)
"""Places of a path that are noted; what comes later carries little light."""
MOST_M = wp.constant(1.0e5)
"""Stands for the distance of the sky."""
_LEAST = wp.constant(1.0e-12)
"""Stands for a part of a direction that is smaller."""


@wp.func
def note_place(geometry: Geometry, row: int, depth: int, origin: wp.vec3, direction: wp.vec3, hit: Hit) -> None:
    """Note where a path went from its last place; nothing is known of a light there."""
    if depth < PLACES:
        met = hit.triangle >= 0 or hit.sphere >= 0
        place = origin + direction * wp.where(met, hit.t, MOST_M)
        geometry.trails[row, 2 * depth] = place
        geometry.trails[row, 2 * depth + 1] = place


@wp.func
def note_light(geometry: Geometry, row: int, depth: int, towards: wp.vec3) -> None:
    """Note the light that a place asked, 0 for none."""
    if depth < PLACES and wp.dot(towards, towards) > 0.0:
        geometry.trails[row, 2 * depth + 1] = towards


@wp.func
def _crosses(from_m: wp.vec3, to_m: wp.vec3) -> bool:
    """Whether the way between two places leads through the cube from −1 to 1."""
    enters = float(0.0)
    leaves = float(1.0)
    for c in range(3):
        a = from_m[c]
        b = to_m[c]
        # Most ways lie beyond one of its sides.
        if wp.min(a, b) > 1.0 or wp.max(a, b) < -1.0:
            return False
    for c in range(3):
        d = to_m[c] - from_m[c]
        if wp.abs(d) < _LEAST:
            d = _LEAST
        a = (-1.0 - from_m[c]) / d
        b = (1.0 - from_m[c]) / d
        enters = wp.max(enters, wp.min(a, b))
        leaves = wp.min(leaves, wp.max(a, b))
    return enters <= leaves


@wp.func
def _passes_by(from_m: wp.vec3, to_m: wp.vec3, lower: wp.vec3, upper: wp.vec3) -> bool:
    """Whether the way between two places lies beyond one side of a box along the axes: most do."""
    for c in range(3):
        if wp.min(from_m[c], to_m[c]) > upper[c] or wp.max(from_m[c], to_m[c]) < lower[c]:
            return True
    return False


@wp.func
def _crosses_any(
    boxes: wp.array[mat34], corners: wp.array[wp.vec3], count: int, from_m: wp.vec3, to_m: wp.vec3
) -> bool:
    if _passes_by(from_m, to_m, corners[0], corners[1]):
        return False
    for k in range(count):
        if not _passes_by(from_m, to_m, corners[2 * k + 2], corners[2 * k + 3]):
            if _crosses(transform_point(boxes[k], from_m), transform_point(boxes[k], to_m)):
                return True
    return False


@wp.func
def trail_crosses(
    trails: wp.array[wp.vec3, Literal[2]],
    row: int,
    places: int,
    boxes: wp.array[mat34],
    corners: wp.array[wp.vec3],
    count: int,
) -> bool:
    """Whether a path with so many places leads through one of ``count`` boxes.

    Each is told by the matrix that makes it the cube from −1 to 1. ``corners`` are the lower and upper ones of the box
    along the axes that is around them all, and then of that around each.
    """
    if count == 0:
        return False
    at = trails[row, 0]
    for i in range(places):
        if _crosses_any(boxes, corners, count, at, trails[row, 2 * i + 1]):
            return True
        if i + 1 < places:
            after = trails[row, 2 * i + 2]
            if _crosses_any(boxes, corners, count, at, after):
                return True
            at = after
    return False
