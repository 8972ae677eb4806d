# Warp: a variable that changes must be born by a call, and wp.static drops a branch only where it stands alone.
# ruff: noqa: UP018, RUF046
"""The kernel that takes light from what is kept on surfaces, and traces paths to know it better.

A pixel's first-hit rays see what is there, by the same random numbers in every frame. Each takes the light at its own
first hit from the cells of ``light_cache.py``, so that where a pixel shows two surfaces, each has its own light.
Paths have random numbers of their own in every frame, and only what they add to the cells is seen: in the next frame.
A pixel traces few of them, and the full number where little is known.

To know the light better is no event. So what a pixel has learnt since its first frame is taken off its brightness
again: R, G and B change as the light does, in the light as it was known first, and are off by as much as that was.
"""

from typing import Any

import warp as wp

from clsim.frames import rendered_planes
from clsim.render import sampling
from clsim.render.film import Sample, store3
from clsim.render.light_cache import Kept, look_up
from clsim.render.sampling import luminance
from clsim.render.sobol import reverse_bits
from clsim.render.steered import FirstHits, lit_albedo, see, store_surfaces

_PLANES = rendered_planes(first_hit_rays=True)
_FIRST = {plane.name: _PLANES.first(plane.name) for plane in _PLANES.planes}
_OWN = wp.constant(1 << 16)
"""Number of a pixel's first path: beyond those of all first-hit rays."""
_DARKEST = wp.constant(1.0e-4)
"""Luminance below which there is nothing to learn: as a detector's floor."""
_LARGEST_GAIN = wp.constant(1.0)
_CLOSE = wp.constant(0.5)
"""Widths of a pixel within which first hits of one surface have the same light."""
_SAME_NORMAL = wp.constant(0.98)


@wp.struct
class Gathering:
    """How a frame is made.

    Attributes:
        first_hits: largest number of first-hit rays.
        first_look: so many at least.
        probe: paths of a pixel whose light is known.
        every: a pixel whose light is known traces them in each so many-th frame, in turn with its neighbours.
        turn: number of the frame.
        known: where what is known of the light is at least so much, the probe will do; 0 … 1.
        pixel_angle: width of a pixel seen from the camera [rad].
        last_update: the update of the cells whose gain is no event.
    """

    first_hits: int
    first_look: int
    probe: int
    every: int
    turn: int
    known: float
    pixel_angle: float
    last_update: int


@wp.struct
class Lit:
    """Sums over a pixel's first-hit rays: light reflected, its luminance as known before, and what is dark as yet.

    ``unlit`` is the albedo of rays where nothing is known, ``unlit_before`` where nothing was; ``known`` is the least.
    ``kept`` is what was looked up last and ``other`` what before that, ``at``, ``normal``, ``other_at`` and
    ``other_normal`` where: rays that hit close by need not look again.
    """

    light: wp.vec3
    before: float
    unlit: wp.vec3
    unlit_before: wp.vec3
    known: float
    kept: Kept
    at: wp.vec3
    normal: wp.vec3
    other: Kept
    other_at: wp.vec3
    other_normal: wp.vec3


@wp.func
def _close(at: wp.vec3, at_normal: wp.vec3, position: wp.vec3, normal: wp.vec3, reach_m: float) -> bool:
    return wp.length(position - at) < reach_m and wp.dot(normal, at_normal) > _SAME_NORMAL


@wp.func
def _light(lit: Lit, cells: wp.array2d(dtype=wp.int64), sample: Sample, gathering: Gathering) -> Lit:
    s = lit
    albedo = lit_albedo(sample)
    footprint_m = sample.depth * gathering.pixel_angle
    reach_m = _CLOSE * footprint_m
    if not _close(s.at, s.normal, sample.position, sample.normal, reach_m):
        found = s.other
        if not _close(s.other_at, s.other_normal, sample.position, sample.normal, reach_m):
            found = look_up(cells, gathering.last_update, sample.position, sample.normal, footprint_m)
            s.other_at = sample.position
            s.other_normal = sample.normal
        here_at = s.other_at
        here_normal = s.other_normal
        s.other = s.kept
        s.other_at = s.at
        s.other_normal = s.normal
        s.kept = found
        s.at = here_at
        s.normal = here_normal
    kept = s.kept
    s.known = wp.min(s.known, kept.known)
    reflected = wp.cw_mul(albedo, kept.light)
    if kept.known > 0.0:
        s.light += reflected
    else:
        s.unlit += albedo
    if kept.known_before:
        # Of a colour as it is now, as bright as it was.
        s.before += luminance(reflected) * kept.before / wp.max(luminance(kept.light), 1.0e-20)
    else:
        s.unlit_before += albedo
    return s


@wp.func
def _finished(lit: Lit, own: wp.vec3, own_before: wp.vec3) -> Lit:
    """Return the sums with a pixel's own light where no cell knows any."""
    s = lit
    s.light += wp.cw_mul(s.unlit, own)
    if luminance(own_before) > 0.0:
        s.before += luminance(wp.cw_mul(s.unlit_before, own_before))
    else:
        s.before += luminance(wp.cw_mul(s.unlit_before, own))
    return s


@wp.func
def _gain(seen: FirstHits, lit: Lit) -> float:
    """Return by how much a pixel's log luminance has changed because light is known better, not because it changed."""
    shining = luminance(seen.emission)
    each = 1.0 / wp.max(seen.count, 1.0)
    now = wp.max((shining + luminance(lit.light)) * each, _DARKEST)
    before = wp.max((shining + lit.before) * each, _DARKEST)
    return wp.clamp(wp.log(now / before), -_LARGEST_GAIN, _LARGEST_GAIN)


@wp.func
def _store(seen: FirstHits, lit: Lit, learnt: float, samples: int, pixel: int, out_planes: wp.array2d(dtype=float)):
    each = 1.0 / wp.max(seen.count, 1.0)
    emission = seen.emission * each
    radiance = (emission + lit.light * each) * wp.exp(-learnt)
    store3(out_planes, wp.static(_FIRST["Radiance"]), pixel, radiance)
    store_surfaces(seen, pixel, out_planes)
    out_planes[wp.static(_FIRST["Coverage"]), pixel] = seen.hits * each
    out_planes[wp.static(_FIRST["Samples"]), pixel] = float(samples)
    out_planes[wp.static(_FIRST["Emission"]), pixel] = luminance(emission)


def make_cached(sobol: bool, shoot: Any, scene_type: Any, view_type: Any, settings_type: Any, options: Any) -> Any:
    """Return the kernel; a thread is a pixel.

    Kept from frame to frame: ``own``, vec3 ``[H·W]``, the irradiance that a pixel's own paths found last, ``traced``,
    int32 ``[H·W]``, how many paths it ever had, and ``learnt``, float ``[H·W]``, by how much its log luminance has
    changed in all because light is known better. ``out_positions``, ``out_normals`` and ``out_lights``
    ``[settings.samples, H·W]`` tell where the paths of the frame began and what they found (``light_cache.py``).
    ``out_spent`` int32 ``[2, H·W]`` counts first-hit rays and paths.
    """

    @wp.kernel(module="unique", enable_backward=False, module_options=options)
    def render_cached(
        scene: scene_type,
        camera: view_type,
        settings: settings_type,
        first_pixel: int,
        steering: Gathering,
        cells: wp.array2d(dtype=wp.int64),
        own: wp.array(dtype=wp.vec3),
        traced: wp.array(dtype=int),
        learnt: wp.array(dtype=float),
        out_planes: wp.array2d(dtype=float),
        out_positions: wp.array2d(dtype=wp.vec4),
        out_normals: wp.array2d(dtype=wp.vec3),
        out_lights: wp.array2d(dtype=wp.vec3),
        out_spent: wp.array2d(dtype=int),
    ):
        pixel = first_pixel + wp.tid()
        state = sampling.absorb(settings.stream, pixel)
        stream = sampling.Stream()
        seen = FirstHits()
        lit = Lit()
        lit.known = 1.0
        looks = int(0)
        if wp.static(sobol):
            stream.scrambling = sampling.stream_key(sampling.absorb(state, -1))
        for i in range(steering.first_hits):
            if i < steering.first_look or seen.spread > 1.0:
                if wp.static(sobol):
                    stream.reversed_index = reverse_bits(wp.uint32(i))
                stream.key = sampling.stream_key(sampling.absorb(state, i))
                sample = shoot(scene, camera, settings, pixel, 0, stream, True)
                looks = looks + 1
                # A sample that is not finite is dropped whole.
                if sampling.finite(sample.normal) and sampling.finite(sample.emission):
                    seen = see(seen, sample)
                    if sample.hit:
                        lit = _light(lit, cells, sample, steering)

        wanted = int(settings.samples)
        if lit.known >= steering.known:
            turn = pixel % settings.width + pixel // settings.width + steering.turn
            wanted = wp.where(turn % steering.every == 0, steering.probe, 0)
        if seen.hits == 0.0:
            wanted = 0
        before = own[pixel]
        radiance = wp.vec3(0.0, 0.0, 0.0)
        albedo = wp.vec3(0.0, 0.0, 0.0)
        if wp.static(sobol):
            stream.scrambling = sampling.stream_key(sampling.absorb(state, -2))
        for i in range(settings.samples):
            where = wp.vec4(0.0, 0.0, 0.0, 0.0)
            if i < wanted:
                number = traced[pixel] + i
                if wp.static(sobol):
                    stream.reversed_index = reverse_bits(wp.uint32(number))
                stream.key = sampling.stream_key(sampling.absorb(state, _OWN + number))
                sample = shoot(scene, camera, settings, pixel, 0, stream, False)
                if sample.hit and sampling.finite(sample.radiance) and sampling.finite(sample.normal):
                    reflected = sample.radiance - sample.emission
                    p = sample.position
                    where = wp.vec4(p[0], p[1], p[2], sample.depth * steering.pixel_angle)
                    out_normals[i, pixel] = sample.normal
                    out_lights[i, pixel] = wp.cw_div(reflected, lit_albedo(sample))
                    radiance = radiance + reflected
                    albedo = albedo + lit_albedo(sample)
            out_positions[i, pixel] = where
        if albedo[0] > 0.0:
            own[pixel] = wp.cw_div(radiance, albedo)
        traced[pixel] = traced[pixel] + wanted
        lit = _finished(lit, own[pixel], before)
        learnt[pixel] = learnt[pixel] + _gain(seen, lit)
        _store(seen, lit, learnt[pixel], looks + wanted, pixel, out_planes)
        out_spent[0, pixel] = looks
        out_spent[1, pixel] = wanted

    return render_cached
