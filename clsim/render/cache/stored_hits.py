# ruff: noqa: SIM102, UP018, RUF046
"""What pixels saw in the last frame, for a camera that stands: where nothing has moved in the way, it is seen again.

A pixel's primary rays have the same random numbers in every frame. So they, and their shadow rays, find what they
found, unless they lead through a box of what has moved. Its light alone is looked up again.
"""

import warp as wp

from clsim.render.cache.trails import Moved
from clsim.render.camera.film import Sample
from clsim.render.primary.first_hits import Reach, Seen
from clsim.render.primary.seen_surfaces import SeenSurface
from clsim.render.primary.shadow_rays import Shadow

MOST_STORED = 8
"""Surfaces of a pixel that are stored at most; pixels that show more are few, and sampled in every frame."""
_MOST_STORED = wp.constant(MOST_STORED)
_STEEP = wp.constant(1.0e-20)
"""Change along a way that counts as none."""


@wp.struct
class StoredSurface:
    """What is needed of a `SeenSurface`, and of its first sample, once light is looked up."""

    share: float
    albedo: wp.vec3
    coat: wp.vec3
    emission: wp.vec3
    rest: wp.vec3
    normal: wp.vec3
    depth: float
    first_rest_normal: wp.vec3
    first_depth: float
    instance: int
    hit: bool
    lamp: bool


@wp.struct
class StoredPixel:
    """What is needed of a `Seen`.

    Attributes:
        surfaces: how many there are; 0 where nothing is stored.
        rays: how many it took.
        counted: whether shares are counted by them.
        most: rays that it might get in the light of that frame.
        shadow: see there.
        reach: where its rays led.
        asked: whether shadow rays start there.
    """

    surfaces: int
    rays: int
    counted: bool
    most: int
    shadow: Shadow
    reach: Reach
    asked: bool


@wp.struct
class StoredHits:
    """The pixels of the last frame.

    Attributes:
        reads: whether they may be seen again: nothing has changed but what has ``moved``.
        writes: whether they are stored.
        moved: boxes around what has moved since then.
        eye: where the camera stands.
        lamps: number of the lamps to which shadow rays lead.
        lamp_lower, lamp_upper: boxes around these, or how far away they are in which direction.
        lamp_is_far: which of both.
        pixels: one each.
        surfaces: `MOST_STORED` of each pixel.
    """

    reads: bool
    writes: bool
    moved: Moved
    eye: wp.vec3
    lamps: int
    lamp_lower: wp.array[wp.vec3]
    lamp_upper: wp.array[wp.vec3]
    lamp_is_far: wp.array[bool]
    pixels: wp.array[StoredPixel]
    surfaces: wp.array2d[StoredSurface]


@wp.func
def _meets(
    from_lower: wp.vec3, from_upper: wp.vec3, to_lower: wp.vec3, to_upper: wp.vec3, lower: wp.vec3, upper: wp.vec3
) -> bool:
    """Whether a box meets the third one on its way from the first to the second, to which it grows or shrinks."""
    enters = float(0.0)
    leaves = float(1.0)
    for c in range(3):
        for side in range(2):
            # Where this is above 0 the boxes are apart, at the start and by how much more at the end.
            apart = wp.where(side == 0, from_lower[c] - upper[c], lower[c] - from_upper[c])
            more = wp.where(side == 0, to_lower[c] - from_lower[c], from_upper[c] - to_upper[c])
            if wp.abs(more) < _STEEP:
                if apart > 0.0:
                    return False
            elif more > 0.0:
                leaves = wp.min(leaves, -apart / more)
            else:
                enters = wp.max(enters, -apart / more)
    return enters <= leaves


@wp.func
def _meets_moved(moved: Moved, from_lower: wp.vec3, from_upper: wp.vec3, to_lower: wp.vec3, to_upper: wp.vec3) -> bool:
    """Whether ways between places in two boxes may lead through what has moved."""
    near = wp.bvh_query_aabb(moved.tree, wp.min(from_lower, to_lower), wp.max(from_upper, to_upper))
    box = int(0)
    while wp.bvh_query_next(near, box):
        if moved.counts[box]:
            if _meets(from_lower, from_upper, to_lower, to_upper, moved.lowers[box], moved.uppers[box]):
                return True
    return False


@wp.func
def _is_in_the_way(stored: StoredHits, lower: wp.vec3, upper: wp.vec3, asked: bool) -> bool:
    """Whether something has moved between the camera and places in a box, or, if these ``asked``, lamps and these."""
    if _meets_moved(stored.moved, stored.eye, stored.eye, lower, upper):
        return True
    if asked:
        for i in range(stored.lamps):
            from_lower = stored.lamp_lower[i]
            from_upper = stored.lamp_upper[i]
            if stored.lamp_is_far[i]:
                from_lower = from_lower + lower
                from_upper = from_upper + upper
            if _meets_moved(stored.moved, from_lower, from_upper, lower, upper):
                return True
    return False


@wp.func
def corner_stays(stored: StoredHits, corner: Sample) -> bool:
    """Whether the ray through a corner, and its shadow ray, find what they found."""
    if not stored.reads or corner.bent:
        return False
    return not stored.moved.any or not _is_in_the_way(stored, corner.position, corner.position, corner.reach_m > 0.0)


@wp.func
def pixel_stays(stored: StoredHits, pixel: int) -> bool:
    """Whether the rays of a pixel are stored, and find what they found."""
    if not stored.reads or stored.pixels[pixel].surfaces == 0:
        return False
    if not stored.moved.any:
        return True
    reach = stored.pixels[pixel].reach
    if reach.hit and _is_in_the_way(stored, reach.lower, reach.upper, stored.pixels[pixel].asked):
        return False
    return not reach.sky or not _is_in_the_way(stored, reach.sky_lower, reach.sky_upper, False)


@wp.func
def stored_surfaces(stored: StoredHits, pixel: int, surfaces: wp.array[SeenSurface]) -> Seen:
    """Fill the surfaces that a pixel showed, and return the rest."""
    known = stored.pixels[pixel]
    for k in range(known.surfaces):
        told = stored.surfaces[pixel, k]
        surface = SeenSurface()
        surface.share = told.share
        surface.albedo = told.albedo
        surface.coat = told.coat
        surface.emission = told.emission
        surface.rest = told.rest
        surface.normal = told.normal
        surface.depth = told.depth
        surface.first.rest_normal = told.first_rest_normal
        surface.first.depth = told.first_depth
        surface.first.instance = told.instance
        surface.first.hit = told.hit
        surface.first.lamp = told.lamp
        surfaces[k] = surface
    seen = Seen()
    seen.surfaces = known.surfaces
    seen.rays = known.rays
    seen.counted = known.counted
    seen.shadow = known.shadow
    return seen


@wp.func
def store_hits(stored: StoredHits, pixel: int, seen: Seen, most: int, surfaces: wp.array[SeenSurface]) -> None:
    """Store what a pixel showed, where it might be ``most`` rays; of what mirrors showed, and of crowds, nothing."""
    known = StoredPixel()
    if seen.surfaces <= _MOST_STORED and not seen.reach.bent:
        known.surfaces = seen.surfaces
        known.rays = seen.rays
        known.counted = seen.counted
        known.most = most
        known.shadow = seen.shadow
        known.reach = seen.reach
        for k in range(seen.surfaces):
            first = surfaces[k].first
            told = StoredSurface()
            told.share = surfaces[k].share
            told.albedo = surfaces[k].albedo
            told.coat = surfaces[k].coat
            told.emission = surfaces[k].emission
            told.rest = surfaces[k].rest
            told.normal = surfaces[k].normal
            told.depth = surfaces[k].depth
            told.first_rest_normal = first.rest_normal
            told.first_depth = first.depth
            told.instance = first.instance
            told.hit = first.hit
            told.lamp = first.lamp
            stored.surfaces[pixel, k] = told
            known.asked = known.asked or first.lamp
    stored.pixels[pixel] = known
