# ruff: noqa: UP018, RUF046
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
_BEYOND = wp.constant(1.001)
"""How far a way reaches, its own length being 1: a box that touches its end counts."""
_LEAST = wp.constant(1.0e-12)
"""Stands for a part of a direction that is smaller."""


@wp.struct
class Moved:
    """Boxes around what has moved: where each instance was, and then where each is, those that stand included.

    Attributes:
        any: whether one has moved.
        lower, upper: corners of the box along the axes that is around all that have.
        lowers, uppers: corners of such boxes, one around each, …
        tree: … and a tree of them.
        counts: whether that instance has moved.
        into_boxes: makes the box along its own axes the cube from −1 to 1.
    """

    any: bool
    lower: wp.vec3
    upper: wp.vec3
    lowers: wp.array[wp.vec3]
    uppers: wp.array[wp.vec3]
    tree: wp.uint64
    counts: wp.array[bool]
    into_boxes: wp.array[mat34]


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
        d = to_m[c] - from_m[c]
        if wp.abs(d) < _LEAST:
            d = _LEAST
        a = (-1.0 - from_m[c]) / d
        b = (1.0 - from_m[c]) / d
        enters = wp.max(enters, wp.min(a, b))
        leaves = wp.min(leaves, wp.max(a, b))
    return enters <= leaves


@wp.func
def _crosses_any(moved: Moved, from_m: wp.vec3, to_m: wp.vec3) -> bool:
    # Most ways lie beyond one side of the box around all. Which one, a processor cannot foresee: so without a branch.
    beyond = wp.max(wp.min(from_m, to_m) - moved.upper, moved.lower - wp.max(from_m, to_m))
    way = to_m - from_m
    if wp.max(beyond) > 0.0 or wp.dot(way, way) == 0.0:
        return False
    near = wp.bvh_query_ray(moved.tree, from_m, way)
    box = int(0)
    while wp.bvh_query_next(near, box, _BEYOND):
        if moved.counts[box]:
            into = moved.into_boxes[box]
            if _crosses(transform_point(into, from_m), transform_point(into, to_m)):
                return True
    return False


@wp.func
def trail_crosses(trails: wp.array[wp.vec3, Literal[2]], row: int, places: int, moved: Moved) -> bool:
    """Whether a path with so many places leads through a box of what has moved."""
    if not moved.any:
        return False
    at = trails[row, 0]
    for i in range(places):
        if _crosses_any(moved, at, trails[row, 2 * i + 1]):
            return True
        if i + 1 < places:
            after = trails[row, 2 * i + 2]
            if _crosses_any(moved, at, after):
                return True
            at = after
    return False
