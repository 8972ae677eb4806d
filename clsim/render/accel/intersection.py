# ruff: noqa: RUF046, UP018
"""The intersection of rays with meshes, instances and spheres, as Warp functions.

Everything above the two functions of ``make_search`` is blind to how a mesh is searched.
"""

from typing import Any

import warp as wp

from clsim.render.accel.bvh16_traverse import TreeHit, any_in_tree, any_opaque_in_tree, closest_in_tree
from clsim.render.accel.geometry import (
    BLOCKED,
    CLEAR,
    FAR,
    PERHAPS,
    Geometry,
    Hit,
    Surface,
    Tree,
    hit_sphere,
    largest,
    make_placement,
    make_shading_row,
    make_sphere_at,
    reach_of,
    transform_normal,
    transform_point,
    transform_vector,
)
from clsim.render.features.features import Features


@wp.struct
class Found:
    """The nearest triangle of one mesh, numbered within it; −1 where there is none."""

    t: float
    triangle: int
    weight0: float
    weight1: float
    vertex0: wp.vec3
    vertex1: wp.vec3
    vertex2: wp.vec3
    normal: wp.vec3
    reach_m: float


@wp.func
def _bits3(bits: TreeHit, first: int) -> wp.vec3:
    return wp.vec3(wp.cast(bits[first], float), wp.cast(bits[first + 1], float), wp.cast(bits[first + 2], float))


@wp.func
def _unit_normal(a: wp.vec3, b: wp.vec3, c: wp.vec3) -> wp.vec3:
    return wp.normalize(wp.cross(b - a, c - a))


def make_search(tree: Tree, alpha: bool) -> tuple[Any, Any]:
    """Return the Warp functions ``closest_in_mesh`` and ``any_in_mesh``, for rays in the space of that mesh.

    The latter tells `CLEAR`, `BLOCKED` or, where there are cut-outs (``alpha``), `PERHAPS`.
    """

    @wp.func
    def closest_by_bvh16(geometry: Geometry, mesh: int, origin: wp.vec3, direction: wp.vec3, far: float) -> Found:
        bits = closest_in_tree(geometry.mesh_handles[mesh], origin, direction, 0.0, far)
        return Found(  # type: ignore[call-arg]
            wp.cast(bits[1], float),
            bits[0],
            wp.cast(bits[2], float),
            wp.cast(bits[3], float),
            _bits3(bits, 4),
            _bits3(bits, 7),
            _bits3(bits, 10),
            _bits3(bits, 13),
            wp.cast(bits[16], float),
        )

    @wp.func
    def any_by_bvh16(geometry: Geometry, mesh: int, origin: wp.vec3, direction: wp.vec3, far: float) -> int:
        if wp.static(alpha):
            found = any_opaque_in_tree(geometry.mesh_handles[mesh], origin, direction, 0.0, far)
        else:
            found = wp.where(any_in_tree(geometry.mesh_handles[mesh], origin, direction, 0.0, far), BLOCKED, CLEAR)
        return found

    @wp.func
    def closest_by_warp(geometry: Geometry, mesh: int, origin: wp.vec3, direction: wp.vec3, far: float) -> Found:
        hit = wp.mesh_query_ray(geometry.mesh_handles[mesh], origin, direction, far)
        found = Found()
        found.triangle = -1
        if hit.result:  # type: ignore[attr-defined]
            first = geometry.mesh_first_vertex[mesh]
            at = 3 * (geometry.mesh_first_triangle[mesh] + hit.face)  # type: ignore[attr-defined]
            found.t = hit.t  # type: ignore[attr-defined]
            found.triangle = hit.face  # type: ignore[attr-defined]
            found.weight0 = hit.u  # type: ignore[attr-defined]
            found.weight1 = hit.v  # type: ignore[attr-defined]
            found.vertex0 = geometry.vertices[first + geometry.indices[at]]
            found.vertex1 = geometry.vertices[first + geometry.indices[at + 1]]
            found.vertex2 = geometry.vertices[first + geometry.indices[at + 2]]
            found.normal = _unit_normal(found.vertex0, found.vertex1, found.vertex2)
            found.reach_m = reach_of(found.vertex0, found.vertex1, found.vertex2)
        return found

    @wp.func
    def any_by_warp(geometry: Geometry, mesh: int, origin: wp.vec3, direction: wp.vec3, far: float) -> int:
        met = wp.mesh_query_ray_anyhit(geometry.mesh_handles[mesh], origin, direction, far)
        return wp.where(met, wp.static(PERHAPS if alpha else BLOCKED), CLEAR)

    return (closest_by_bvh16, any_by_bvh16) if tree == "bvh16" else (closest_by_warp, any_by_warp)


def make_intersection(features: Features, tree: Tree) -> tuple[Any, Any, Any, Any]:
    """Return the Warp functions ``closest``, ``occluded``, ``surface`` and ``surface_of``.

    The second tells of what is nearer than ``far`` whether it is `CLEAR`, `BLOCKED` or, with cut-outs, `PERHAPS`. The
    last two give the front of a triangle (``face`` turns it to the ray), of any one and of the one that was hit.
    """
    closest_in_mesh, any_in_mesh = make_search(tree, features.alpha)
    sphere_at = make_sphere_at(features)
    to_world_at, to_object_at, mesh_at = make_placement(features)
    shading_row = make_shading_row(features)

    @wp.func
    def closest(geometry: Geometry, origin: wp.vec3, direction: wp.vec3, time: float) -> Hit:
        hit = Hit()
        hit.t = FAR
        hit.instance = -1
        hit.triangle = -1
        hit.sphere = -1
        if wp.static(features.two_level):
            candidates = wp.bvh_query_ray(geometry.instance_tree, origin, direction)
            instance = int(0)
            while wp.bvh_query_next(candidates, instance, hit.t):
                hit.boxed = True
                to_object = to_object_at(geometry, instance, time)
                mesh = mesh_at(geometry, instance, time)
                local_origin = transform_point(to_object, origin)
                local_direction = transform_vector(to_object, direction)
                found = closest_in_mesh(geometry, mesh, local_origin, local_direction, hit.t)
                if found.triangle >= 0:
                    hit.t = found.t
                    hit.instance = instance
                    hit.triangle = geometry.mesh_first_triangle[mesh] + found.triangle
                    hit.weight0 = found.weight0
                    hit.weight1 = found.weight1
                    hit.vertex0 = found.vertex0
                    hit.vertex1 = found.vertex1
                    hit.vertex2 = found.vertex2
                    hit.normal = found.normal
        else:
            hit.boxed = True
            found = closest_in_mesh(geometry, 0, origin, direction, hit.t)
            if found.triangle >= 0:
                hit.t = found.t
                hit.instance = 0
                hit.triangle = found.triangle
                hit.weight0 = found.weight0
                hit.weight1 = found.weight1
                hit.vertex0 = found.vertex0
                hit.vertex1 = found.vertex1
                hit.vertex2 = found.vertex2
                hit.normal = found.normal
                hit.reach_m = found.reach_m
        if wp.static(features.sphere_tree):
            near = wp.bvh_query_ray(geometry.sphere_tree, origin, direction)
            sphere = int(0)
            while wp.bvh_query_next(near, sphere, hit.t):
                t = hit_sphere(sphere_at(geometry, sphere, time), origin, direction)
                if t > 0.0 and t < hit.t:
                    hit.t = t
                    hit.triangle = -1
                    hit.sphere = sphere
        elif wp.static(features.sphere_lights):
            for i in range(geometry.sphere_count):
                t = hit_sphere(sphere_at(geometry, i, time), origin, direction)
                if t > 0.0 and t < hit.t:
                    hit.t = t
                    hit.triangle = -1
                    hit.sphere = i
        return hit

    @wp.func
    def occluded(geometry: Geometry, origin: wp.vec3, direction: wp.vec3, far: float, time: float) -> int:
        if wp.static(features.sphere_tree):
            near = wp.bvh_query_ray(geometry.sphere_tree, origin, direction)
            sphere = int(0)
            while wp.bvh_query_next(near, sphere, far):
                t = hit_sphere(sphere_at(geometry, sphere, time), origin, direction)
                if t > 0.0 and t < far:
                    return BLOCKED
        elif wp.static(features.sphere_lights):
            for i in range(geometry.sphere_count):
                t = hit_sphere(sphere_at(geometry, i, time), origin, direction)
                if t > 0.0 and t < far:
                    return BLOCKED
        if wp.static(features.two_level):
            perhaps = int(CLEAR)
            candidates = wp.bvh_query_ray(geometry.instance_tree, origin, direction)
            instance = int(0)
            while wp.bvh_query_next(candidates, instance, far):
                to_object = to_object_at(geometry, instance, time)
                local_origin = transform_point(to_object, origin)
                local_direction = transform_vector(to_object, direction)
                found = any_in_mesh(geometry, mesh_at(geometry, instance, time), local_origin, local_direction, far)
                if found == BLOCKED:
                    return BLOCKED
                if wp.static(features.alpha):
                    perhaps = wp.max(perhaps, found)
            return perhaps
        return any_in_mesh(geometry, 0, origin, direction, far)

    @wp.func
    def first_vertex(geometry: Geometry, instance: int, time: float) -> int:
        first = int(0)
        if wp.static(features.two_level):
            first = geometry.mesh_first_vertex[mesh_at(geometry, instance, time)]
        return first

    @wp.func
    def vertex_numbers(geometry: Geometry, instance: int, triangle: int, time: float) -> wp.vec3i:
        first = first_vertex(geometry, instance, time)
        return wp.vec3i(
            first + geometry.indices[3 * triangle],
            first + geometry.indices[3 * triangle + 1],
            first + geometry.indices[3 * triangle + 2],
        )

    @wp.func
    def surface_of(geometry: Geometry, hit: Hit, time: float) -> Surface:
        weight2 = 1.0 - hit.weight0 - hit.weight1
        p0 = hit.vertex0
        p1 = hit.vertex1
        p2 = hit.vertex2
        point = Surface()
        point.front = True
        point.normal = hit.normal
        if wp.static(features.two_level):
            to_world = to_world_at(geometry, hit.instance, time)
            to_object = to_object_at(geometry, hit.instance, time)
            point.normal = transform_normal(to_object, hit.normal)
            p0 = transform_point(to_world, p0)
            p1 = transform_point(to_world, p1)
            p2 = transform_point(to_world, p2)
        point.reach_m = hit.reach_m
        if wp.static(features.two_level):
            # A corner is the sum of the instance's place and a vector that may be longer than it.
            point.reach_m = reach_of(p0, p1, p2)
            place = wp.vec3(to_world[0, 3], to_world[1, 3], to_world[2, 3])
            point.reach_m = wp.max(point.reach_m, largest(place))
        point.area = 0.5 * wp.length(wp.cross(p1 - p0, p2 - p0))
        point.position = p0 * hit.weight0 + p1 * hit.weight1 + p2 * weight2
        point.shading_normal = point.normal
        row = shading_row(geometry, hit.triangle, first_vertex(geometry, hit.instance, time))
        point.material = row.material
        if wp.static(features.smooth_normals):
            blend = row.normal0 * hit.weight0 + row.normal1 * hit.weight1 + row.normal2 * weight2
            if wp.dot(blend, blend) > 1.0e-12:
                if wp.static(features.two_level):
                    point.shading_normal = transform_normal(to_object_at(geometry, hit.instance, time), blend)
                else:
                    point.shading_normal = wp.normalize(blend)
        if wp.static(features.textures):
            point.uv = row.uv0 * hit.weight0 + row.uv1 * hit.weight1 + row.uv2 * weight2
        if wp.static(features.vertex_colors):
            at = vertex_numbers(geometry, hit.instance, hit.triangle, time)
            point.tint = (
                geometry.colors[at[0]] * hit.weight0
                + geometry.colors[at[1]] * hit.weight1
                + geometry.colors[at[2]] * weight2
            )
        if wp.static(features.normal_maps or features.anisotropic or (features.textures and features.first_hits)):
            uv1 = row.uv1 - row.uv0
            uv2 = row.uv2 - row.uv0
            determinant = uv1[0] * uv2[1] - uv1[1] * uv2[0]
            if wp.abs(determinant) > 1.0e-30:
                point.tangent = ((p1 - p0) * uv2[1] - (p2 - p0) * uv1[1]) / determinant
                point.bitangent = ((p2 - p0) * uv1[0] - (p1 - p0) * uv2[0]) / determinant
        return point

    @wp.func
    def surface(
        geometry: Geometry, instance: int, triangle: int, weight0: float, weight1: float, time: float
    ) -> Surface:
        at = vertex_numbers(geometry, instance, triangle, time)
        hit = Hit()
        hit.instance = instance
        hit.triangle = triangle
        hit.weight0 = weight0
        hit.weight1 = weight1
        hit.vertex0 = geometry.vertices[at[0]]
        hit.vertex1 = geometry.vertices[at[1]]
        hit.vertex2 = geometry.vertices[at[2]]
        hit.normal = _unit_normal(hit.vertex0, hit.vertex1, hit.vertex2)
        hit.reach_m = reach_of(hit.vertex0, hit.vertex1, hit.vertex2)
        return surface_of(geometry, hit, time)

    return closest, occluded, surface, surface_of


@wp.func
def face(point: Surface, direction: wp.vec3) -> Surface:
    """Return the surface turned to the side that a ray along ``direction`` comes from.

    Where the interpolated normal faces away from the ray although the triangle does not, the triangle's is used.
    """
    turned = point
    if wp.dot(point.normal, direction) > 0.0:
        turned.front = False
        turned.normal = -point.normal
        turned.shading_normal = -point.shading_normal
    if wp.dot(turned.shading_normal, direction) >= 0.0:
        turned.shading_normal = turned.normal
    return turned
