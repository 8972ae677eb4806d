# ruff: noqa: UP018, RUF046
"""Refinement of primary sampling: how many more rays a pixel gets after the first ones.

Shares of a pixel that rays count are somewhat wrong, and so is its brightness where its surfaces differ. That matters
where it may decide about an event. With cached light, and where contrast thresholds are known, a pixel
remembers at what brightness it fired last. The nearer its next event, the more rays count shares. Farther away,
brightness may be wrong by as much as is left to go. Other rays show another brightness: so while camera and lamps
stand, a pixel gets no fewer of them than in the frame before.
"""

import warp as wp

from clsim.render.primary.first_hits import Seen
from clsim.render.primary.ray_numbers import PrimaryRays
from clsim.render.primary.seen_surfaces import MOST_SURFACES
from clsim.render.sampling.sampling import brightness

SHARE_ERROR = wp.constant(0.02)
"""Part of a pixel's brightness by which counted shares may be wrong near an event; beyond, more rays count them."""
_MOST_SURFACES = wp.constant(MOST_SURFACES)
_RAYS_IN_A_CROWD = wp.constant(4)
"""Multiple of the rays that a pixel gets which shows `MOST_SURFACES`."""


@wp.struct
class NextEvent:
    """What an ideal pixel that sees the frames fires at: log brightness is ln max(scale·Y, floor).

    Attributes:
        on, off: contrast thresholds; 0 where nobody knows what the pixels fire at.
        scale, floor: of brightness.
    """

    on: float
    off: float
    scale: float
    floor: float


@wp.func
def level_of(radiance: wp.vec3, event: NextEvent, weights: wp.vec3) -> float:
    """Return the log brightness of a pixel."""
    return wp.log(wp.max(event.scale * brightness(radiance, weights), event.floor))


@wp.func
def error_allowed(level: float, fired: float, event: NextEvent) -> float:
    """Return by which part a pixel's brightness may be wrong, by the level at which it fired last (NaN: never)."""
    allowed = float(SHARE_ERROR)
    if not wp.isnan(fired):
        way = level - fired
        left = wp.where(way > 0.0, event.on, event.off) - wp.abs(way)
        allowed = wp.max(allowed, left)
    return allowed


@wp.func
def fire(level: float, fired: float, event: NextEvent) -> float:
    """Return the level at which a pixel fired last, now that it has come to another one, as the ideal sensor does."""
    after = level
    if not wp.isnan(fired):
        way = level - fired
        step = wp.where(way > 0.0, event.on, -event.off)
        after = fired + wp.trunc(way / step) * step
    return after


@wp.func
def rays_needed(bright: float, squares: float, darkest: float, error: float) -> float:
    """Return how many rays find a pixel's brightness within that part of it.

    ``bright`` is the mean brightness of what the pixel shows, ``squares`` the mean of its square. Below ``darkest``
    relative errors tell nothing. The error of points that are spread evenly falls nearly as their number to the power
    of 3/4.
    """
    spread = wp.sqrt(wp.max(squares - bright * bright, 0.0))
    return wp.pow(spread / (error * wp.max(bright, darkest)), 4.0 / 3.0)


@wp.func
def refine_primary_rays(
    bright: float,
    squares: float,
    darkest: float,
    seen: Seen,
    first: PrimaryRays,
    primary_rays: PrimaryRays,
    error: float,
    told: bool,
    least_rays: int,
) -> PrimaryRays:
    """Return the numbers of rays that a pixel needs after what its first rays saw.

    Args:
        bright: mean brightness of what it shows.
        squares: mean of its square.
        darkest: brightness below which pixels see no difference.
        seen: what was seen by ``primary_rays``.
        first: the first numbers of rays.
        primary_rays: the last ones.
        error: part of the brightness by which it may be wrong.
        told: whether that follows from how near an event is.
        least_rays: that it gets where shares are counted, 0 where it does not matter.
    """
    refined = primary_rays
    if primary_rays.most == first.most and seen.counted:
        needed = rays_needed(bright, squares, darkest, error)
        least = int(0)
        if seen.surfaces == _MOST_SURFACES:
            # There may be more surfaces than were counted, and nobody knows how different they are.
            least = _RAYS_IN_A_CROWD * first.most
        if told:
            # Small surfaces are easily missed.
            least = first.at_event
        needed = wp.max(needed, float(least) * wp.pow(SHARE_ERROR / error, 4.0 / 3.0))
        needed = wp.max(needed, float(least_rays))
        while refined.most < primary_rays.at_contrast and float(refined.most) < needed:
            refined.most = refined.most * 2
    return refined
