# ruff: noqa: UP018
"""The rest position of a place on a surface, the same for all times, as a Warp function."""

from typing import Any

import warp as wp

from clsim.render.accel.geometry import Geometry, Hit, make_placement, transform_vector
from clsim.render.features.features import Features


def make_rest(features: Features) -> Any:
    """Return the Warp function ``rest_of(geometry, hit, normal, front, time)``: the place and its normal there.

    An instance rests at its own origin, in the size that it has in the world; a mesh that deforms has its first shape,
    and where there is one, normals are those of triangles. Elsewhere it is ``normal``, turned as the instance is.
    """
    _, to_object_at, mesh_at = make_placement(features)

    @wp.func
    def rest_of(geometry: Geometry, hit: Hit, normal: wp.vec3, front: bool, time: float) -> tuple[wp.vec3, wp.vec3]:
        p0 = hit.vertex0
        p1 = hit.vertex1
        p2 = hit.vertex2
        rest_normal = normal
        scale = float(1.0)
        if wp.static(features.two_level):
            scale = geometry.rest_scales[hit.instance]
            turned = transform_vector(to_object_at(geometry, hit.instance, time), normal)
            rest_normal = wp.normalize(turned)  # type: ignore[assignment]
        if wp.static(features.deforms):
            first = geometry.mesh_first_vertex[mesh_at(geometry, hit.instance, time)]
            p0 = geometry.rest_vertices[first + geometry.indices[3 * hit.triangle]]
            p1 = geometry.rest_vertices[first + geometry.indices[3 * hit.triangle + 1]]
            p2 = geometry.rest_vertices[first + geometry.indices[3 * hit.triangle + 2]]
            faces = wp.normalize(wp.cross(p1 - p0, p2 - p0))
            rest_normal = faces * wp.where(front, 1.0, -1.0)
        place = p0 * hit.weight0 + p1 * hit.weight1 + p2 * (1.0 - hit.weight0 - hit.weight1)
        return place * scale, rest_normal  # type: ignore[return-value]

    return rest_of
