# ruff: noqa: SIM102, UP018, RUF046
"""Flat pixels, which show one flat, textured surface while the camera moves: their light at any time, as Warp kernels.

What a ray at a pixel's corner meets on a plane that does not move is known without tracing it. So the corners of a
frame tell for each of them where it lies on the surface at a few instants of a step; in between that place is a
polynomial in time. The mean of the texture between four corners is the pixel's albedo. Light is known at both ends of
the step, and goes straight between. Both are multiplied at as many times as it takes until lines between them will do.
"""

from typing import Any

import numpy as np
import warp as wp

from clsim.render.bsdf.bsdf import make_bsdf
from clsim.render.camera.camera import CameraState, make_camera
from clsim.render.camera.film import Sample
from clsim.render.device.compiler import kernel_options, one_at_a_time
from clsim.render.features.features import Features
from clsim.render.kernel_input import Scene, Settings
from clsim.render.primary.corners import make_flat_surfaces
from clsim.render.primary.seen_surfaces import DARK
from clsim.render.surfaces.materials import make_materials
from clsim.render.textures.checkerboards import square_shown
from clsim.render.textures.texture_data import Footprint, uv_in

INSTANTS = 5
"""Instants of a step at which corners are placed, both ends among them."""
MOST_KNOTS = 40
"""Times of a pixel at most; where more are needed nothing is told of it."""
_COEFFICIENTS = wp.types.matrix(shape=(INSTANTS, INSTANTS), dtype=wp.float32)(
    np.linalg.inv(np.vander(np.linspace(0.0, 1.0, INSTANTS), increasing=True)).tolist()
)
"""From what a polynomial is at the instants of a step to its coefficients, from the constant one on."""
_INSTANTS, _MOST_KNOTS = wp.constant(INSTANTS), wp.constant(MOST_KNOTS)
_STRIDE = wp.constant(4)
"""Distance between the corners from which a surface's uv are read, where it reaches so far: float32 asks for it."""
_DEPTH = 18
_DEEPEST = wp.constant(_DEPTH - 1)
"""How often a step is halved."""
_SMOOTH = wp.constant(3.0)
"""Times by which a line may be off in the middle, where the middle is told too: a parabola's error is a fourth then."""
_ANY_SLOPE = wp.constant(1.0e30)
_OFF_UV = wp.constant(0.02)
_SAME_NORMAL = wp.constant(0.99999)
_OFF_PLANE = wp.constant(1.0e-4)
"""Share of the distance by which what is seen may leave a plane."""


@wp.struct
class Plane:
    """A flat surface around a corner of a pixel: a point, the normal, and how u and v grow in space.

    ``known`` is whether there is one, as far as the corner's neighbours on the right and below.
    """

    known: bool
    position: wp.vec3
    normal: wp.vec3
    uv: wp.vec2
    u_grows: wp.vec3
    v_grows: wp.vec3


@wp.func
def _same_plane(a: Sample, b: Sample) -> bool:
    same = b.hit and b.material == a.material and b.front == a.front and wp.dot(a.normal, b.normal) > _SAME_NORMAL
    return same and wp.abs(wp.dot(b.position - a.position, a.normal)) < _OFF_PLANE * a.depth


@wp.func
def _matt(sample: Sample) -> bool:
    """Whether all light from there is reflected, in proportion to the albedo: light of its own and of a coat is not."""
    return wp.length_sq(sample.emission) == 0.0 and wp.length_sq(sample.coat) == 0.0


@wp.func
def _plane_through(corners: wp.array[Sample], corner: int, right: int, below: int) -> Plane:
    """Return the plane on which a corner and three more lie: ``right`` and ``below`` tell how far on they stand."""
    plane = Plane()
    a = corners[corner]
    b = corners[corner + right]
    c = corners[corner + below]
    d = corners[corner + right + below]
    if _same_plane(a, b) and _same_plane(a, c) and _same_plane(a, d):
        along = b.position - a.position
        down = c.position - a.position
        xx = wp.dot(along, along)
        xy = wp.dot(along, down)
        yy = wp.dot(down, down)
        determinant = xx * yy - xy * xy
        if determinant > 0.0:
            by_along = (along * yy - down * xy) / determinant
            by_down = (down * xx - along * xy) / determinant
            u_along = b.uv - a.uv
            u_down = c.uv - a.uv
            plane.position = a.position
            plane.normal = a.normal
            plane.uv = a.uv
            plane.u_grows = by_along * u_along[0] + by_down * u_down[0]
            plane.v_grows = by_along * u_along[1] + by_down * u_down[1]
            # Where surfaces of one plane meet, their uv need not.
            off = wp.length(_uv_on(plane, d.position) - d.uv)
            plane.known = off <= _OFF_UV * (wp.length(u_along) + wp.length(u_down)) + 1.0e-6
    return plane


@wp.func
def _uv_on(plane: Plane, position: wp.vec3) -> wp.vec2:
    away = position - plane.position
    return plane.uv + wp.vec2(wp.dot(plane.u_grows, away), wp.dot(plane.v_grows, away))


@wp.struct
class Door:
    """A line that passes by what came after its first knot, as near as it should: a swinging door (Bristol, ISA 1990).

    ``from_share`` and ``from_height`` are of that knot, ``share``, ``value`` and ``height`` of the last place, and the
    line's slope may be from ``low`` to ``high``. Heights are what is straight on a line: values, or their logarithms.
    ``shut`` is that the last place but one had to become a knot.
    """

    from_share: float
    from_height: float
    share: float
    value: float
    height: float
    low: float
    high: float
    shut: bool


@wp.func
def _height(value: float, linear: bool) -> float:
    height = float(value)
    if not linear:
        height = wp.log(value)
    return height


@wp.func
def open_door(value: float, linear: bool) -> Door:
    """Return the door of a knot at the start of a step."""
    door = Door()
    door.value = value
    door.from_height = _height(value, linear)
    door.height = door.from_height
    door.low = -_ANY_SLOPE
    door.high = _ANY_SLOPE
    return door


@wp.func
def pass_door(before: Door, share: float, value: float, allowed: float, linear: bool) -> Door:
    """Return the door after one more place, by which a line should pass within that share of the value."""
    door = before
    height = _height(value, linear)
    room = allowed
    if linear:
        room = allowed * value
    slope = (height - door.from_height) / (share - door.from_share)
    door.shut = slope < door.low or slope > door.high
    if door.shut:
        door.from_share = before.share
        door.from_height = before.height
        door.low = -_ANY_SLOPE
        door.high = _ANY_SLOPE
    run = share - door.from_share
    door.low = wp.max(door.low, (height - room - door.from_height) / run)
    door.high = wp.min(door.high, (height + room - door.from_height) / run)
    door.share = share
    door.value = value
    door.height = height
    return door


@one_at_a_time
def build_flat_pixels(features: Features) -> tuple[Any, Any, Any]:
    """Return the kernels ``bound``, ``place`` and ``follow``, a thread of which takes ``count`` of what they are of.

    The first two are of corners of pixels, of which a row has one more than there are pixels; ``corners`` is
    what each saw in a frame. ``out_bounds``, uint8, is 0 where a corner and its neighbours on the right and below see
    one flat surface whose albedo its texture tells, and whose light follows it. ``out_places``, vec3
    ``[corners, INSTANTS]``, are the coefficients of a polynomial in the share of a step that tells where on it a corner
    is: uv over distance, and 1 over distance; uv and 1 where rays are parallel.

    ``follow`` is of pixels of the list ``pixels``. ``light``, float ``[6, H·W]``, is that of all pixels at the start,
    R, G and B, and at the end. It writes up to `MOST_KNOTS` times, as shares of the step, and the sums over R, G and B
    of albedo times light, and how many: 0 where the albedo stays as it is, −1 where they are not enough. Lines between
    them are as right as `clsim.frames.Fineness` says.
    """
    *_, textured, coloured, _, mean_texture = make_materials(features)
    *_, albedo_of = make_bsdf(features)
    flat, mean_albedo = make_flat_surfaces(textured, coloured, mean_texture, albedo_of, features.coats)
    camera_ray = make_camera(features)

    @wp.kernel(module="unique", enable_backward=False, module_options=kernel_options())
    def bound(
        scene: Scene,
        settings: Settings,
        first: int,
        count: int,
        rows: int,
        corners: wp.array[Sample],
        out_bounds: wp.array[wp.uint8],
    ) -> None:
        row = settings.width + 1
        begin = first + wp.tid() * count
        for corner in range(begin, begin + count):
            bounds = wp.uint8(1)
            if corner % row < row - 1 and corner // row < rows - 1:
                if flat(scene, corners[corner]) and _matt(corners[corner]):
                    plane = _plane_through(corners, corner, 1, row)
                    if plane.known:
                        bounds = wp.uint8(0)
            out_bounds[corner] = bounds

    @wp.kernel(module="unique", enable_backward=False, module_options=kernel_options())
    def place(
        camera: CameraState,
        settings: Settings,
        first: int,
        count: int,
        rows: int,
        corners: wp.array[Sample],
        bounds: wp.array[wp.uint8],
        out_places: wp.array2d[wp.vec3],
    ) -> None:
        row = settings.width + 1
        powers = wp.zeros(shape=wp.static(INSTANTS), dtype=wp.vec3)
        begin = first + wp.tid() * count
        for corner in range(begin, begin + count):
            if bounds[corner] != wp.uint8(0):
                continue
            x = corner % row
            y = corner // row
            plane = Plane()
            if x + _STRIDE < row and y + _STRIDE < rows:
                plane = _plane_through(corners, corner, _STRIDE, _STRIDE * row)
            if not plane.known:
                plane = _plane_through(corners, corner, 1, row)
            for j in range(_INSTANTS):
                powers[j] = wp.vec3()
            for k in range(_INSTANTS):
                ray = camera_ray(camera, float(x), float(y), wp.vec2(), float(k))
                facing = wp.dot(ray.direction, plane.normal)
                distance = wp.dot(plane.position - ray.origin, plane.normal) / wp.where(facing == 0.0, 1.0e-12, facing)
                uv = _uv_on(plane, ray.origin + ray.direction * distance)
                at = wp.vec3(uv[0], uv[1], 1.0)
                if wp.static(features.projection != "orthographic"):
                    at = at / distance
                for j in range(_INSTANTS):
                    powers[j] += at * wp.static(_COEFFICIENTS)[j, k]
            for j in range(_INSTANTS):
                out_places[corner, j] = powers[j]

    @wp.func
    def place_at(places: wp.array2d[wp.vec3], corner: int, share: float) -> wp.vec3:
        at = places[corner, _INSTANTS - 1]
        for k in range(1, _INSTANTS):
            at = at * share + places[corner, _INSTANTS - 1 - k]
        return at

    @wp.func
    def footprint_at(places: wp.array2d[wp.vec3], corner: int, row: int, share: float) -> Footprint:
        f = Footprint()
        f.top_left = place_at(places, corner, share)
        f.top_right = place_at(places, corner + 1, share)
        f.bottom_left = place_at(places, corner + row, share)
        f.bottom_right = place_at(places, corner + row + 1, share)
        return f

    @wp.func
    def albedo_at(scene: Scene, like: Sample, footprint: Footprint, texels: int) -> wp.vec3:
        albedo = mean_albedo(scene, like, footprint, texels)
        return wp.vec3(wp.max(albedo[0], DARK), wp.max(albedo[1], DARK), wp.max(albedo[2], DARK))

    @wp.func
    def square_of(scene: Scene, like: Sample, footprint: Footprint) -> wp.vec3:
        """Return `square_shown`, the last number of which is 0 where there is no checkerboard."""
        square = wp.vec3()
        if wp.static(features.checkers):
            texture = scene.materials.textures.rows[scene.materials.rows[like.material - 1].texture]
            if texture.first < 0:
                square = square_shown(texture, footprint)
        return square

    @wp.func
    def coarse_of(start: Footprint, end: Footprint) -> float:
        """Return the share of a step in which a pixel goes about half its width."""
        middle = uv_in(start, 0.5, 0.5)
        right = uv_in(start, 1.0, 0.5) - middle
        down = uv_in(start, 0.5, 1.0) - middle
        way = uv_in(end, 0.5, 0.5) - middle
        area = wp.abs(right[0] * down[1] - right[1] * down[0])
        along = wp.abs(way[0] * down[1] - way[1] * down[0])
        across = wp.abs(way[0] * right[1] - way[1] * right[0])
        # Right and down are half a pixel.
        return area / wp.max(wp.length(wp.vec2(along, across)), 1.0e-20)

    @wp.func
    def value_at(
        scene: Scene, like: Sample, footprint: Footprint, texels: int, start: wp.vec3, change: wp.vec3, share: float
    ) -> float:
        return wp.dot(albedo_at(scene, like, footprint, texels), start + change * share)

    @wp.kernel(module="unique", enable_backward=False, module_options=kernel_options())
    def follow(
        scene: Scene,
        settings: Settings,
        first: int,
        count: int,
        corners: wp.array[Sample],
        places: wp.array2d[wp.vec3],
        pixels: wp.array[int],
        light: wp.array2d[float],
        texels: int,
        least: float,
        late: float,
        longest: float,
        finest: float,
        linear: bool,
        out_counts: wp.array[int],
        out_knots: wp.array2d[wp.vec2],
    ) -> None:
        shares = wp.zeros(shape=wp.static(_DEPTH), dtype=float)
        values = wp.zeros(shape=wp.static(_DEPTH), dtype=float)
        squares = wp.zeros(shape=wp.static(_DEPTH), dtype=wp.vec3)
        row = settings.width + 1
        begin = first + wp.tid() * count
        for number in range(begin, begin + count):
            pixel = pixels[number]
            corner = pixel + pixel // settings.width
            like = corners[corner]
            start = footprint_at(places, corner, row, 0.0)
            end = footprint_at(places, corner, row, 1.0)
            square = square_of(scene, like, start)
            squares[0] = square_of(scene, like, end)
            if square[2] > 0.0 and wp.length_sq(square - squares[0]) == 0.0:
                out_counts[number] = 0
                continue
            lit = wp.vec3(light[0, pixel], light[1, pixel], light[2, pixel])
            change = wp.vec3(light[3, pixel], light[4, pixel], light[5, pixel]) - lit
            coarse = 2.0 * coarse_of(start, end)
            left = float(0.0)
            value = float(value_at(scene, like, start, texels, lit, change, 0.0))
            door = open_door(value, linear)
            out_knots[number, 0] = wp.vec2(0.0, value)
            shares[0] = 1.0
            values[0] = value_at(scene, like, end, texels, lit, change, 1.0)
            knots = int(1)
            still = wp.abs(values[0] - value) <= least * value
            top = int(0)
            while top >= 0:
                right = shares[top]
                there = values[top]
                known = bool(True)
                ratio = wp.abs(wp.log(there / value))
                allowed = wp.max(least, late * ratio / (right - left))
                uniform = square[2] > 0.0 and wp.length_sq(square - squares[top]) == 0.0
                middle = 0.5 * (left + right)
                halfway = float(0.0)
                if not uniform and top < _DEEPEST and right - left > 2.0 * finest:
                    between = footprint_at(places, corner, row, middle)
                    halfway = float(value_at(scene, like, between, texels, lit, change, middle))
                    straight = 0.5 * (value + there)
                    if not linear:
                        straight = wp.sqrt(value * there)
                    off = wp.abs(halfway - straight)
                    if off > _SMOOTH * allowed * halfway or ratio > longest or right - left > coarse:
                        top = top + 1
                        shares[top] = middle
                        values[top] = halfway
                        squares[top] = square_of(scene, like, between)
                        known = False
                if known:
                    for last in range(2):
                        share = wp.where(last == 0, middle, right)
                        at = wp.where(last == 0, halfway, there)
                        if at > 0.0:
                            passing = pass_door(door, share, at, 0.5 * allowed, linear)
                            if passing.shut:
                                knots = knots + 1
                                still = False
                                if knots < _MOST_KNOTS:
                                    out_knots[number, knots - 1] = wp.vec2(door.share, door.value)
                            door = passing
                    left = right
                    value = there
                    square = squares[top]
                    # The end is one more; what needs too many is not followed to it.
                    top = wp.where(knots >= _MOST_KNOTS, -1, top - 1)
            knots = knots + 1
            if knots <= _MOST_KNOTS:
                out_knots[number, knots - 1] = wp.vec2(door.share, door.value)
            out_counts[number] = wp.where(knots > _MOST_KNOTS, -1, wp.where(still, 0, knots))

    return bound, place, follow
