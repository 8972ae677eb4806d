"""The limit of a stored path: how bright it may be before it counts as rare luck.

Where light comes through a window, or by way of a mirror, a few of a cell's paths find nearly all of it. When one of
them is traced again and finds nothing, light would seem to have changed on a whole wall. So a path counts up to a
multiple of the light around. What is beyond counts only where light has become much brighter: where many paths of the
cell find as much, or next to all light is beyond the limits.

That leaves brightness as it is: limits hold for what paths find now, and for what they would find if light had not
changed, and the ratio of both is the factor by which it has (`stored_paths.py`). Where lamps change their brightness,
all paths find more or less at once, and there are no limits.
"""

import warp as wp

from clsim.render.cache.light_cache import Cell, bright_of
from clsim.render.cache.light_grid import add_shared

UNIT = wp.constant(4294967296.0)
"""Of sums, which are of whole numbers."""
_LARGEST = wp.constant(65536.0)
_LIMIT = wp.constant(10.0)
"""Multiple of the light around up to which a path counts by itself: of 64 paths, none is then more than a sixth."""
NO_LIMIT = wp.constant(1.0e20)
_ENOUGH_AROUND = wp.constant(12.0)
"""Paths from which on their cell tells how bright the light around is."""
_FEW, _MANY = wp.constant(0.1), wp.constant(0.3)
"""Where this part of a cell's paths is beyond, what is beyond counts not at all, or in full: a door stands open …"""
_LITTLE, _MUCH = wp.constant(8.0), wp.constant(32.0)
"""… and so it does where it is so many times all that is within limits: a shutter has opened to the sky."""


@wp.func
def limit_of(around: Cell) -> float:
    """Return up to which brightness a path counts by itself."""
    limit = float(NO_LIMIT)
    if around.count >= _ENOUGH_AROUND:
        limit = _LIMIT * bright_of(around.light)
    return limit


@wp.func
def whole(value: float) -> wp.int64:
    """Return a value as a whole number of the parts in which sums are made."""
    return wp.int64(wp.clamp(value, 0.0, _LARGEST) * UNIT)


@wp.func
def beyond_limit(light: wp.vec3, limit: float) -> wp.vec4:
    """Return what of a path's light is beyond its limit, and which part of a path that is: 1 from twice that on."""
    beyond = wp.vec4()
    bright = bright_of(light)
    if bright > limit:
        over = light * (1.0 - limit / bright)
        beyond = wp.vec4(over[0], over[1], over[2], wp.min((bright - limit) / wp.max(limit, 1.0e-20), 1.0))
    return beyond


@wp.func
def add_beyond(sums: wp.array2d[wp.int64], row: int, first: int, beyond: wp.vec4, sign: wp.int64) -> None:
    """Add that to a cell's sums, to the field ``first`` and the three after it."""
    if beyond[3] > 0.0:
        for field in range(4):
            add_shared(sums, row, first + field, sign * whole(beyond[field]))


@wp.func
def _ramp(value: float, begins: float, ends: float) -> float:
    return wp.clamp((value - begins) / (ends - begins), 0.0, 1.0)


@wp.func
def counted_of(sums: wp.array2d[wp.int64], row: int, first: int, beyond: int, left_out: float) -> wp.vec3:
    """Return the sum of what the paths of a cell find, without that part of what is beyond their limits.

    ``first`` and ``beyond`` are the first fields of both.
    """
    counted = wp.vec3()
    for c in range(3):
        counted[c] = wp.max(float(sums[row, first + c]) - left_out * float(sums[row, beyond + c]), 0.0)
    return counted


@wp.func
def left_out_of(sums: wp.array2d[wp.int64], row: int, count: float, first: int, beyond: int) -> float:
    """Return which part of what is beyond the limits of a cell's ``count`` paths does not count."""
    within = bright_of(counted_of(sums, row, first, beyond, 1.0))
    luck = float(sums[row, beyond]) + float(sums[row, beyond + 1]) + float(sums[row, beyond + 2])
    paths = float(sums[row, beyond + 3]) / (UNIT * count)
    times = luck / (3.0 * wp.max(within, 1.0))
    return 1.0 - wp.max(_ramp(paths, _FEW, _MANY), _ramp(times, _LITTLE, _MUCH))
