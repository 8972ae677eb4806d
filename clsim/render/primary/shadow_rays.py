"""Shadow rays of pixels in soft shadows: which reach the lamps, remembered from frame to frame, as Warp functions.

Such a pixel shows one triangle, and each of its rays has the same place in the pixel and on a lamp in every frame.
While the camera goes on by a pixel, most of them stay lit, or stay dark. So between two frames only those rays are
traced that differ in these; the others' part of the light is taken for a line in time.
"""

import warp as wp

MOST_TOLD = wp.constant(64)
"""Rays at most of which it is told whether they reach the lamps: so many bits there are."""


@wp.struct
class Shadow:
    """What a pixel's rays found of the lamps in a frame.

    Attributes:
        triangle: number of the one that the pixel shows; 0 where nothing is told.
        rays: how many asked.
        lit_rays: bit i is set if ray i reached a lamp.
        lamp_all, lamp_lit: sums of what their ways to lamps carry, if nothing stood between, and as it is.
    """

    triangle: int
    rays: int
    lit_rays: wp.uint64
    lamp_all: float
    lamp_lit: float


@wp.struct
class Shadows:
    """What a pixel's rays found in the frames before and after a time, and the share of the way between that passed."""

    before: Shadow
    after: Shadow
    share: float


@wp.func
def bit_of(bits: wp.uint64, ray: int) -> float:
    """Return 1 if a ray reached a lamp, else 0."""
    return float((bits >> wp.uint64(ray)) & wp.uint64(1))  # type: ignore[operator]


@wp.func
def are_told(shadows: Shadows, triangle: int) -> bool:
    """Whether both frames tell of the triangle that a pixel shows, by the same rays."""
    a = shadows.before
    b = shadows.after
    return a.triangle > 0 and a.rays > 0 and a.triangle == triangle and b.triangle == triangle and a.rays == b.rays


@wp.func
def next_that_differs(shadows: Shadows, ray: int) -> int:
    """Return the first ray from that one on that reached a lamp in one frame alone; how many there are if none did."""
    differ = shadows.before.lit_rays ^ shadows.after.lit_rays  # type: ignore[operator]
    found = int(ray)
    while found < shadows.before.rays and bit_of(differ, found) == 0.0:
        found = found + 1
    return found


@wp.func
def straight(shadows: Shadows, before: float, after: float) -> float:
    """Return what lies on the line between two values, at the share of the time that has passed."""
    return before + (after - before) * shadows.share


@wp.func
def off_straight(shadows: Shadows, ray: int, lamp_all: float, lamp_lit: float) -> float:
    """Return by how much more light a ray found than lies on the line between its frames."""
    before = bit_of(shadows.before.lit_rays, ray)
    return lamp_lit - lamp_all * straight(shadows, before, bit_of(shadows.after.lit_rays, ray))
