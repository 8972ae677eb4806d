# ruff: noqa: UP018, RUF046
"""The surfaces that a pixel shows, each with its share of the pixel's area, as Warp functions.

A thread allocates an array of `MOST_SURFACES` rows for its pixel, and passes it without copying. The background counts
as a surface.
"""

import warp as wp

from clsim.frames import rendered_planes
from clsim.render.camera.film import Sample, store3
from clsim.render.camera.pixel_width import width_at
from clsim.render.sampling.sampling import brightness, luminance

MOST_SURFACES = 16
"""Surfaces that a pixel tells from each other; any more count for the last of them."""
_MOST_SURFACES = wp.constant(MOST_SURFACES)
_PLANES = rendered_planes(first_hit_rays=True)
_FIRST = {plane.name: _PLANES.first(plane.name) for plane in _PLANES.planes}
_ALIKE_ALBEDO = wp.constant(0.01)
_ALIKE_EMISSION = wp.constant(0.01)
_ALIKE_NORMAL = wp.constant(0.95)
_OFF_PLANE = wp.constant(0.25)
"""Widths of a pixel by which a surface may leave its tangent plane, in addition to …"""
_OFF_PLANE_SHARE = wp.constant(0.1)
"""… this share of the distance."""
_NOWHERE_M = wp.constant(1.0e30)
"""Farther than all there is [m]."""
_NEAR = wp.constant(0.2)
"""Part of the way to where a ray ended, within which light is much the same: in gloss a pixel shows a whole wall."""
DARK = wp.constant(1e-3)
"""Albedo is taken for at least so much: even black lacquer reflects."""


@wp.struct
class SeenSurface:
    """A surface that a pixel shows, or the background; on one surface, a colour may count as one.

    Attributes:
        first: the first ray's sample of it.
        rays: number of rays that count for its means.
        share: its share of the pixel's area.
        albedo, coat, passing, emission, position, normal, depth: sums over these rays, and means in the end; albedo is
            `lit_albedo`, and all but emission are 0 where nothing was hit.
        lamp_all, lamp_lit: sums of what its rays' ways to lamps carry.
        coat_all, coat_lit: sums of what of that the coat reflects.
        from_lamps: the part of ``emission`` that is direct light, once that was added.
        rest: as the position, while what is seen rests.
        squares: mean of the squares of what its rays found of ``emission``, in luminance, where gloss shows it.
    """

    first: Sample
    rays: float
    share: float
    albedo: wp.vec3
    coat: wp.vec3
    passing: float
    emission: wp.vec3
    position: wp.vec3
    normal: wp.vec3
    depth: float
    lamp_all: float
    lamp_lit: float
    coat_all: float
    coat_lit: float
    from_lamps: wp.vec3
    rest: wp.vec3
    squares: float


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
        offset = a.position - b.position
        off = wp.abs(wp.dot(offset, b.normal))
        near = off < _OFF_PLANE * width_at(pixel, b.depth) + _OFF_PLANE_SHARE * wp.length(offset)
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
def begin_surface(surfaces: wp.array[SeenSurface], number: int, sample: Sample) -> int:
    """Add a surface for which no ray counts yet; return the number of surfaces then."""
    if number < _MOST_SURFACES:
        surface = SeenSurface()
        surface.first = sample
        surfaces[number] = surface
    return wp.min(number + 1, _MOST_SURFACES)


@wp.func
def _squared(light: wp.vec3) -> float:
    bright = luminance(light)
    return bright * bright


@wp.func
def variance_of(surface: SeenSurface) -> float:
    """Return the variance of the luminance that the rays found of a surface's emission where gloss shows it, else 0."""
    found = float(0.0)
    if surface.first.spread:
        found = wp.max(surface.squares - _squared(surface.emission - surface.from_lamps), 0.0)
    return found


@wp.func
def _find_nearest(surfaces: wp.array[SeenSurface], number: int, sample: Sample, pixel: wp.vec2) -> int:
    """Return the nearest part of the surface that a ray hit by way of gloss, −1 for one that is not near any."""
    found = int(-1)
    least = _NEAR * sample.depth
    if number == _MOST_SURFACES:
        least = _NOWHERE_M
    for k in range(number):
        off = wp.length(sample.position - surfaces[k].first.position)
        if off < least and surfaces[k].first.spread and same_surface(sample, surfaces[k].first, pixel):
            least = off
            found = k
    return found


@wp.func
def find_surface(surfaces: wp.array[SeenSurface], number: int, sample: Sample, by_colour: bool, pixel: wp.vec2) -> int:
    """Return the surface that a ray hit; −1 for one not seen before, −2 − k for another colour of the surface k."""
    found = int(-1)
    if sample.spread and sample.hit:
        found = _find_nearest(surfaces, number, sample, pixel)
        number = 0
    for k in range(number):
        if found < 0:
            first = surfaces[k].first
            if same_surface(sample, first, pixel):
                if not by_colour or same_colour(sample, first):
                    found = k
                elif found == -1:
                    found = -2 - k
    return found


@wp.func
def add_to_surface(surfaces: wp.array[SeenSurface], k: int, sample: Sample, coats: bool) -> None:
    """Add a ray to the sums of a surface; where there are no ``coats``, theirs are not worth their time."""
    surfaces[k].rays += 1.0
    surfaces[k].emission += sample.emission
    if sample.spread:
        surfaces[k].squares += _squared(sample.emission)
    surfaces[k].lamp_all += sample.lamp_all
    surfaces[k].lamp_lit += sample.lamp_lit
    if coats:
        surfaces[k].coat_all += sample.coat_all
        surfaces[k].coat_lit += sample.coat_lit
    if sample.hit:
        surfaces[k].albedo += lit_albedo(sample)
        if coats:
            surfaces[k].coat += sample.coat
            surfaces[k].passing += sample.passing
        surfaces[k].position += sample.position
        surfaces[k].rest += sample.rest
        surfaces[k].normal += sample.normal
        surfaces[k].depth += sample.depth


@wp.func
def finish_surfaces(surfaces: wp.array[SeenSurface], number: int, straight: bool, area: float, coats: bool) -> None:
    """Turn sums into means; shares are those of the rays, or of the two sides of a straight edge.

    Where no ray counted, there is no more than one surface.
    """
    rays = float(0.0)
    for k in range(number):
        rays += surfaces[k].rays
    for k in range(number):
        mine = surfaces[k].rays
        surfaces[k].share = wp.where(rays > 0.0, mine / wp.max(rays, 1.0), 1.0)
        if straight:
            surfaces[k].share = wp.where(k == 0, area, 1.0 - area)
        if mine > 0.0:
            surfaces[k].emission = surfaces[k].emission / mine
            surfaces[k].squares = surfaces[k].squares / mine
            surfaces[k].albedo = surfaces[k].albedo / mine
            if coats:
                surfaces[k].coat = surfaces[k].coat / mine
                surfaces[k].passing = surfaces[k].passing / mine
            surfaces[k].position = surfaces[k].position / mine
            surfaces[k].rest = surfaces[k].rest / mine
            surfaces[k].normal = surfaces[k].normal / mine
            surfaces[k].depth = surfaces[k].depth / mine
        else:
            # Of a narrow strip, or where no ray was inside: what the corner saw.
            first = surfaces[k].first
            surfaces[k].emission = first.emission
            surfaces[k].squares = _squared(first.emission)
            if first.hit:
                surfaces[k].albedo = lit_albedo(first)
                if coats:
                    surfaces[k].coat = first.coat
                    surfaces[k].passing = first.passing
                surfaces[k].position = first.position
                surfaces[k].rest = first.rest
                surfaces[k].normal = first.normal
                surfaces[k].depth = first.depth


@wp.func
def resume_surfaces(surfaces: wp.array[SeenSurface], number: int) -> None:
    """Turn means into sums again, so that more rays may count."""
    for k in range(number):
        mine = surfaces[k].rays
        surfaces[k].emission = (surfaces[k].emission - surfaces[k].from_lamps) * mine
        surfaces[k].from_lamps = wp.vec3()
        surfaces[k].squares = surfaces[k].squares * mine
        surfaces[k].albedo = surfaces[k].albedo * mine
        surfaces[k].coat = surfaces[k].coat * mine
        surfaces[k].passing = surfaces[k].passing * mine
        surfaces[k].position = surfaces[k].position * mine
        surfaces[k].rest = surfaces[k].rest * mine
        surfaces[k].normal = surfaces[k].normal * mine
        surfaces[k].depth = surfaces[k].depth * mine


@wp.func
def covered_by(surfaces: wp.array[SeenSurface], number: int) -> float:
    """Return the share of the pixel where a surface is seen."""
    covered = float(0.0)
    for k in range(number):
        if surfaces[k].first.hit:
            covered += surfaces[k].share
    return covered


@wp.func
def store_surfaces(
    surfaces: wp.array[SeenSurface],
    number: int,
    samples: int,
    radiance: wp.vec3,
    weights: wp.vec3,
    pixel: int,
    out_planes: wp.array2d[float],
) -> None:
    """Store all planes; those of surfaces are means over the part of the pixel where one is hit."""
    covered = covered_by(surfaces, number)
    depth = float(0.0)
    albedo = wp.vec3()
    normal = wp.vec3()
    emission = wp.vec3()
    for k in range(number):
        share = surfaces[k].share
        emission += surfaces[k].emission * share
        if surfaces[k].first.hit:
            albedo += surfaces[k].albedo * share
            normal += surfaces[k].normal * share
            depth += surfaces[k].depth * share
    each = 1.0 / wp.max(covered, 1.0e-6)
    store3(out_planes, wp.static(_FIRST["Radiance"]), pixel, radiance)
    store3(out_planes, wp.static(_FIRST["Albedo"]), pixel, albedo * each)
    store3(out_planes, wp.static(_FIRST["Normal"]), pixel, normal * each)
    out_planes[wp.static(_FIRST["Depth"]), pixel] = depth * each
    out_planes[wp.static(_FIRST["Coverage"]), pixel] = covered
    out_planes[wp.static(_FIRST["Samples"]), pixel] = float(samples)
    out_planes[wp.static(_FIRST["Emission"]), pixel] = brightness(emission, weights)
