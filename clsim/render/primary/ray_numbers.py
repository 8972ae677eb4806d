"""How many primary rays a pixel gets, by what it shows, as Warp functions."""

import warp as wp

from clsim.render.primary.edges import Edge

_COUNTED = wp.constant(8)
"""Rays that count shares at least, if there are so many, whatever the search for a straight edge took."""


@wp.struct
class PrimaryRays:
    """The numbers of primary rays that a pixel gets, by what it shows.

    Attributes:
        most: largest number.
        inside: rays inside a pixel that shows one surface.
        by_edge: rays inside a pixel that a straight edge crosses, where each side has one colour.
        steps: rays that place each crossing of an edge; 0 counts shares without rays at corners.
        in_shadow: largest number where lamps light a part of what is seen.
        texels: places on a flat surface at which its texture is looked up.
        pixel: how wide a pixel is (`pixel_width.py`).
        at_contrast: largest number where surfaces are of very different brightness; up to ``most`` for no more.
        at_event: largest number near an event, where shares are counted.
    """

    most: int
    inside: int
    by_edge: int
    steps: int
    in_shadow: int
    texels: int
    pixel: wp.vec2
    at_contrast: int
    at_event: int


@wp.func
def wanted_inside(edge: Edge, primary_rays: PrimaryRays) -> int:
    """Return how many rays a pixel gets inside, by what is known of it so far."""
    wanted = wp.max(primary_rays.most - edge.rays, _COUNTED)
    if edge.plain or edge.flat:
        wanted = wp.where(edge.whole, 0, primary_rays.inside)
    if edge.straight and not edge.varied:
        wanted = primary_rays.by_edge
    wanted = wp.min(wanted, primary_rays.most)
    if edge.shaded:
        wanted = wp.max(wanted, primary_rays.in_shadow - edge.rays)
    return wanted  # type: ignore[no-any-return]


@wp.func
def primary_in_shadow(primary_rays: PrimaryRays) -> int:
    """Return how many rays inside a pixel in soft shadow are primary ones: something small may lie between corners."""
    return int(wp.max(primary_rays.inside, primary_rays.in_shadow // 4))
