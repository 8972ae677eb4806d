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
def beyond_limit(bright: float, limit: float) -> wp.vec2:
    """Return what of a path's brightness is beyond its limit, and which part of a path that is: 1 from twice on."""
    beyond = wp.max(bright - limit, 0.0)
    return wp.vec2(beyond, wp.where(beyond > 0.0, wp.min(beyond / wp.max(limit, 1.0e-20), 1.0), 0.0))


@wp.func
def add_beyond(sums: wp.array2d[wp.int64], row: int, field: int, beyond: wp.vec2, sign: wp.int64) -> None:
    """Add what is beyond a path's limit, and which part of a path, to a cell's sums from ``field`` on."""
    if beyond[0] > 0.0:
        wp.atomic_add(sums, row, field, sign * whole(beyond[0]))
        wp.atomic_add(sums, row, field + 1, sign * whole(beyond[1]))


@wp.func
def _ramp(value: float, begins: float, ends: float) -> float:
    return wp.clamp((value - begins) / (ends - begins), 0.0, 1.0)


@wp.func
def counted_of(sums: wp.array2d[wp.int64], row: int, count: float, first: int, beyond: int) -> wp.vec2:
    """Return which part of what the ``count`` paths of a cell find counts, and which is within their limits.

    ``first`` and ``beyond`` are the first fields of what they find, and of what of it is beyond.
    """
    total = (float(sums[row, first]) + float(sums[row, first + 1]) + float(sums[row, first + 2])) / 3.0
    left_out = wp.min(float(sums[row, beyond]), total)
    counted = wp.vec2(1.0, 1.0)
    if left_out > 0.0:
        paths = float(sums[row, beyond + 1]) / (UNIT * count)
        times = left_out / wp.max(total - left_out, 1.0)
        agreed = wp.max(_ramp(paths, _FEW, _MANY), _ramp(times, _LITTLE, _MUCH))
        counted = wp.vec2(1.0 - (1.0 - agreed) * left_out / total, 1.0 - left_out / total)
    return counted
