# Warp: a variable that changes must be born by a call, and wp.static drops a branch only where it stands alone.
# ruff: noqa: RUF046, UP018
"""Meshes, instances and the intersection of rays with them, as Warp functions.

Everything above the two functions of ``make_search`` is blind to how a mesh is searched.
"""

from typing import Any, Literal

import warp as wp

from clsim.render.bvh8_traverse import TreeHit, any_in_tree, closest_in_tree
from clsim.render.features import Features
from clsim.render.shutter import nearest_key, position_between, rotation_between, shutter_key, shutter_weight

Tree = Literal["bvh8", "warp"]
"""How a mesh is searched: by the 8-wide tree, which is faster but for CPUs alone, or by Warp's own."""

mat34 = wp.types.matrix(shape=(3, 4), dtype=wp.float32)
"""An affine map: the upper three rows of a 4×4 matrix."""

FAR = wp.constant(1.0e30)
_OFFSET = wp.constant(4.0e-6)


@wp.struct
class Place:
    """An instance at a key: a map that scales, turns and moves; ``step`` is its way to the next key at its speed."""

    rotation: wp.quat
    scale: float
    position: wp.vec3
    step: wp.vec3


@wp.struct
class Geometry:
    """The triangles of all meshes one after the other, their instances and the analytic spheres.

    Without motion blur instances have ``to_world`` and ``to_object``, with it ``places``, one after the other for each
    key of the interval, and so have spheres, with ``sphere_steps``. Where deforming meshes blur, each has a mesh for
    each key, which differ in their vertices alone, and ``instance_mesh`` goes on for each key.
    """

    mesh_handles: wp.array(dtype=wp.uint64)
    mesh_first_vertex: wp.array(dtype=int)
    mesh_first_triangle: wp.array(dtype=int)
    vertices: wp.array(dtype=wp.vec3)
    indices: wp.array(dtype=int)
    normals: wp.array(dtype=wp.vec3)
    uvs: wp.array(dtype=wp.vec2)
    material_ids: wp.array(dtype=int)
    instance_tree: wp.uint64
    instance_mesh: wp.array(dtype=int)
    to_world: wp.array(dtype=mat34)
    to_object: wp.array(dtype=mat34)
    places: wp.array(dtype=Place)
    instance_count: int
    spheres: wp.array(dtype=wp.vec4)
    sphere_steps: wp.array(dtype=wp.vec3)
    sphere_count: int


@wp.struct
class Hit:
    """The nearest thing a ray meets; ``triangle`` and ``sphere`` are −1 where it is not one.

    Vertices and unit normal are those of the triangle in its mesh's space: the search has them at hand.
    """

    t: float
    instance: int
    triangle: int
    sphere: int
    weight0: float
    weight1: float
    vertex0: wp.vec3
    vertex1: wp.vec3
    vertex2: wp.vec3
    normal: wp.vec3


@wp.struct
class Surface:
    """A point on a triangle as shading needs it; the normals face the side that the ray came from.

    ``tangent`` and ``bitangent`` are the derivatives of the position by u and v, and 0 where uv have no area.
    ``reach_m`` is the largest coordinate by which the position was found: its error is a few roundings of that.
    """

    position: wp.vec3
    normal: wp.vec3
    shading_normal: wp.vec3
    uv: wp.vec2
    tangent: wp.vec3
    bitangent: wp.vec3
    material: int
    front: bool
    area: float
    reach_m: float


@wp.func
def largest(v: wp.vec3) -> float:
    """Return the largest coordinate, sign aside."""
    return wp.max(wp.abs(v[0]), wp.max(wp.abs(v[1]), wp.abs(v[2])))


@wp.func
def reach_of(p0: wp.vec3, p1: wp.vec3, p2: wp.vec3) -> float:
    """Return the largest coordinate of a triangle.

    What is rounded where a ray meets it or leaves it: a point on it is a blend of its corners, and a ray from there is
    tested against differences to them. So a point is off the triangle's plane by a few of its roundings at most
    (Pharr, Jakob, Humphreys, Physically Based Rendering, 4th ed., §6.8, bounds each step by such γ).
    """
    return wp.max(largest(p0), wp.max(largest(p1), largest(p2)))


@wp.func
def offset_origin(position: wp.vec3, normal: wp.vec3, reach_m: float) -> wp.vec3:
    """Return a ray origin moved off the surface, by about sixty roundings of the largest coordinate involved."""
    return position + normal * (_OFFSET * reach_m)


@wp.func
def step_beyond(normal: wp.vec3, direction: wp.vec3, reach_m: float) -> float:
    """Return how far behind a surface a ray goes on, on its own line: as far off it as by ``offset_origin``."""
    return _OFFSET * reach_m / wp.max(wp.abs(wp.dot(normal, direction)), 0.05)


@wp.func
def xyz(v: wp.vec4) -> wp.vec3:
    """Return the first three."""
    return wp.vec3(v[0], v[1], v[2])


@wp.func
def transform_point(m: mat34, p: wp.vec3) -> wp.vec3:
    """Return the image of a point."""
    return m * wp.vec4(p[0], p[1], p[2], 1.0)


@wp.func
def transform_vector(m: mat34, v: wp.vec3) -> wp.vec3:
    """Return the image of a direction, its length not restored: ray parameters stay those of the world."""
    return m * wp.vec4(v[0], v[1], v[2], 0.0)


@wp.func
def transform_normal(to_object: mat34, n: wp.vec3) -> wp.vec3:
    """Return the image of a normal (by the transposed inverse), of unit length."""
    return wp.normalize(
        wp.vec3(
            to_object[0, 0] * n[0] + to_object[1, 0] * n[1] + to_object[2, 0] * n[2],
            to_object[0, 1] * n[0] + to_object[1, 1] * n[1] + to_object[2, 1] * n[2],
            to_object[0, 2] * n[0] + to_object[1, 2] * n[1] + to_object[2, 2] * n[2],
        )
    )


@wp.func
def hit_sphere(sphere: wp.vec4, origin: wp.vec3, direction: wp.vec3) -> float:
    """Return the distance at which a unit-length ray enters the sphere; −1 on a miss or from inside."""
    to_centre = wp.vec3(sphere[0], sphere[1], sphere[2]) - origin
    along = wp.dot(to_centre, direction)
    # The distance of centre and ray is taken from the perpendicular: b² − c cancels for far spheres
    # (Haines et al., Ray Tracing Gems, ch. 7).
    perpendicular = to_centre - direction * along
    half_chord2 = sphere[3] * sphere[3] - wp.dot(perpendicular, perpendicular)
    t = float(-1.0)
    if half_chord2 > 0.0 and wp.dot(to_centre, to_centre) > sphere[3] * sphere[3]:
        t = along - wp.sqrt(half_chord2)
    return t


def make_sphere_at(features: Features) -> Any:
    """Return the Warp function ``sphere_at(geometry, index, time)``: centre and radius."""

    @wp.func
    def sphere_at(geometry: Geometry, index: int, time: float) -> wp.vec4:
        sphere = geometry.spheres[index]
        if wp.static(features.motion_blur):
            first = shutter_key(time) * geometry.sphere_count + index
            after = first + geometry.sphere_count
            place = position_between(
                xyz(geometry.spheres[first]),
                xyz(geometry.spheres[after]),
                geometry.sphere_steps[first],
                geometry.sphere_steps[after],
                shutter_weight(time),
            )
            sphere = wp.vec4(place[0], place[1], place[2], sphere[3])
        return sphere

    return sphere_at


def make_placement(features: Features) -> tuple[Any, Any, Any]:
    """Return the Warp functions ``to_world_at``, its inverse ``to_object_at``, and ``mesh_at``.

    All take (geometry, instance, time). The last gives the place of an instance's mesh, as it is shaped at that time,
    in the table of meshes.
    """

    @wp.func
    def to_world_at(geometry: Geometry, instance: int, time: float) -> mat34:
        if wp.static(features.motion_blur):
            first = shutter_key(time) * geometry.instance_count + instance
            a = geometry.places[first]
            b = geometry.places[first + geometry.instance_count]
            weight = shutter_weight(time)
            turn = rotation_between(a.rotation, b.rotation, weight)
            m = wp.quat_to_matrix(turn) * wp.lerp(a.scale, b.scale, weight)
            p = position_between(a.position, b.position, a.step, b.step, weight)
            to_world = mat34(
                m[0, 0], m[0, 1], m[0, 2], p[0], m[1, 0], m[1, 1], m[1, 2], p[1], m[2, 0], m[2, 1], m[2, 2], p[2]
            )
        else:
            to_world = geometry.to_world[instance]
        return to_world

    @wp.func
    def to_object_at(geometry: Geometry, instance: int, time: float) -> mat34:
        if wp.static(features.motion_blur):
            m = to_world_at(geometry, instance, time)
            x = wp.vec3(m[0, 0], m[1, 0], m[2, 0])
            y = wp.vec3(m[0, 1], m[1, 1], m[2, 1])
            z = wp.vec3(m[0, 2], m[1, 2], m[2, 2])
            moved = wp.vec3(m[0, 3], m[1, 3], m[2, 3])
            scale = 1.0 / wp.dot(x, wp.cross(y, z))
            a = wp.cross(y, z) * scale
            b = wp.cross(z, x) * scale
            c = wp.cross(x, y) * scale
            to_object = mat34(
                a[0], a[1], a[2], -wp.dot(a, moved),
                b[0], b[1], b[2], -wp.dot(b, moved),
                c[0], c[1], c[2], -wp.dot(c, moved),
            )  # fmt: skip
        else:
            to_object = geometry.to_object[instance]
        return to_object

    @wp.func
    def mesh_at(geometry: Geometry, instance: int, time: float) -> int:
        entry = instance
        if wp.static(features.deforming_blur):
            entry = nearest_key(time) * geometry.instance_count + instance
        return geometry.instance_mesh[entry]

    return to_world_at, to_object_at, mesh_at


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


@wp.func
def _bits3(bits: TreeHit, first: int) -> wp.vec3:
    return wp.vec3(wp.cast(bits[first], float), wp.cast(bits[first + 1], float), wp.cast(bits[first + 2], float))


@wp.func
def _unit_normal(a: wp.vec3, b: wp.vec3, c: wp.vec3) -> wp.vec3:
    return wp.normalize(wp.cross(b - a, c - a))


def make_search(tree: Tree) -> tuple[Any, Any]:
    """Return the Warp functions ``closest_in_mesh`` and ``any_in_mesh``, for rays in the space of that mesh."""

    @wp.func
    def closest_by_bvh8(geometry: Geometry, mesh: int, origin: wp.vec3, direction: wp.vec3, far: float) -> Found:
        bits = closest_in_tree(geometry.mesh_handles[mesh], origin, direction, 0.0, far)
        return Found(
            wp.cast(bits[1], float),
            bits[0],
            wp.cast(bits[2], float),
            wp.cast(bits[3], float),
            _bits3(bits, 4),
            _bits3(bits, 7),
            _bits3(bits, 10),
            _bits3(bits, 13),
        )

    @wp.func
    def any_by_bvh8(geometry: Geometry, mesh: int, origin: wp.vec3, direction: wp.vec3, far: float) -> bool:
        return any_in_tree(geometry.mesh_handles[mesh], origin, direction, 0.0, far)

    @wp.func
    def closest_by_warp(geometry: Geometry, mesh: int, origin: wp.vec3, direction: wp.vec3, far: float) -> Found:
        hit = wp.mesh_query_ray(geometry.mesh_handles[mesh], origin, direction, far)
        found = Found()
        found.triangle = -1
        if hit.result:
            first = geometry.mesh_first_vertex[mesh]
            at = 3 * (geometry.mesh_first_triangle[mesh] + hit.face)
            found.t = hit.t
            found.triangle = hit.face
            found.weight0 = hit.u
            found.weight1 = hit.v
            found.vertex0 = geometry.vertices[first + geometry.indices[at]]
            found.vertex1 = geometry.vertices[first + geometry.indices[at + 1]]
            found.vertex2 = geometry.vertices[first + geometry.indices[at + 2]]
            found.normal = _unit_normal(found.vertex0, found.vertex1, found.vertex2)
        return found

    @wp.func
    def any_by_warp(geometry: Geometry, mesh: int, origin: wp.vec3, direction: wp.vec3, far: float) -> bool:
        return wp.mesh_query_ray_anyhit(geometry.mesh_handles[mesh], origin, direction, far)

    return (closest_by_bvh8, any_by_bvh8) if tree == "bvh8" else (closest_by_warp, any_by_warp)


def make_intersection(features: Features, tree: Tree) -> tuple[Any, Any, Any, Any]:
    """Return the Warp functions ``closest``, ``occluded`` (anything nearer than ``far``?), ``surface``, ``surface_of``.

    The last two give the front of a triangle (``face`` turns it to the ray), of any one and of the one that was hit.
    """
    closest_in_mesh, any_in_mesh = make_search(tree)
    sphere_at = make_sphere_at(features)
    to_world_at, to_object_at, mesh_at = make_placement(features)

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
        if wp.static(features.sphere_lights):
            for i in range(geometry.sphere_count):
                t = hit_sphere(sphere_at(geometry, i, time), origin, direction)
                if t > 0.0 and t < hit.t:
                    hit.t = t
                    hit.triangle = -1
                    hit.sphere = i
        return hit

    @wp.func
    def occluded(geometry: Geometry, origin: wp.vec3, direction: wp.vec3, far: float, time: float) -> bool:
        if wp.static(features.sphere_lights):
            for i in range(geometry.sphere_count):
                t = hit_sphere(sphere_at(geometry, i, time), origin, direction)
                if t > 0.0 and t < far:
                    return True
        if wp.static(features.two_level):
            candidates = wp.bvh_query_ray(geometry.instance_tree, origin, direction)
            instance = int(0)
            while wp.bvh_query_next(candidates, instance, far):
                to_object = to_object_at(geometry, instance, time)
                local_origin = transform_point(to_object, origin)
                local_direction = transform_vector(to_object, direction)
                if any_in_mesh(geometry, mesh_at(geometry, instance, time), local_origin, local_direction, far):
                    return True
            return False
        return any_in_mesh(geometry, 0, origin, direction, far)

    @wp.func
    def vertex_numbers(geometry: Geometry, instance: int, triangle: int, time: float) -> wp.vec3i:
        first = int(0)
        if wp.static(features.two_level):
            first = geometry.mesh_first_vertex[mesh_at(geometry, instance, time)]
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
        point.reach_m = reach_of(p0, p1, p2)
        if wp.static(features.two_level):
            # A corner is the sum of the instance's place and a vector that may be longer than it.
            place = wp.vec3(to_world[0, 3], to_world[1, 3], to_world[2, 3])
            point.reach_m = wp.max(point.reach_m, largest(place))
        point.area = 0.5 * wp.length(wp.cross(p1 - p0, p2 - p0))
        point.position = p0 * hit.weight0 + p1 * hit.weight1 + p2 * weight2
        point.shading_normal = point.normal
        if wp.static(features.smooth_normals):
            at = vertex_numbers(geometry, hit.instance, hit.triangle, time)
            blend = (
                geometry.normals[at[0]] * hit.weight0
                + geometry.normals[at[1]] * hit.weight1
                + geometry.normals[at[2]] * weight2
            )
            if wp.dot(blend, blend) > 1.0e-12:
                if wp.static(features.two_level):
                    point.shading_normal = transform_normal(to_object_at(geometry, hit.instance, time), blend)
                else:
                    point.shading_normal = wp.normalize(blend)
        if wp.static(features.textures):
            at = vertex_numbers(geometry, hit.instance, hit.triangle, time)
            point.uv = (
                geometry.uvs[at[0]] * hit.weight0 + geometry.uvs[at[1]] * hit.weight1 + geometry.uvs[at[2]] * weight2
            )
        if wp.static(features.normal_maps):
            at = vertex_numbers(geometry, hit.instance, hit.triangle, time)
            uv1 = geometry.uvs[at[1]] - geometry.uvs[at[0]]
            uv2 = geometry.uvs[at[2]] - geometry.uvs[at[0]]
            determinant = uv1[0] * uv2[1] - uv1[1] * uv2[0]
            if wp.abs(determinant) > 1.0e-30:
                point.tangent = ((p1 - p0) * uv2[1] - (p2 - p0) * uv1[1]) / determinant
                point.bitangent = ((p2 - p0) * uv1[0] - (p1 - p0) * uv2[0]) / determinant
        point.material = geometry.material_ids[hit.triangle]
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
        return surface_of(geometry, hit, time)

    return closest, occluded, surface, surface_of


@wp.func
def face(point: Surface, direction: wp.vec3) -> Surface:
    """Return the surface turned to the side that a ray along ``direction`` comes from.

    Where the interpolated normal looks away from the ray although the triangle does not, the triangle's is used.
    """
    turned = point
    if wp.dot(point.normal, direction) > 0.0:
        turned.front = False
        turned.normal = -point.normal
        turned.shading_normal = -point.shading_normal
    if wp.dot(turned.shading_normal, direction) >= 0.0:
        turned.shading_normal = turned.normal
    return turned
