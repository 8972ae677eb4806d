# Warp: a variable that changes must be born by a call, and wp.static drops a branch only where it stands alone.
# ruff: noqa: UP018, RUF046
"""The kernel that takes light from what is kept on surfaces, and traces paths to know it better.

A pixel's first-hit rays see what is there, by the same random numbers in every frame. Each takes the light at its own
first hit from the cells of ``light_cache.py``, so that where a pixel shows two surfaces, each has its own light.
Paths have random numbers of their own in every frame, and only what they add to the cells is seen: in the next frame.
A pixel traces few of them, and the full number where little is known.

Some pixels may be looked at again, by other random numbers in the same light: what two looks differ by is noise.

To know the light better is no event. So what a pixel has learnt since its first frame is taken off its brightness
again: R, G and B change as the light does, in the light as it was known first, and are off by as much as that was.

Where pixels are traced between frames, they are seen in the light as it was known before the frame that ends the step,
and so is that frame: brightness is then the same whatever the frames' times.
"""

from typing import Any

import warp as wp

from clsim.render import sampling
from clsim.render.closer_look import SHARE_ERROR, NextEvent, error_allowed, fire, level_of, look_closer
from clsim.render.film import Sample
from clsim.render.first_hits import Looks, Seen
from clsim.render.light_cache import Asked, Cell, Kept, look_up
from clsim.render.sampling import brightness
from clsim.render.shadow_rays import Shadow, Shadows
from clsim.render.sobol import reverse_bits
from clsim.render.things import THINGS, Thing, lit_albedo, store_things

_OWN = wp.constant(1 << 16)
"""Number of a pixel's first path: beyond those of all first-hit rays."""
_AGAIN = wp.constant(-3)
"""Number of the random numbers of a second look."""
_OFF = wp.constant(0.5**0.5)
"""Standard errors of the light by which two looks are wrong, one up and one down: so they differ as two runs do."""
_LEAST = wp.constant(0.1)
"""Part of what it shows that a pixel shows at least, however wrong its light may be."""
_DARKEST = wp.constant(1.0e-4)
"""Luminance below which there is nothing to learn: as a detector's floor."""
_LARGEST_GAIN = wp.constant(8.0)
"""Change of log luminance that a frame may learn: what seemed black, as no path had found light, may be bright."""
_CLOSE = wp.constant(0.5)
"""Widths of a pixel within which first hits of one surface have the same light."""
_SAME_NORMAL = wp.constant(0.98)


@wp.struct
class Gathering:
    """How a frame is made.

    Attributes:
        looks: first-hit rays of a pixel; none where nobody will see the frame, and all trace their paths.
        probe: paths of a pixel whose light is known.
        every: a pixel whose light is known traces them in each so many-th frame, in turn with its neighbours.
        turn: number of the frame.
        known, finely: where what is known of the light is at least so much, and by the finest cells where light
            straight from lamps is kept, the probe will do; 0 … 1.
        asked: which cells are asked for the light, and the update whose gain is no event.
        earlier: whether the light is shown as it was known before that update.
        lamps: whether light straight from lamps is found apart, but for what is glossy.
        tells_shadows: whether it is told which rays reach the lamps.
        cell_angle: width of the finest cells seen from the camera [rad]; they are no wider than that.
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
    cell_angle: float
    event: NextEvent


@wp.struct
class Lit:
    """Sums over what a pixel shows: light sent out and reflected, the latter as known before, and what is dark as yet.

    ``covered`` is the share of the pixel where a surface is seen, ``before`` the luminance of ``earlier``.
    ``brightness`` and ``squares`` are means over the pixel of the luminance of things and of its square.
    ``unlit`` is the albedo of what nothing is known of, ``unlit_before`` of what nothing was; ``known`` is the least.
    ``off`` and ``off_before`` are by how much the luminance of the light might be wrong, now and before, as in `Kept`.
    ``from_lamps`` is the share of the pixel where light straight from lamps is kept, and ``finely`` the part of it that
    the finest cells know.
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
def _is_smooth(sample: Sample, gathering: Gathering) -> bool:
    """Whether light that is kept for a surface changes slowly from place to place: none comes straight from lamps.

    It counts as smooth on plastics too, where finer cells took a twentieth more time in a room and gained nothing.
    """
    return gathering.lamps and (sample.lamp or sample.coat[0] > 0.0)


@wp.func
def light_of(
    cells: wp.array(dtype=Cell), things: wp.array(dtype=Thing), number: int, gathering: Gathering, weights: wp.vec3
) -> Lit:
    """Look up the light of each thing that a pixel shows, in the middle of what it shows of it."""
    s = Lit()
    s.known = 1.0
    kept = Kept()
    at = wp.vec3()
    facing = wp.vec3()
    looked_in = int(-1)
    looked_for_smooth = bool(False)
    for k in range(number):
        first = things[k].first
        radiance = things[k].emission
        s.emission += radiance * things[k].share
        if first.hit:
            footprint_m = first.depth * gathering.looks.pixel_angle
            apart_m = wp.length(things[k].position - at)
            s.covered += things[k].share
            smooth = _is_smooth(first, gathering)
            s.from_lamps += wp.where(smooth, 0.0, things[k].share)
            # What lies below the coat, and then the coat.
            for in_coat in range(wp.where(things[k].coat[0] > 0.0, 2, 1)):
                whole = things[k].albedo
                if in_coat == 1:
                    whole = things[k].coat
                apart = apart_m > _CLOSE * footprint_m or wp.dot(first.normal, facing) < _SAME_NORMAL
                if apart or in_coat != looked_in or smooth != looked_for_smooth:
                    at = things[k].position
                    facing = first.normal
                    looked_in = in_coat
                    looked_for_smooth = smooth
                    width_m = first.depth * gathering.cell_angle
                    kept = look_up(cells, gathering.asked, at, facing, in_coat, smooth, width_m)
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
def _finished(lit: Lit, own: wp.vec3, own_before: wp.vec3, weights: wp.vec3) -> Lit:
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
def _gain(lit: Lit, weights: wp.vec3) -> float:
    """Return by how much a pixel's log luminance has changed because light is known better, not because it changed."""
    shining = brightness(lit.emission, weights)
    now = wp.max(shining + brightness(lit.light, weights), _DARKEST)
    before = wp.max(shining + lit.before, _DARKEST)
    return wp.clamp(wp.log(now / before), -_LARGEST_GAIN, _LARGEST_GAIN)


@wp.func
def _shown(lit: Lit, earlier: bool, learnt: float) -> wp.vec3:
    """Return the radiance of a pixel in the light as it is known, or as it was before."""
    light = lit.light
    if earlier:
        light = lit.earlier
    return (lit.emission + light) * wp.exp(-learnt)


@wp.func
def _wrong(lit: Lit, errors: float, earlier: bool, weights: wp.vec3) -> tuple[float, float]:
    """Return by how much log luminance is wrong where the light is off by so many standard errors, and its last change.

    That change is learnt, as `_gain` is: what a pixel shows would not change by it.
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
    return _shown(_finished(lit, own, own_before, weights), gathering.earlier, learnt)


def make_cached(
    sobol: bool,
    look: Any,
    shoot: Any,
    scene_type: Any,
    view_type: Any,
    settings_type: Any,
    options: Any,
) -> Any:
    """Return the kernel; a thread is ``pixels`` pixels, or corners of pixels in the pass that fills ``corners``.

    Kept from frame to frame: ``own``, vec3 ``[H·W]``, the irradiance that a pixel's own paths found last, ``traced``,
    int32 ``[H·W]``, how many paths it ever had, and ``learnt``, float ``[H·W]``, by how much its log luminance has
    changed in all because light is known better. Where ``settings.samples`` is 0 nothing is traced, and nothing learnt.
    ``out_positions``, ``out_normals`` and ``out_lights``
    ``[settings.samples, H·W]`` tell where the paths of the frame began and what they found (``light_cache.py``).
    ``out_spent`` int32 ``[2, H·W]`` counts first-hit rays, and the paths of the last frame that traced any.

    ``fired``, float ``[H·W]``, is the level at which each pixel fired last, NaN before the first frame; it is kept too,
    where ``steering.event`` tells at what they do.

    ``learnt_twice``, float ``[2, H·W / n]``, is ``learnt`` of two looks at every n-th pixel, beside that.

    ``own_before`` and ``learnt_before`` are copies of both from before the last frame that traced any path, and asked
    for only where the light is shown as it was ``earlier``.

    ``out_shadows`` ``[H·W]`` tells of pixels in soft shadows which rays reach the lamps, where that is asked for.

    Once a frame is done, a pass with ``again`` = n > 0, whose threads are every n-th pixel, looks at these once more.
    It writes to ``out_twice`` alone: float ``[2, H·W / n]``, the luminance of what the frame shows, and of what they
    see, one somewhat brighter and one darker, by how far the light might be off.
    """

    @wp.kernel(module="unique", enable_backward=False, module_options=options)
    def render_cached(
        scene: scene_type,
        camera: view_type,
        settings: settings_type,
        first_pixel: int,
        pixels: int,
        corner_pass: bool,
        corners: wp.array(dtype=Sample),
        steering: Gathering,
        cells: wp.array(dtype=Cell),
        own: wp.array(dtype=wp.vec3),
        traced: wp.array(dtype=int),
        learnt: wp.array(dtype=float),
        fired: wp.array(dtype=float),
        own_before: wp.array(dtype=wp.vec3),
        learnt_before: wp.array(dtype=float),
        learnt_twice: wp.array2d(dtype=float),
        again: int,
        out_planes: wp.array2d(dtype=float),
        out_twice: wp.array2d(dtype=float),
        out_positions: wp.array2d(dtype=wp.vec4),
        out_normals: wp.array2d(dtype=wp.vec4),
        out_lights: wp.array2d(dtype=wp.vec3),
        out_spent: wp.array2d(dtype=int),
        out_shadows: wp.array(dtype=Shadow),
    ):
        # Room is made, and arguments are copied, once for all pixels of a thread.
        things = wp.zeros(shape=wp.static(THINGS), dtype=Thing)
        gathering = steering
        gathering.asked.tells_error = again > 0
        first = first_pixel + wp.tid() * pixels
        for number in range(first, first + pixels):
            pixel = number * wp.max(again, 1)
            state = sampling.absorb(settings.stream, pixel)
            if again > 0:
                state = sampling.absorb(state, _AGAIN)
            stream = sampling.Stream()
            corner = wp.where(corner_pass, pixel, -1)
            nearest = wp.where(corner_pass, pixel, pixel + pixel // settings.width)
            row = settings.width + 1
            looks = steering.looks
            lit = Lit()
            seen = Seen()
            last = int(0)
            while looks.most > last:
                last = looks.most
                seen = look(
                    scene,
                    camera,
                    settings,
                    pixel,
                    0,
                    state,
                    looks,
                    corner,
                    corners,
                    nearest,
                    row,
                    seen,
                    Shadows(),
                    things,
                )
                if corner_pass:
                    break
                lit = light_of(cells, things, seen.things, gathering, settings.spectral)
                error = float(SHARE_ERROR)
                told = steering.event.on > 0.0
                if told and seen.counted:
                    so_far = _finished(lit, own[pixel], own[pixel], settings.spectral)
                    gained = wp.where(again > 0, 0.0, _gain(so_far, settings.spectral))
                    level = level_of(_shown(so_far, False, learnt[pixel] + gained), steering.event, settings.spectral)
                    error = error_allowed(level, fired[pixel], steering.event)
                looks = look_closer(lit.brightness, lit.squares, seen, steering.looks, looks, error, told)
            if corner_pass:
                continue
            if steering.tells_shadows and again == 0:
                out_shadows[pixel] = seen.shadow
            if again > 0:
                lit = _finished(lit, own[pixel], own_before[pixel], settings.spectral)
                learnt_then = learnt[pixel]
                if steering.earlier:
                    learnt_then = learnt_before[pixel]
                shows = wp.vec3(out_planes[0, pixel], out_planes[1, pixel], out_planes[2, pixel])
                sees = _shown(lit, steering.earlier, learnt_then)
                for one in range(2):
                    off, gained = _wrong(lit, wp.where(one == 0, _OFF, -_OFF), steering.earlier, settings.spectral)
                    seen_by = brightness(wp.where(one == 0, shows, sees), settings.spectral)
                    learnt_twice[one, number] = learnt_twice[one, number] + gained
                    then = wp.where(steering.earlier, gained, 0.0)
                    out_twice[one, number] = seen_by * wp.exp(off - learnt_twice[one, number] + then)
                continue
            wanted = int(settings.samples)
            if lit.known >= steering.known and lit.finely >= steering.finely * lit.from_lamps:
                turn = pixel % settings.width + pixel // settings.width + steering.turn
                wanted = wp.where(turn % steering.every == 0, steering.probe, 0)
            if lit.covered == 0.0 and steering.looks.most > 0:
                wanted = 0
            before = own[pixel]
            radiance = wp.vec3(0.0, 0.0, 0.0)
            albedo = wp.vec3(0.0, 0.0, 0.0)
            if wp.static(sobol):
                stream.scrambling = sampling.stream_key(sampling.absorb(state, -2))
            for i in range(wanted):
                where = wp.vec4(0.0, 0.0, 0.0, 0.0)
                number = traced[pixel] + i
                if wp.static(sobol):
                    stream.reversed_index = reverse_bits(wp.uint32(number))
                stream.key = sampling.stream_key(sampling.absorb(state, _OWN + number))
                sample = shoot(scene, camera, settings, pixel, 0, stream)
                if sample.hit and sampling.finite(sample.radiance) and sampling.finite(sample.normal):
                    reflected = sample.radiance - sample.emission
                    p = sample.position
                    where = wp.vec4(p[0], p[1], p[2], sample.depth * steering.cell_angle)
                    n = sample.normal
                    kind = wp.where(sample.in_coat, 1.0, 0.0) + wp.where(_is_smooth(sample, steering), 2.0, 0.0)
                    out_normals[i, pixel] = wp.vec4(n[0], n[1], n[2], kind)
                    out_lights[i, pixel] = wp.cw_div(reflected, lit_albedo(sample))
                    if not sample.in_coat:
                        radiance = radiance + reflected
                        albedo = albedo + lit_albedo(sample)
                out_positions[i, pixel] = where
            if albedo[0] > 0.0:
                own[pixel] = wp.cw_div(radiance, albedo)
            traced[pixel] = traced[pixel] + wanted
            lit = _finished(lit, own[pixel], before, settings.spectral)
            learnt_so_far = learnt[pixel]
            if settings.samples > 0:
                learnt[pixel] = learnt_so_far + _gain(lit, settings.spectral)
                out_spent[1, pixel] = wanted
            if not steering.earlier:
                learnt_so_far = learnt[pixel]
            shown = _shown(lit, steering.earlier, learnt_so_far)
            if steering.event.on > 0.0:
                level = level_of(shown, steering.event, settings.spectral)
                fired[pixel] = fire(level, fired[pixel], steering.event)
            store_things(things, seen.things, seen.rays + wanted, shown, settings.spectral, pixel, out_planes)
            out_spent[0, pixel] = seen.rays

    return render_cached
