# Warp: a variable that changes must be born by a call.
# ruff: noqa: UP018, RUF046
"""What a pixel shows in the light that is kept on surfaces (`light_cache.py`), as Warp functions.

To know the light better is no event. So what a pixel has learnt since its first frame is taken off its brightness
again: R, G and B change as the light does, in the light as it was known first, and are off by as much as that was.
"""

import warp as wp

from clsim.render.cache.light_cache import Asked, Cell, Followed, Kept, look_up
from clsim.render.cache.light_grid import layer_of
from clsim.render.camera.film import Sample
from clsim.render.camera.pixel_width import width_at
from clsim.render.primary.closer_look import NextEvent
from clsim.render.primary.first_hits import Looks
from clsim.render.primary.things import Thing
from clsim.render.sampling.sampling import brightness

_LEAST = wp.constant(0.1)
"""Part of what it shows that a pixel shows at least, however wrong its light may be."""
_DARKEST = wp.constant(1.0e-4)
"""Luminance below which there is nothing to learn: as a detector's floor."""
_LARGEST_GAIN = wp.constant(8.0)
"""Change of log luminance that a frame may learn: what seemed black, as no path had found light, may be bright."""
_CLOSE = wp.constant(0.5)
"""Widths of a pixel within which first hits of one surface have the same light."""
_ALL = wp.constant(1.0e30)
"""More paths than there are."""
_SAME_NORMAL = wp.constant(0.98)


@wp.struct
class Gathering:
    """How a frame is made.

    Attributes:
        looks: first-hit rays of a pixel; none where nobody will see the frame, and all trace their paths.
        probe: paths of a pixel whose light is known.
        every: a pixel whose light is known traces them in each so many-th frame, in turn with its neighbours.
        turn: number of the frame.
        known, finely: where so many paths tell of the light, and so many in the finest cells where light straight from
            lamps is kept, the probe will do.
        asked: which cells are asked for the light, and the update whose gain is no event.
        earlier: whether the light is shown as it was known before that update.
        lamps: whether light straight from lamps is found apart, but for what is glossy.
        tells_shadows: whether it is told which rays reach the lamps.
        cell: how wide the finest cells are, as a pixel is (`pixel_width.py`); they are no wider than that.
        anchored: whether cells lie on what moves.
        event: what pixels fire at, unless this is no frame that is seen, or is shown as it was known ``earlier``.
    """

    looks: Looks
    probe: int
    every: int
    turn: int
    known: float
    finely: float
    asked: Asked
    earlier: bool
    lamps: bool
    tells_shadows: bool
    cell: wp.vec2
    anchored: bool
    event: NextEvent


@wp.struct
class Lit:
    """Sums over what a pixel shows: light sent out and reflected, the latter as known before, and what is dark as yet.

    ``covered`` is the share of the pixel where a surface is seen, ``before`` the luminance of ``earlier``.
    ``brightness`` and ``squares`` are means over the pixel of the luminance of things and of its square.
    ``unlit`` is the albedo of what nothing is known of, ``unlit_before`` of what nothing was; ``known`` is the least.
    ``off`` and ``off_before`` are by how much the luminance of the light might be wrong, now and before, as in `Kept`.
    ``from_lamps`` is the share of the pixel where light straight from lamps is kept, and ``finely`` the number of paths
    that tell of it in the finest cells, times that share.
    """

    covered: float
    emission: wp.vec3
    light: wp.vec3
    earlier: wp.vec3
    before: float
    unlit: wp.vec3
    unlit_before: wp.vec3
    known: float
    off: float
    off_before: float
    from_lamps: float
    finely: float
    brightness: float
    squares: float


@wp.func
def is_smooth(sample: Sample, gathering: Gathering) -> bool:
    """Whether light that is kept for a surface changes slowly from place to place: none comes straight from lamps.

    It counts as smooth on plastics too, where finer cells took a twentieth more time in a room and gained nothing.
    """
    return gathering.lamps and (sample.lamp or sample.coat[0] > 0.0)


@wp.func
def light_of(
    cells: wp.array(dtype=Cell),
    followed: wp.array(dtype=Followed),
    things: wp.array(dtype=Thing),
    number: int,
    gathering: Gathering,
    weights: wp.vec3,
) -> Lit:
    """Look up the light of each thing that a pixel shows, in the middle of what it shows of it."""
    s = Lit()
    s.known = _ALL
    kept = Kept()
    at = wp.vec3()
    facing = wp.vec3()
    looked_in = int(-1)
    looked_on = int(-1)
    looked_for_smooth = bool(False)
    for k in range(number):
        first = things[k].first
        radiance = things[k].emission
        s.emission += radiance * things[k].share
        if first.hit:
            footprint_m = width_at(gathering.looks.pixel, first.depth)
            place = things[k].position
            normal = first.normal
            instance = int(-1)
            if gathering.anchored:
                place = things[k].rest
                normal = first.rest_normal
                instance = first.instance
            apart_m = wp.length(place - at)
            s.covered += things[k].share
            smooth = is_smooth(first, gathering)
            s.from_lamps += wp.where(smooth, 0.0, things[k].share)
            # What lies below the coat, and then the coat.
            for in_coat in range(wp.where(things[k].coat[0] > 0.0, 2, 1)):
                whole = things[k].albedo
                if in_coat == 1:
                    whole = things[k].coat
                apart = apart_m > _CLOSE * footprint_m or wp.dot(normal, facing) < _SAME_NORMAL
                apart = apart or instance != looked_on
                if apart or in_coat != looked_in or smooth != looked_for_smooth:
                    at = place
                    facing = normal
                    looked_on = instance
                    looked_in = in_coat
                    looked_for_smooth = smooth
                    width_m = width_at(gathering.cell, first.depth)
                    layer = layer_of(in_coat, instance)
                    kept = look_up(cells, followed, gathering.asked, at, facing, layer, smooth, width_m)
                s.known = wp.min(s.known, kept.known)
                if in_coat == 0 and not smooth:
                    s.finely += kept.finely * things[k].share
                albedo = whole * things[k].share
                reflected = wp.cw_mul(albedo, kept.light)
                radiance += wp.cw_mul(whole, kept.light)
                if kept.known > 0.0:
                    s.light += reflected
                    if gathering.asked.tells_error:
                        s.off += brightness(reflected, weights) * kept.off
                else:
                    s.unlit += albedo
                if kept.known_before:
                    earlier = wp.cw_mul(albedo, kept.before)
                    s.earlier += earlier
                    s.before += brightness(earlier, weights)
                    if gathering.asked.tells_error:
                        s.off_before += brightness(earlier, weights) * kept.off_before
                else:
                    s.unlit_before += albedo
                    s.off_before += brightness(reflected, weights) * kept.off
        luminance = brightness(radiance, weights)
        s.brightness += luminance * things[k].share
        s.squares += luminance * luminance * things[k].share
    return s


@wp.func
def finished(lit: Lit, own: wp.vec3, own_before: wp.vec3, weights: wp.vec3) -> Lit:
    """Return the sums with a pixel's own light where no cell knows any."""
    s = lit
    s.light += wp.cw_mul(s.unlit, own)
    earlier = wp.cw_mul(s.unlit_before, own)
    if brightness(own_before, weights) > 0.0:
        earlier = wp.cw_mul(s.unlit_before, own_before)
    s.earlier += earlier
    s.before += brightness(earlier, weights)
    return s


@wp.func
def gain(lit: Lit, weights: wp.vec3) -> float:
    """Return by how much what a pixel reflects has changed because light is known better, not because it changed.

    That is the logarithm of a ratio. What shines by itself is always known.
    """
    now = wp.max(brightness(lit.light, weights), _DARKEST)
    before = wp.max(lit.before, _DARKEST)
    return wp.clamp(wp.log(now / before), -_LARGEST_GAIN, _LARGEST_GAIN)


@wp.func
def shown_in(lit: Lit, earlier: bool, learnt: float) -> wp.vec3:
    """Return the radiance of a pixel in the light as it is known, or as it was before."""
    light = lit.light
    if earlier:
        light = lit.earlier
    return lit.emission + light * wp.exp(-learnt)


@wp.func
def wrong_by(lit: Lit, errors: float, earlier: bool, weights: wp.vec3) -> tuple[float, float]:
    """Return by how much log luminance is wrong where the light is off by so many standard errors, and its last change.

    That change is learnt, as `gain` is: what a pixel shows would not change by it.
    """
    shining = brightness(lit.emission, weights)
    now = wp.max(shining + brightness(lit.light, weights), _DARKEST)
    before = wp.max(shining + lit.before, _DARKEST)
    off = wp.log(wp.max(1.0 + errors * lit.off / now, _LEAST))
    off_before = wp.log(wp.max(1.0 + errors * lit.off_before / before, _LEAST))
    return wp.where(earlier, off_before, off), off - off_before


@wp.func
def seen_light(
    lit: Lit, gathering: Gathering, own: wp.vec3, own_before: wp.vec3, learnt: float, weights: wp.vec3
) -> wp.vec3:
    """Return the radiance of a pixel in the light of what it shows, by what a frame had learnt that shows it."""
    return shown_in(finished(lit, own, own_before, weights), gathering.earlier, learnt)
