# ruff: noqa: UP018, RUF046
"""Radiance of a pixel gathered from the radiance cache (`light_cache.py`), as Warp functions.

A better estimate of the light must fire no event. So the log luminance shown is the estimate less the change that
refinement of the cache has made since the first frame. R, G and B change as the light does, and the error of the first
estimate stays.
"""

import warp as wp

from clsim.render.cache.light_cache import Asked, CachedLight, Cell, Followed, look_up
from clsim.render.cache.light_grid import layer_of
from clsim.render.camera.film import Sample
from clsim.render.camera.pixel_width import width_at
from clsim.render.primary.ray_numbers import PrimaryRays
from clsim.render.primary.refinement import NextEvent
from clsim.render.primary.seen_surfaces import SeenSurface, variance_of
from clsim.render.sampling.sampling import brightness

_LEAST = wp.constant(0.1)
"""Part of what it shows that a pixel shows at least, however wrong its light may be."""
_LARGEST_GAIN = wp.constant(8.0)
"""Change of log luminance that a frame may learn: what seemed black, as no path had found light, may be bright."""
_CLOSE = wp.constant(0.5)
"""Widths of a pixel within which first hits of one surface have the same light."""
_ALL = wp.constant(1.0e30)
"""More paths than there are."""
_SAME_NORMAL = wp.constant(0.98)


@wp.struct
class Gathering:
    """Settings of a frame that is shaded from the cache.

    Attributes:
        primary_rays: primary rays of a pixel; none where nobody will see the frame, and all trace their paths.
        probe: paths of a pixel whose light is known.
        every: a pixel whose light is known traces them in every n-th frame, at another phase than its neighbours.
        phase: number of the frame.
        known, in_finest: paths in a cell, and in a finest cell where the cache holds direct light, from which on the
            probe will do.
        asked: which cells are looked up, and the update whose gain is no event.
        earlier: whether the light is shown as it was known before that update.
        lamps: whether direct light is analytic, but for what is glossy.
        tells_shadows: whether it is recorded which rays reach the lamps.
        cell: how wide the finest cells are, as a pixel is (`pixel_width.py`); they are no wider than that.
        anchored: whether cells lie on what moves.
        stands: whether the camera is where it was one frame before, and lamps too.
        event: what pixels fire at, unless this is no frame that is seen, or is shown as it was known ``earlier``.
    """

    primary_rays: PrimaryRays
    probe: int
    every: int
    phase: int
    known: float
    in_finest: float
    asked: Asked
    earlier: bool
    lamps: bool
    tells_shadows: bool
    cell: wp.vec2
    anchored: bool
    stands: bool
    event: NextEvent


@wp.struct
class GatheredLight:
    """Sums over the surfaces of a pixel.

    Attributes:
        covered: share of the pixel where a surface is seen.
        emission, light, earlier: radiance sent out, reflected, and reflected as known before the last update.
        before: luminance of ``earlier``.
        unlit, unlit_before: albedo of surfaces whose cells know no light, and knew none before.
        known: fewest paths that a cell knows.
        off, off_before: error of the luminance of the light, now and before, as in `CachedLight`.
        from_lamps: share of the pixel where the cache holds direct light.
        in_finest: paths in the finest cells, times that share.
        brightness, squares: means over the pixel of the surfaces' luminance and of its square.
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
    in_finest: float
    brightness: float
    squares: float


@wp.func
def is_smooth(sample: Sample, in_coat: bool, gathering: Gathering) -> bool:
    """Whether the cached light of a surface changes slowly from place to place: no direct light is in it.

    That of coats counts as smooth too: finer cells took a twentieth more time in a room and gained nothing.
    """
    return gathering.lamps and (sample.lamp or in_coat)


@wp.func
def holds_lamps(sample: Sample, gathering: Gathering) -> bool:
    """Whether the cached light of a surface holds that of lamps, where it does not on most."""
    return gathering.lamps and not sample.lamp


@wp.func
def light_of(
    cells: wp.array[Cell],
    followed: wp.array[Followed],
    surfaces: wp.array[SeenSurface],
    number: int,
    gathering: Gathering,
    weights: wp.vec3,
) -> GatheredLight:
    """Look up the light of each surface of a pixel, at the mean position of its rays."""
    s = GatheredLight()
    s.known = _ALL
    cached = CachedLight()
    at = wp.vec3()
    facing = wp.vec3()
    last_in_coat = int(-1)
    last_instance = int(-1)
    last_smooth = bool(False)
    for k in range(number):
        first = surfaces[k].first
        radiance = surfaces[k].emission
        s.emission += radiance * surfaces[k].share
        if first.hit:
            footprint_m = width_at(gathering.primary_rays.pixel, first.depth)
            place = surfaces[k].position
            normal = first.normal
            instance = int(-1)
            if gathering.anchored:
                place = surfaces[k].rest
                normal = first.rest_normal
                instance = first.instance
            distance_m = wp.length(place - at)
            s.covered += surfaces[k].share
            s.from_lamps += wp.where(is_smooth(first, False, gathering), 0.0, surfaces[k].share)
            # What lies below the coat, and then the coat.
            for in_coat in range(wp.where(surfaces[k].coat[0] > 0.0, 2, 1)):
                whole = surfaces[k].albedo
                smooth = is_smooth(first, in_coat == 1, gathering)
                if in_coat == 1:
                    whole = surfaces[k].coat
                differs = distance_m > _CLOSE * footprint_m or wp.dot(normal, facing) < _SAME_NORMAL
                differs = differs or instance != last_instance
                if differs or in_coat != last_in_coat or smooth != last_smooth:
                    at = place
                    facing = normal
                    last_instance = instance
                    last_in_coat = in_coat
                    last_smooth = smooth
                    width_m = width_at(gathering.cell, first.depth)
                    layer = layer_of(in_coat == 1, holds_lamps(first, gathering), instance)
                    cached = look_up(cells, followed, gathering.asked, at, facing, layer, smooth, width_m)
                s.known = wp.min(s.known, cached.known)
                if in_coat == 0 and not smooth:
                    s.in_finest += cached.in_finest * surfaces[k].share
                albedo = whole * surfaces[k].share
                reflected = wp.cw_mul(albedo, cached.light)
                radiance += wp.cw_mul(whole, cached.light)
                if cached.known > 0.0:
                    s.light += reflected
                    if gathering.asked.tells_error:
                        s.off += brightness(reflected, weights) * cached.off
                else:
                    s.unlit += albedo
                if cached.known_before:
                    earlier = wp.cw_mul(albedo, cached.before)
                    s.earlier += earlier
                    s.before += brightness(earlier, weights)
                    if gathering.asked.tells_error:
                        s.off_before += brightness(earlier, weights) * cached.off_before
                else:
                    s.unlit_before += albedo
                    s.off_before += brightness(reflected, weights) * cached.off
        luminance = brightness(radiance, weights)
        s.brightness += luminance * surfaces[k].share
        s.squares += (luminance * luminance + variance_of(surfaces[k])) * surfaces[k].share
    return s


@wp.func
def finished(gathered: GatheredLight, own: wp.vec3, own_before: wp.vec3, weights: wp.vec3) -> GatheredLight:
    """Return the sums with a pixel's own light where no cell knows any."""
    s = gathered
    s.light += wp.cw_mul(s.unlit, own)
    earlier = wp.cw_mul(s.unlit_before, own)
    if brightness(own_before, weights) > 0.0:
        earlier = wp.cw_mul(s.unlit_before, own_before)
    s.earlier += earlier
    s.before += brightness(earlier, weights)
    return s


@wp.func
def gain(gathered: GatheredLight, darkest: float, learnt: float, weights: wp.vec3) -> float:
    """Return by how much what a pixel reflects has changed because light is known better, not because it changed.

    That is the logarithm of a ratio. What shines by itself is always known. Below ``darkest`` no pixel sees what it
    shows, by what it had ``learnt``: there is nothing to learn, unless it showed more before.
    """
    dark = darkest * wp.exp(learnt)
    least = dark
    if gathered.before >= dark:
        least = _LEAST * dark
    now = wp.max(brightness(gathered.light, weights), least)
    before = wp.max(gathered.before, dark)
    return wp.clamp(wp.log(now / before), -_LARGEST_GAIN, _LARGEST_GAIN)


@wp.func
def shown_in(gathered: GatheredLight, earlier: bool, learnt: float) -> wp.vec3:
    """Return the radiance of a pixel in the light as it is known, or as it was before."""
    light = gathered.light
    if earlier:
        light = gathered.earlier
    return gathered.emission + light * wp.exp(-learnt)


@wp.func
def wrong_by(
    gathered: GatheredLight, errors: float, earlier: bool, darkest: float, weights: wp.vec3
) -> tuple[float, float]:
    """Return by how much log luminance is wrong where the light is off by so many standard errors, and its last change.

    That change is learnt, as `gain` is: what a pixel shows would not change by it.
    """
    shining = brightness(gathered.emission, weights)
    now = wp.max(shining + brightness(gathered.light, weights), darkest)
    before = wp.max(shining + gathered.before, darkest)
    off = wp.log(wp.max(1.0 + errors * gathered.off / now, _LEAST))
    off_before = wp.log(wp.max(1.0 + errors * gathered.off_before / before, _LEAST))
    return wp.where(earlier, off_before, off), off - off_before


@wp.func
def seen_light(
    gathered: GatheredLight, gathering: Gathering, own: wp.vec3, own_before: wp.vec3, learnt: float, weights: wp.vec3
) -> wp.vec3:
    """Return the radiance of a pixel in the light of what it shows, by what a frame had learnt that shows it."""
    return shown_in(finished(gathered, own, own_before, weights), gathering.earlier, learnt)
