# ruff: noqa: UP018
"""Meshes, instances and spheres, where they are, and points on them, as Warp functions."""

from typing import Any, Literal

import warp as wp

from clsim.render.features.features import Features
from clsim.render.motion.shutter import nearest_key, position_between, rotation_between, shutter_key, shutter_weight

Tree = Literal["bvh16", "warp"]
"""How a mesh is searched: by the 16-wide tree, which is faster but for CPUs alone, or by Warp's own."""

mat34 = wp.types.matrix(shape=(3, 4), dtype=wp.float32)
"""An affine map: the upper three rows of a 4×4 matrix."""

FAR = wp.constant(1.0e30)
CLEAR = wp.constant(0)
BLOCKED = wp.constant(1)
PERHAPS = wp.constant(2)
"""What a ray to a light meets: nothing, something opaque, or nothing but what may let light through."""
_OFFSET = wp.constant(4.0e-6)


@wp.struct
class Place:
    """An instance at a key: a map that scales, turns and moves; ``step`` is its way to the next key at its speed."""

    rotation: wp.quat
    scale: float
    position: wp.vec3
    step: wp.vec3


@wp.struct
class ShadingRow:
    """What shading needs of a triangle of what stands still, side by side: a line of the processor's cache."""

    normal0: wp.vec3
    normal1: wp.vec3
    normal2: wp.vec3
    uv0: wp.vec2
    uv1: wp.vec2
    uv2: wp.vec2
    material: int


@wp.struct
class Geometry:
    """The triangles of all meshes one after the other, their instances and the analytic spheres.

    Without motion blur instances have ``to_world`` and ``to_object``, one after the other for each instant, with it
    ``places``, likewise for each key of the interval, and so have spheres, with ``sphere_steps``. Where deforming
    meshes blur, each has a mesh for each key, which differ in their vertices alone, and ``instance_mesh`` goes on for
    each key. ``normals`` and ``uvs`` are empty where there are ``shading_rows``. ``rest_vertices`` are all vertices
    as they were at first, and ``rest_scales`` tell how much larger instances are in the world. ``trails`` take down
    where stored paths go (`stored_paths.py`).
    """

    mesh_handles: wp.array[wp.uint64]
    mesh_first_vertex: wp.array[int]
    mesh_first_triangle: wp.array[int]
    vertices: wp.array[wp.vec3]
    indices: wp.array[int]
    normals: wp.array[wp.vec3]
    uvs: wp.array[wp.vec2]
    colors: wp.array[wp.vec3]
    material_ids: wp.array[int]
    shading_rows: wp.array[ShadingRow]
    instance_tree: wp.uint64
    instance_mesh: wp.array[int]
    to_world: wp.array[mat34]
    to_object: wp.array[mat34]
    places: wp.array[Place]
    instance_count: int
    spheres: wp.array[wp.vec4]
    sphere_steps: wp.array[wp.vec3]
    sphere_count: int
    sphere_tree: wp.uint64
    rest_vertices: wp.array[wp.vec3]
    rest_scales: wp.array[float]
    trails: wp.array[wp.vec3, Literal[2]]


@wp.struct
class Hit:
    """The nearest surface that a ray meets; ``triangle`` and ``sphere`` are −1 where it is not one.

    Vertices, unit normal and the largest coordinate of the vertices, ``reach_m``, are those of the triangle in its
    mesh's space: the search has them at hand. ``boxed`` is whether the ray went into the box around an instance; where
    all that stands still is one mesh, that is not known, and true.
    """

    t: float
    boxed: bool
    instance: int
    triangle: int
    sphere: int
    weight0: float
    weight1: float
    vertex0: wp.vec3
    vertex1: wp.vec3
    vertex2: wp.vec3
    normal: wp.vec3
    reach_m: float


@wp.struct
class Surface:
    """A point on a triangle as shading needs it; the normals face the side that the ray came from.

    ``tint`` is the colour of its vertices, ``tangent`` and ``bitangent`` are the derivatives of the position by u and
    v, and 0 where uv have no area.
    ``reach_m`` is the largest coordinate by which the position was found: its error is a few roundings of that.
    """

    position: wp.vec3
    normal: wp.vec3
    shading_normal: wp.vec3
    uv: wp.vec2
    tint: wp.vec3
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


def make_shading_row(features: Features) -> Any:
    """Return the Warp function ``shading_row(geometry, triangle, first_vertex)``; what a scene lacks is 0.

    ``first_vertex`` is that of the triangle's mesh.
    """

    @wp.func
    def shading_row(geometry: Geometry, triangle: int, first_vertex: int) -> ShadingRow:
        row = ShadingRow()
        if wp.static(features.shading_rows):
            row = geometry.shading_rows[triangle]
        else:
            row.material = geometry.material_ids[triangle]
            i = first_vertex + geometry.indices[3 * triangle]
            j = first_vertex + geometry.indices[3 * triangle + 1]
            k = first_vertex + geometry.indices[3 * triangle + 2]
            if wp.static(features.smooth_normals):
                row.normal0 = geometry.normals[i]
                row.normal1 = geometry.normals[j]
                row.normal2 = geometry.normals[k]
            if wp.static(features.textures or features.anisotropic):
                row.uv0 = geometry.uvs[i]
                row.uv1 = geometry.uvs[j]
                row.uv2 = geometry.uvs[k]
        return row

    return shading_row


def make_row(features: Features) -> Any:
    """Return the Warp function ``row_at(count, index, time)``: the row of a table for item ``index`` of ``count``.

    A ray's ``time`` goes from 0 to 1 through the interval; where there are ``instants``, it is the instant's number.
    """

    @wp.func
    def row_at(count: int, index: int, time: float) -> int:
        row = int(index)
        if wp.static(features.instants):
            row = int(time) * count + index
        return row

    return row_at


def make_sphere_at(features: Features) -> Any:
    """Return the Warp function ``sphere_at(geometry, index, time)``: centre and radius."""
    row_at = make_row(features)

    @wp.func
    def sphere_at(geometry: Geometry, index: int, time: float) -> wp.vec4:
        sphere = geometry.spheres[row_at(geometry.sphere_count, index, time)]
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
    row_at = make_row(features)

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
            to_world = geometry.to_world[row_at(geometry.instance_count, instance, time)]
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
            to_object = geometry.to_object[row_at(geometry.instance_count, instance, time)]
        return to_object

    @wp.func
    def mesh_at(geometry: Geometry, instance: int, time: float) -> int:
        entry = instance
        if wp.static(features.deforming_blur):
            entry = nearest_key(time) * geometry.instance_count + instance
        if wp.static(features.deforming_instants):
            entry = row_at(geometry.instance_count, instance, time)
        return geometry.instance_mesh[entry]

    return to_world_at, to_object_at, mesh_at
