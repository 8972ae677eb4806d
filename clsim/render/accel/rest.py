# ruff: noqa: UP018
"""The rest position of a place on a surface, the same for all times, as a Warp function."""

from typing import Any

import warp as wp

from clsim.render.accel.geometry import Geometry, Hit, make_placement
from clsim.render.features.features import Features


def make_rest(features: Features) -> Any:
    """Return the Warp function ``rest_of(geometry, hit, front, time)``: the place and how its triangle faces there.

    An instance rests at its own origin, in the size that it has in the world; a mesh that deforms has its first shape.
    """
    _, _, mesh_at = make_placement(features)

    @wp.func
    def rest_of(geometry: Geometry, hit: Hit, front: bool, time: float) -> tuple[wp.vec3, wp.vec3]:
        p0 = hit.vertex0
        p1 = hit.vertex1
        p2 = hit.vertex2
        normal = hit.normal
        scale = float(1.0)
        if wp.static(features.two_level):
            scale = geometry.rest_scales[hit.instance]
        if wp.static(features.deforms):
            first = geometry.mesh_first_vertex[mesh_at(geometry, hit.instance, time)]
            p0 = geometry.rest_vertices[first + geometry.indices[3 * hit.triangle]]
            p1 = geometry.rest_vertices[first + geometry.indices[3 * hit.triangle + 1]]
            p2 = geometry.rest_vertices[first + geometry.indices[3 * hit.triangle + 2]]
            normal = wp.normalize(wp.cross(p1 - p0, p2 - p0))  # type: ignore[assignment]
        place = p0 * hit.weight0 + p1 * hit.weight1 + p2 * (1.0 - hit.weight0 - hit.weight1)
        return place * scale, wp.where(front, normal, -normal)  # type: ignore[return-value]

    return rest_of
