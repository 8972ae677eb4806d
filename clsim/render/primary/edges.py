# ruff: noqa: UP018, RUF046, SIM102
"""The straight edge that may cross a pixel: what its corners tell, and the search for where it lies, as Warp functions.

Where corners see two surfaces, the places at which the edge crosses the pixel's border are found by bisection, and the
share of each side is an area in closed form: k rays place a crossing to 2⁻ᵏ of a pixel.
"""

from typing import Any, Literal

import warp as wp

from clsim.render.camera.film import Sample
from clsim.render.native import native_code
from clsim.render.primary.corners import corner_at, corner_near
from clsim.render.primary.lamp_light import same_light, same_share
from clsim.render.primary.seen_surfaces import same_colour, same_surface
from clsim.render.primary.shadow_rays import asks_neighbours
from clsim.render.sampling import sampling

_OFF_LINE_PX = wp.constant(0.05)
"""Distance from a straight edge within which a ray may see the other side [pixels]."""
_WIDE_PX = wp.constant(2.0)
"""What is wider hides between no corners of a pixel, but for its own blunt corners [pixels]."""
_NOWHERE_M = wp.constant(1.0e30)
"""Stands for the distance of what is not hit [m]."""
_AHEAD = wp.constant(8)
"""Pixels ahead of which corners are asked for in memory."""


@wp.func_native(native_code("prefetch.h"))
def _prefetch(array: wp.array[Sample], index: int) -> None: ...


@wp.func
def _alike(a: Sample, b: Sample, by_colour: bool, pixel: wp.vec2) -> bool:
    same = same_surface(a, b, pixel)
    if by_colour and same:
        same = same_colour(a, b)
    return same


@wp.struct
class Edge:
    """The edge in a pixel: what its corners tell, and how far the search has come.

    The edge crosses the pixel's border in some of its four sides, which are searched one after the other by bisection.

    Attributes:
        plain: all corners see the same.
        straight: two surfaces are seen, with an edge in between that is straight as far as one knows.
        varied: a ray inside saw another colour on one side than its corner.
        by_colour: each colour of a surface counts as one.
        flat: all see one surface with a texture.
        alone: all see one triangle, or none.
        whole: nothing is so small that it may hide before that triangle, or all pass by the boxes of objects.
        shaded: direct light reaches a part of one surface; rays inside, and corners next to the pixel's, may tell that
            too.
        second: row of the corners that has the second surface; the first is what the top left corner sees.
        marks: has a bit for each corner that sees the second.
        area: share of the first.
        place, along: a point of the edge, and its direction.
        side: the side of the pixel that is searched, 4 where none is left.
        low, step: the edge lies behind ``low`` and within twice ``step``, as shares of the side from the corner that
            sees the first.
        steps: rays that are to come.
        last: newest corner of the first's area.
    """

    plain: bool
    straight: bool
    varied: bool
    by_colour: bool
    flat: bool
    alone: bool
    whole: bool
    shaded: bool
    marks: int
    rays: int
    second: int
    area: float
    place: wp.vec2
    along: wp.vec2
    side: int
    low: float
    step: float
    steps: int
    crossings: int
    last: wp.vec2


@wp.func
def is_sound(sample: Sample) -> bool:
    """Whether a sample is finite; else it is dropped whole."""
    return sampling.finite(sample.normal) and sampling.finite(sample.emission)


@wp.func
def _cross(a: wp.vec2, b: wp.vec2) -> float:
    return a[0] * b[1] - a[1] * b[0]


@wp.func
def on_side(edge: Edge, share: float) -> wp.vec2:
    """Return a place on the side that is searched, at that share of it from the first's corner."""
    marked = (edge.marks >> edge.side) & 1
    start = corner_at(edge.side + marked)
    return start + (corner_at(edge.side + 1 - marked) - start) * share


@wp.func
def next_side(edge: Edge, side: int, steps: int) -> Edge:
    """Go on to the next side of the pixel that the edge crosses, from that one, along corners that see the first."""
    after = edge
    after.side = 4
    for i in range(side, 4):
        if after.side == 4:
            marked = (after.marks >> i) & 1
            if marked == 0:
                after.area = after.area + 0.5 * _cross(after.last, corner_at(i))
                after.last = corner_at(i)
            if marked != ((after.marks >> ((i + 1) & 3)) & 1):
                after.side = i
    after.low = 0.0
    after.step = 0.5
    after.steps = steps
    return after


@wp.func
def narrow(edge: Edge, sample: Sample, corners: wp.array[Sample], nearest: int, pixel: wp.vec2, steps: int) -> Edge:
    """Halve what is left of a side by a ray to its middle; after the last one, the edge crosses it there.

    The next side gets ``steps`` rays.
    """
    after = edge
    after.rays = after.rays + 1
    if _alike(sample, corners[nearest], after.by_colour, pixel):
        after.low = after.low + after.step
    elif not _alike(sample, corners[after.second], after.by_colour, pixel):
        after.straight = False
    after.steps = after.steps - 1
    if after.steps > 0:
        after.step = 0.5 * after.step
    else:
        place = on_side(after, after.low + 0.5 * after.step)
        after.area = after.area + 0.5 * _cross(after.last, place)
        after.last = place
        if after.crossings == 0:
            after.place = place
        else:
            after.along = place - after.place
        after.crossings = after.crossings + 1
        after = next_side(after, after.side + 1, steps)
    return after


@wp.func
def off_line(through: wp.vec2, along: wp.vec2, place: wp.vec2, first: bool) -> bool:
    """Whether a ray on the first or second side lies on the other side of the edge, by more than a little."""
    away = _cross(along, place - through) / wp.max(wp.length(along), 1.0e-6)
    # The first corner, at 0, is on the first side.
    if (_cross(along, -through) > 0.0) != first:
        away = -away
    return away < -_OFF_LINE_PX


@wp.func
def _is_lit_otherwise_around(corners: wp.array[Sample], nearest: int, row: int, asker: int, pixel: wp.vec2) -> bool:
    """Whether another share of the lamps' light than at ``asker`` reaches its surface at a corner next to the pixel's.

    Each corner asks for one place on one lamp alone. In a soft shadow all four may find theirs free, or none. Where
    none of the lamps that they ask sends light, all of it counts as arriving.
    """
    column = nearest % row
    line = nearest // row
    lit = float(corners[asker].lamp_lit)
    most = float(corners[asker].lamp_all)
    if most <= 0.0:
        lit = 1.0
        most = 1.0
    found = bool(False)
    # As a variable, so that the loop is compiled once and not eight times.
    corners_beside = int(8)
    for k in range(corners_beside):
        place = corner_near(4 + k)
        x = column + place[0]
        y = line + place[1]
        other = y * row + x
        if x >= 0 and x < row and y >= 0 and other < corners.shape[0]:
            if not same_share(corners[other].lamp_lit, corners[other].lamp_all, lit, most):
                found = found or same_surface(corners[other], corners[asker], pixel)
    return found


@wp.func
def _hides_a_speck(
    specks: wp.array[wp.vec4, Literal[2]], instant: int, corners: wp.array[Sample], nearest: int, row: int
) -> bool:
    """Whether a pixel may show something so small that it lies between its corners."""
    eye = wp.vec3(specks[instant, 0][0], specks[instant, 0][1], specks[instant, 0][2])
    ahead = wp.vec3()
    farthest = float(0.0)
    for i in range(4):
        corner = corners[nearest + (i & 1) + (i // 2) * row]
        ahead += wp.normalize(corner.position - eye)
        farthest = wp.max(farthest, wp.where(corner.hit, corner.depth, _NOWHERE_M))
    ahead = wp.normalize(ahead)
    found = bool(False)
    for k in range(1, specks.shape[1]):
        speck = specks[instant, k]
        way = wp.vec3(speck[0], speck[1], speck[2])
        length = wp.length(way)
        off = ahead - way / length
        # What lies behind all that the corners see is not seen.
        before = length * (1.0 - speck[3]) < farthest
        found = found or (before and wp.dot(off, off) < speck[3] * speck[3])
    return found


def make_judge(flat: Any, wide_lamps: bool, scene_type: Any, settings_type: Any) -> Any:
    """Return the Warp function ``judge_corners``, which gives the `Edge` that a pixel's corners tell of.

    Args:
        flat: ``flat(scene, sample) -> bool``: whether a texture tells the albedo of its surface.
        wide_lamps: whether rays ask lamps that have a size, so that shadows are soft.
        scene_type, settings_type: structs of its first two arguments.
    """

    @wp.func
    def judge_corners(
        scene: scene_type,
        settings: settings_type,
        pixel: wp.vec2,
        clear_m: float,
        instant: int,
        corners: wp.array[Sample],
        nearest: int,
        row: int,
    ) -> Edge:
        # The lowest row that is read: those above were read for pixels above.
        _prefetch(corners, wp.min(nearest + 2 * row + _AHEAD, corners.shape[0] - 1))
        edge = Edge()
        edge.side = 4
        edge.rays = 1
        edge.by_colour = True
        first = corners[nearest]
        sound = is_sound(first)
        boxed = bool(first.boxed)
        spread = bool(first.spread)
        colours = int(0)
        third = bool(False)
        one_material = bool(True)
        one_triangle = first.triangle > 0 or not first.hit
        farthest = wp.where(first.hit, first.depth, settings.reach_m)
        asker = int(nearest)
        for i in range(1, 4):
            place = corner_at(i)
            other = nearest + int(place[0]) + int(place[1]) * row
            sample = corners[other]
            sound = sound and is_sound(sample)
            boxed = boxed or sample.boxed
            spread = spread or sample.spread
            one_material = one_material and sample.material == first.material
            one_triangle = one_triangle and sample.triangle == first.triangle and sample.hit == first.hit
            farthest = wp.max(farthest, sample.depth)
            same = same_surface(sample, first, pixel)
            if same and not same_light(sample, corners[asker]):
                edge.shaded = True
            if corners[asker].lamp_all <= 0.0:
                asker = other
            if not same:
                if edge.by_colour:
                    # Colours matter on one surface only.
                    edge.by_colour = False
                    edge.second = other
                    third = False
                elif not same_surface(sample, corners[edge.second], pixel):
                    third = True
                edge.marks = edge.marks | (1 << i)
            elif edge.by_colour and not same_colour(sample, first):
                if colours == 0:
                    edge.second = other
                elif not same_colour(sample, corners[edge.second]):
                    third = True
                colours = colours | (1 << i)
        if edge.by_colour:
            edge.marks = colours
        edge.plain = sound and edge.marks == 0
        edge.flat = sound and edge.by_colour and one_material and flat(scene, first)
        edge.alone = one_triangle
        if wp.static(wide_lamps) or asks_neighbours(scene.lights):
            asked = corners[asker].lamp_all > 0.0 or asks_neighbours(scene.lights)
            if (edge.plain or edge.flat) and not edge.shaded and asked:
                edge.shaded = _is_lit_otherwise_around(corners, nearest, row, asker, pixel)
        # A box that juts out between two corners is mostly empty there: a ray or two inside would see no more of it.
        edge.whole = one_triangle and farthest < clear_m
        edge.whole = edge.whole or (not boxed and settings.least_sphere_rad > _WIDE_PX * pixel[0])
        # Corners that take turns are no straight edge's.
        edge.straight = sound and not edge.flat and not third and edge.marks != 0 and edge.marks != 10
        if settings.specks.shape[0] > 0 and (edge.plain or edge.flat or edge.straight):
            if _hides_a_speck(settings.specks, instant, corners, nearest, row):
                # Corners tell nothing of it: rays inside count its share.
                edge.plain = False
                edge.flat = False
                edge.straight = False
        if spread:
            # Gloss sends each ray elsewhere.
            edge.plain = False
            edge.flat = False
            edge.straight = False
            edge.by_colour = False
        return edge

    return judge_corners
