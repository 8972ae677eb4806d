# ruff: noqa: SIM102, UP018, RUF046
"""The motion field: where on the image surfaces go in a step of time, by single rays, as Warp kernels.

What the ray meets is carried to the other instant by its instance's motion, and projected there; unless the camera is a
pinhole or orthographic, by Newton's method on its rays, so that every lens has its projection. On what deforms it goes
where its place on its triangle goes. Rays that meet no box of what moves are few, and none if the camera stands.
"""

from typing import Any

import warp as wp

from clsim.render.accel.geometry import FAR, Tree, make_placement, make_sphere_at, transform_point, xyz
from clsim.render.accel.intersection import make_intersection
from clsim.render.camera.camera import CameraState, make_camera, make_projection, plain
from clsim.render.device.compiler import kernel_options, one_at_a_time
from clsim.render.features.features import Features
from clsim.render.kernel_input import Scene, Settings

wp.set_module_options(kernel_options())

_ITERATIONS = wp.constant(4)
_NEAR_PX = wp.constant(0.002)
"""After so small a step of Newton's method the next one would be below 10⁻⁴ pixels."""
_FARTHEST = wp.constant(4.0)
"""Widths of the picture beyond which it does not matter where surfaces are."""
_SKY_M = wp.constant(1.0e6)
FRACTIONS = 256
"""Into how many parts a pixel is divided where lengths of ways are compared."""
_FRACTIONS = wp.constant(float(FRACTIONS))
_LONGEST_PX = wp.constant(4000.0)


@one_at_a_time
def build_motion_field(features: Features, tree: Tree) -> Any:
    """Return the kernel ``follow``.

    A thread is ``count`` blocks: on a CPU arguments are copied for each thread. A block is ``spacing`` pixels wide and
    high, and one pixel of it is followed: the first, or in every other block, as on a chessboard, the last, so that no
    line slips through. It sees at instant ``start``, 0 or 1, at the places ``at`` of the pixel's square, 0 to 1 each,
    of which the first is its middle. ``out_ways``, vec2 ``[places, blocks]``, tells how far what it sees has gone on
    the image by the other instant [pixels].

    ``near_moving``, a tree, has boxes around what moves, as much larger as a pixel is wide there. Where the ray through
    the middle meets none, all other ways are 0, and its own as well if the camera ``stands``.

    ``places``, vec4 of each block, is where what the middle sees is by the other instant, and 1, or 0 where the lens
    sees nothing; they are known already where they were ``seen``.
    """
    closest, _, surface, _ = make_intersection(features, tree)
    sphere_at = make_sphere_at(features)
    to_world_at, to_object_at, _ = make_placement(features)
    camera_ray = make_camera(features)
    parallel = features.projection == "orthographic"
    project = make_projection(features)

    @wp.func
    def carried(scene: Scene, origin: wp.vec3, direction: wp.vec3, start: float, end: float) -> wp.vec3:
        """Return where what a ray meets at ``start`` is at ``end``."""
        hit = closest(scene.geometry, origin, direction, start)
        place = origin + direction * _SKY_M
        if wp.static(parallel):
            # All rays see one place of the sky: nothing of it can be seen to move.
            place = origin
        if hit.t < FAR:
            place = origin + direction * hit.t
            if wp.static(features.sphere_lights):
                if hit.sphere >= 0:
                    before = xyz(sphere_at(scene.geometry, hit.sphere, start))
                    place += xyz(sphere_at(scene.geometry, hit.sphere, end)) - before
            if wp.static(features.deforming_instants):
                if hit.triangle >= 0:
                    found = surface(scene.geometry, hit.instance, hit.triangle, hit.weight0, hit.weight1, end)
                    place = found.position
            if wp.static(features.instants and features.two_level and not features.deforming_instants):
                if hit.triangle >= 0:
                    own = transform_point(to_object_at(scene.geometry, hit.instance, start), place)
                    place = transform_point(to_world_at(scene.geometry, hit.instance, end), own)
        return place

    @wp.func
    def place_in(camera: CameraState, place: wp.vec3, instant: int, width: int) -> wp.vec2:
        """Return where a pinhole without distortion sees a place."""
        image = camera.images[instant]
        way = wp.inverse(wp.transpose(image)) * (place - camera.positions[instant])
        # What is behind the camera counts as far away as what is at its side.
        at = wp.vec2(way[0], way[1])
        return at / wp.max(way[2], wp.length(at) / (_FARTHEST * float(width)))

    @wp.func
    def searched(camera: CameraState, place: wp.vec3, instant: int, near: wp.vec2, width: int) -> wp.vec2:
        """Return where a lens sees a place, by a search that begins at another place of the image."""
        at = near
        left = int(_ITERATIONS)
        while left > 0:
            left = left - 1
            here = camera_ray(camera, at[0], at[1], wp.vec2(), float(instant))
            right = camera_ray(camera, at[0] + 0.5, at[1], wp.vec2(), float(instant))
            below = camera_ray(camera, at[0], at[1] + 0.5, wp.vec2(), float(instant))
            along = (right.direction - here.direction) * 2.0
            down = (below.direction - here.direction) * 2.0
            miss = wp.normalize(place - here.origin) - here.direction
            xx = wp.dot(along, along)
            xy = wp.dot(along, down)
            yy = wp.dot(down, down)
            determinant = xx * yy - xy * xy
            if determinant > 0.0 and right.exists and below.exists:
                a = wp.dot(along, miss)
                b = wp.dot(down, miss)
                step = wp.vec2((yy * a - xy * b) / determinant, (xx * b - xy * a) / determinant)
                # Far from its solution Newton's method may run away.
                at += step * wp.min(1.0, float(width) / wp.max(wp.length(step), 1.0))
                if wp.length(step) < _NEAR_PX:
                    left = 0
        return at

    @wp.kernel(module="unique", enable_backward=False, module_options=kernel_options())
    def follow(
        scene: Scene,
        camera: CameraState,
        settings: Settings,
        first: int,
        count: int,
        spacing: int,
        start: int,
        at: wp.array[wp.vec2],
        stands: bool,
        near_moving: wp.uint64,
        seen: bool,
        places: wp.array[wp.vec4],
        out_ways: wp.array2d[wp.vec2],
    ) -> None:
        columns = (settings.width + spacing - 1) // spacing
        begin = first + wp.tid() * count
        for block in range(begin, begin + count):
            column = block % columns
            row = block // columns
            within = ((column + row) & 1) * (spacing - 1)
            near_it = bool(False)
            for i in range(at.shape[0]):
                x = float(column * spacing + within) + at[i][0]
                y = float(row * spacing + within) + at[i][1]
                found = places[block]
                if i > 0 or not seen:
                    found = wp.vec4()
                    ray = camera_ray(camera, x, y, wp.vec2(), float(start))
                    if wp.static(features.instants):
                        if i == 0:
                            near_it = not ray.exists
                            if ray.exists:
                                near = wp.bvh_query_ray(near_moving, ray.origin, ray.direction)
                                box = int(0)
                                near_it = wp.bvh_query_next(near, box)
                    if ray.exists and (near_it or (i == 0 and not stands)):
                        there = carried(scene, ray.origin, ray.direction, float(start), float(1 - start))
                        found = wp.vec4(there[0], there[1], there[2], 1.0)
                    if i == 0:
                        places[block] = found
                moved = wp.vec2()
                if found[3] > 0.0:
                    place = wp.vec3(found[0], found[1], found[2])
                    if wp.static(plain(features)):
                        moved = place_in(camera, place, 1 - start, settings.width) - wp.vec2(x, y)
                    elif wp.static(parallel):
                        there = project(camera, place - camera.positions[1 - start], 1 - start)
                        moved = wp.vec2(there[0], there[1]) - wp.vec2(x, y)
                    else:
                        moved = searched(camera, place, 1 - start, wp.vec2(x, y), settings.width) - wp.vec2(x, y)
                out_ways[i, block] = moved

    return follow


def pass_over(
    ways: wp.array2d[wp.vec2],
    columns: int,
    rows: int,
    spacing: float,
    out_longest: wp.array[wp.int64],
) -> None:
    """Tell each block of the longest way over it: its length in `FRACTIONS`, then the row and the block it is of.

    A thread is a row of ``ways`` ``[R, rows·columns]`` and a block, which is ``spacing`` pixels wide; bits of
    ``out_longest`` ``[rows·columns]`` from 32 on hold the length, the others row · blocks + block.
    """
    row, block = wp.tid()  # type: ignore[misc]
    way = ways[row, block]
    length = wp.min(wp.length(way), _LONGEST_PX)
    if length == 0.0:
        return
    steps = int(wp.ceil(length / spacing))
    key = (wp.int64(int(length * _FRACTIONS)) << wp.int64(32)) | wp.int64(row * columns * rows + block)
    for i in range(steps + 1):
        share = float(i) / float(wp.max(steps, 1)) / spacing
        x = int(wp.floor(float(block % columns) + 0.5 + way[0] * share))
        y = int(wp.floor(float(block // columns) + 0.5 + way[1] * share))
        if x >= 0 and x < columns and y >= 0 and y < rows:
            wp.atomic_max(out_longest, y * columns + x, key)


@one_at_a_time
def build_pass_over() -> Any:
    """Return the kernel `pass_over`, which is the same for all scenes."""
    return wp.kernel(enable_backward=False)(pass_over)
