# Warp: a variable that changes must be born by a call.
# ruff: noqa: UP018, RUF046
"""What a pixel shows: a few things, each with its share of the pixel's area, as Warp functions.

They live in an array of `THINGS` rows that a thread allocates for its pixel; so they are passed without being copied.
"""

import warp as wp

from clsim.frames import rendered_planes
from clsim.render.camera.film import Sample, store3
from clsim.render.camera.pixel_width import width_at
from clsim.render.sampling.sampling import brightness, luminance

THINGS = 8
"""Things of a pixel that are told apart; what else there is counts for the last of them."""
_THINGS = wp.constant(THINGS)
_PLANES = rendered_planes(first_hit_rays=True)
_FIRST = {plane.name: _PLANES.first(plane.name) for plane in _PLANES.planes}
_ALIKE_ALBEDO = wp.constant(0.01)
_ALIKE_EMISSION = wp.constant(0.01)
_ALIKE_NORMAL = wp.constant(0.95)
_OFF_PLANE = wp.constant(0.25)
"""Widths of a pixel by which a surface may leave its tangent plane, beside …"""
_OFF_PLANE_SHARE = wp.constant(0.1)
"""… this share of the distance."""
DARK = wp.constant(1e-3)
"""Albedo is taken for at least so much: even black lacquer reflects."""


@wp.struct
class Thing:
    """A thing that a pixel shows.

    Attributes:
        first: the first ray's sample of it.
        rays: number of rays that count for its means.
        share: its share of the pixel's area.
        albedo, coat, emission, position, normal, depth: sums over these rays, and means in the end; albedo is
            `lit_albedo`, and all but emission are 0 where nothing was hit.
        lamp_all, lamp_lit: sums of what its rays' ways to lamps carry.
        from_lamps: the part of ``emission`` that is light straight from lamps, once that was added.
        rest: as the position, while what is seen rests.
    """

    first: Sample
    rays: float
    share: float
    albedo: wp.vec3
    coat: wp.vec3
    emission: wp.vec3
    position: wp.vec3
    normal: wp.vec3
    depth: float
    lamp_all: float
    lamp_lit: float
    from_lamps: wp.vec3
    rest: wp.vec3


@wp.func
def lit_albedo(sample: Sample) -> wp.vec3:
    """Return the albedo by which radiance may be divided."""
    a = sample.albedo
    return wp.vec3(wp.max(a[0], DARK), wp.max(a[1], DARK), wp.max(a[2], DARK))


@wp.func
def same_surface(a: Sample, b: Sample, pixel: wp.vec2) -> bool:
    """Whether a ray saw the surface of the other one, or neither saw any."""
    same = not a.hit
    if a.hit != b.hit:
        same = False
    elif a.hit:
        apart = a.position - b.position
        off = wp.abs(wp.dot(apart, b.normal))
        near = off < _OFF_PLANE * width_at(pixel, b.depth) + _OFF_PLANE_SHARE * wp.length(apart)
        same = near and wp.dot(a.normal, b.normal) > _ALIKE_NORMAL
    return same


@wp.func
def same_colour(a: Sample, b: Sample) -> bool:
    """Whether two rays saw the same albedo and the same light that is sent out."""
    shine = luminance(b.emission)
    same = wp.abs(luminance(a.emission) - shine) <= _ALIKE_EMISSION * shine + 1.0e-6
    if a.hit and b.hit and wp.length(a.albedo - b.albedo) > _ALIKE_ALBEDO:
        same = False
    return same


@wp.func
def begin_thing(things: wp.array(dtype=Thing), number: int, sample: Sample) -> int:
    """Add a thing, of which no ray counts yet; return the number of things then."""
    if number < _THINGS:
        thing = Thing()
        thing.first = sample
        things[number] = thing
    return wp.min(number + 1, _THINGS)


@wp.func
def find_thing(things: wp.array(dtype=Thing), number: int, sample: Sample, by_colour: bool, pixel: wp.vec2) -> int:
    """Return the thing that a ray saw; −1 for one not seen before, −2 − k for another colour of the surface k."""
    found = int(-1)
    for k in range(number):
        if found < 0:
            first = things[k].first
            if same_surface(sample, first, pixel):
                if not by_colour or same_colour(sample, first):
                    found = k
                elif found == -1:
                    found = -2 - k
    return found


@wp.func
def add_to_thing(things: wp.array(dtype=Thing), k: int, sample: Sample, coats: bool):
    """Let a ray count for the means of a thing; where there are no ``coats``, their sums are not worth their time."""
    things[k].rays += 1.0
    things[k].emission += sample.emission
    things[k].lamp_all += sample.lamp_all
    things[k].lamp_lit += sample.lamp_lit
    if sample.hit:
        things[k].albedo += lit_albedo(sample)
        if coats:
            things[k].coat += sample.coat
        things[k].position += sample.position
        things[k].rest += sample.rest
        things[k].normal += sample.normal
        things[k].depth += sample.depth


@wp.func
def finish_things(things: wp.array(dtype=Thing), number: int, straight: bool, area: float, coats: bool):
    """Turn sums into means; shares are those of the rays, or of the two sides of a straight edge.

    Where no ray counted, there is no more than one thing.
    """
    rays = float(0.0)
    for k in range(number):
        rays += things[k].rays
    for k in range(number):
        mine = things[k].rays
        things[k].share = wp.where(rays > 0.0, mine / wp.max(rays, 1.0), 1.0)
        if straight:
            things[k].share = wp.where(k == 0, area, 1.0 - area)
        if mine > 0.0:
            things[k].emission = things[k].emission / mine
            things[k].albedo = things[k].albedo / mine
            if coats:
                things[k].coat = things[k].coat / mine
            things[k].position = things[k].position / mine
            things[k].rest = things[k].rest / mine
            things[k].normal = things[k].normal / mine
            things[k].depth = things[k].depth / mine
        else:
            # Of a narrow strip, or where no ray looked inside: what the corner saw.
            first = things[k].first
            things[k].emission = first.emission
            if first.hit:
                things[k].albedo = lit_albedo(first)
                if coats:
                    things[k].coat = first.coat
                things[k].position = first.position
                things[k].rest = first.rest
                things[k].normal = first.normal
                things[k].depth = first.depth


@wp.func
def go_on_with_things(things: wp.array(dtype=Thing), number: int):
    """Turn means into sums again, so that more rays may count."""
    for k in range(number):
        mine = things[k].rays
        things[k].emission = (things[k].emission - things[k].from_lamps) * mine
        things[k].from_lamps = wp.vec3()
        things[k].albedo = things[k].albedo * mine
        things[k].coat = things[k].coat * mine
        things[k].position = things[k].position * mine
        things[k].rest = things[k].rest * mine
        things[k].normal = things[k].normal * mine
        things[k].depth = things[k].depth * mine


@wp.func
def covered_by(things: wp.array(dtype=Thing), number: int) -> float:
    """Return the share of the pixel where a surface is seen."""
    covered = float(0.0)
    for k in range(number):
        if things[k].first.hit:
            covered += things[k].share
    return covered


@wp.func
def store_things(
    things: wp.array(dtype=Thing),
    number: int,
    samples: int,
    radiance: wp.vec3,
    weights: wp.vec3,
    pixel: int,
    out_planes: wp.array2d(dtype=float),
):
    """Store all planes; those of surfaces are means over the part of the pixel where one is hit."""
    covered = covered_by(things, number)
    depth = float(0.0)
    albedo = wp.vec3()
    normal = wp.vec3()
    emission = wp.vec3()
    for k in range(number):
        share = things[k].share
        emission += things[k].emission * share
        if things[k].first.hit:
            albedo += things[k].albedo * share
            normal += things[k].normal * share
            depth += things[k].depth * share
    each = 1.0 / wp.max(covered, 1.0e-6)
    store3(out_planes, wp.static(_FIRST["Radiance"]), pixel, radiance)
    store3(out_planes, wp.static(_FIRST["Albedo"]), pixel, albedo * each)
    store3(out_planes, wp.static(_FIRST["Normal"]), pixel, normal * each)
    out_planes[wp.static(_FIRST["Depth"]), pixel] = depth * each
    out_planes[wp.static(_FIRST["Coverage"]), pixel] = covered
    out_planes[wp.static(_FIRST["Samples"]), pixel] = float(samples)
    out_planes[wp.static(_FIRST["Emission"]), pixel] = brightness(emission, weights)
