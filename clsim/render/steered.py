# Warp: a variable that changes must be born by a call.
# ruff: noqa: UP018, RUF046
"""The kernel that spends samples where they are worth their cost.

A pixel of a frame gets three sorts of samples. *First-hit rays* see what is there, and nothing more: they cost a
fraction of a path and end early where all look alike. *Probe* paths are traced in every pixel, or in every n-th in
turn. Where a decision needs more, paths go on to twice, four times … the probe, at most to the full number; the probe's
are the first of them. How often the probe is doubled is the pixel's *grade*. A path begins with the first-hit ray of
its number, so that what it hits first need not be looked for again.

The picture is put together as light seen directly + albedo × irradiance: the first two from the first-hit rays, so that
neither textures nor edges are noisy, the irradiance as a ratio of what the paths reflect and their own albedo. To what
the paths of a grade find, the last difference between a higher grade and this one is added (control variates kept from
earlier frames, one for each grade, as in multilevel Monte Carlo). With common random numbers these differences change
as slowly as the scene. The first time that a grade is traced, and where the numbers of paths themselves are changed,
the step that this makes is kept and taken off likewise: no change of the numbers fires an event.
"""

from typing import Any

import warp as wp

from clsim.frames import rendered_planes
from clsim.render import sampling
from clsim.render.film import Sample, store3
from clsim.render.sampling import luminance
from clsim.render.sobol import reverse_bits

LEAST_LOOK = 4
"""First-hit rays, or a quarter of them all if that is more, after which a pixel may be found to show one thing."""
_PLANES = rendered_planes(first_hit_rays=True)
_FIRST = {plane.name: _PLANES.first(plane.name) for plane in _PLANES.planes}
GRADES = 6
"""Numbers of paths among which a pixel has its choice: the probe, doubled again and again, and the full number."""
_ALIKE_ALBEDO = wp.constant(0.01)
_ALIKE_NORMAL = wp.constant(0.05)
_ALIKE_DEPTH = wp.constant(0.05)
_ALIKE_EMISSION = wp.constant(0.01)
_DARK = wp.constant(1e-3)
"""Albedo is taken for at least so much: even black lacquer reflects."""
_LEAST = wp.constant(0.2)
"""A difference kept from an earlier frame takes away at most all but this share of the probe's irradiance."""


@wp.struct
class Steering:
    """How many samples pixels get in this frame.

    At the grade ``top`` it is the full number. ``before`` is the probe of the frame before where the numbers of paths
    have changed since, else 0.
    """

    first_hits: int
    first_look: int
    probe: int
    before: int
    top: int
    every: int
    turn: int


@wp.struct
class FirstHits:
    """Sums over a pixel's first-hit rays, and how far they are from the first of them; above 1 is not alike."""

    count: float
    hits: float
    albedo: wp.vec3
    normal: wp.vec3
    depth: float
    emission: wp.vec3
    first: Sample
    spread: float


@wp.struct
class Reflected:
    """Sums over a pixel's paths: what reached the camera by way of a surface, and that surface's albedo."""

    radiance: wp.vec3
    albedo: wp.vec3


@wp.func
def lit_albedo(sample: Sample) -> wp.vec3:
    """Return the albedo by which radiance may be divided."""
    a = sample.albedo
    return wp.vec3(wp.max(a[0], _DARK), wp.max(a[1], _DARK), wp.max(a[2], _DARK))


@wp.func
def see(seen: FirstHits, sample: Sample) -> FirstHits:
    """Add what a first-hit ray saw."""
    s = seen
    if s.count == 0.0:
        s.first = sample
    s.count = s.count + 1.0
    s.emission = s.emission + sample.emission
    shine = luminance(s.first.emission)
    unlike = wp.abs(luminance(sample.emission) - shine) / (_ALIKE_EMISSION * shine + 1.0e-6)
    if sample.hit != s.first.hit:
        unlike = 2.0
    if sample.hit:
        s.hits = s.hits + 1.0
        s.albedo = s.albedo + lit_albedo(sample)
        s.normal = s.normal + sample.normal
        s.depth = s.depth + sample.depth
        unlike = wp.max(unlike, wp.length(sample.albedo - s.first.albedo) / _ALIKE_ALBEDO)
        unlike = wp.max(unlike, wp.length(sample.normal - s.first.normal) / _ALIKE_NORMAL)
        unlike = wp.max(unlike, wp.abs(sample.depth - s.first.depth) / (_ALIKE_DEPTH * s.first.depth))
    s.spread = wp.max(s.spread, unlike)
    return s


@wp.func
def _reflect(sums: Reflected, sample: Sample) -> Reflected:
    s = sums
    if sample.hit:
        s.radiance = s.radiance + (sample.radiance - sample.emission)
        s.albedo = s.albedo + lit_albedo(sample)
    return s


@wp.func
def _irradiance(sums: Reflected, otherwise: wp.vec3) -> wp.vec3:
    """Return reflected radiance over albedo, the irradiance over π of a diffuse surface, where paths hit at all."""
    e = otherwise
    if sums.albedo[0] > 0.0:
        e = wp.cw_div(sums.radiance, sums.albedo)
    return e


@wp.func
def _beside(e: wp.vec3, kept: wp.vec3) -> wp.vec3:
    """Return the sum, which never takes away nearly all of an irradiance."""
    return wp.vec3(
        wp.max(e[0] + kept[0], e[0] * _LEAST),
        wp.max(e[1] + kept[1], e[1] * _LEAST),
        wp.max(e[2] + kept[2], e[2] * _LEAST),
    )


@wp.func
def _paths_of(grade: int, steering: Steering, full: int) -> int:
    paths = full
    if grade < steering.top:
        paths = wp.lshift(steering.probe, grade)
    return paths


@wp.func
def store_surfaces(seen: FirstHits, pixel: int, out_planes: wp.array2d(dtype=float)) -> wp.vec3:
    """Store the planes that are means over hits, and return the mean albedo."""
    share = 1.0 / wp.max(seen.hits, 1.0)
    albedo = seen.albedo * share
    store3(out_planes, wp.static(_FIRST["Albedo"]), pixel, albedo)
    store3(out_planes, wp.static(_FIRST["Normal"]), pixel, seen.normal * share)
    out_planes[wp.static(_FIRST["Depth"]), pixel] = seen.depth * share
    return albedo


@wp.func
def _store(seen: FirstHits, samples: int, e: wp.vec3, pixel: int, out_planes: wp.array2d(dtype=float)):
    """Planes where the table of planes has them."""
    coverage = seen.hits / wp.max(seen.count, 1.0)
    emission = seen.emission / wp.max(seen.count, 1.0)
    albedo = store_surfaces(seen, pixel, out_planes)
    store3(out_planes, wp.static(_FIRST["Radiance"]), pixel, emission + wp.cw_mul(albedo, e) * coverage)
    out_planes[wp.static(_FIRST["Coverage"]), pixel] = coverage
    out_planes[wp.static(_FIRST["Samples"]), pixel] = float(samples)
    out_planes[wp.static(_FIRST["Emission"]), pixel] = luminance(emission)


def make_steered(sobol: bool, shoot: Any, scene_type: Any, view_type: Any, settings_type: Any, options: Any) -> Any:
    """Return the kernel; a thread is a pixel.

    ``grades`` is uint8 ``[H·W]``: 0 where the probe will do and may wait for its turn, else 1 more than how often it is
    doubled; beyond ``steering.top`` doublings, all ``settings.samples`` paths are wanted. Kept from frame to frame:
    ``irradiance``, vec3 ``[H·W]``, of the last frame; ``correction``, vec3 ``[GRADES, H·W]``, by which it differed from
    that of each grade's paths when these were last traced; ``known``, int32 ``[H·W]``: for how many grades, from the
    lowest, there is a correction. ``out_spent`` int32 ``[2, H·W]`` counts first-hit rays that no path begins with, and
    paths.
    """

    @wp.kernel(module="unique", enable_backward=False, module_options=options)
    def render_steered(
        scene: scene_type,
        camera: view_type,
        settings: settings_type,
        first_pixel: int,
        steering: Steering,
        grades: wp.array(dtype=wp.uint8),
        irradiance: wp.array(dtype=wp.vec3),
        correction: wp.array2d(dtype=wp.vec3),
        known: wp.array(dtype=int),
        out_planes: wp.array2d(dtype=float),
        out_spent: wp.array2d(dtype=int),
    ):
        pixel = first_pixel + wp.tid()
        state = sampling.absorb(settings.stream, pixel)
        grade = wp.clamp(int(grades[pixel]) - 1, 0, steering.top)
        wanted = wp.max(_paths_of(grade, steering, settings.samples), steering.before)
        # Diagonals, so that each who waits has neighbours on all sides who do not.
        turn = pixel % settings.width + pixel // settings.width + steering.turn
        if grades[pixel] == wp.uint8(0) and steering.before == 0 and turn % steering.every != 0:
            wanted = int(0)
        # The grade whose correction is added: none where that of another number of paths is.
        base = wp.min(grade, known[pixel] - 1)
        if known[pixel] == 0:
            base = grade
        if steering.before > 0:
            base = int(-1)
        kept = correction[wp.max(base, 0), pixel]
        last = irradiance[pixel]
        e = irradiance[pixel]
        traced = int(0)
        next_paths = int(steering.probe)
        seen = FirstHits()
        sums = Reflected()
        paths = int(0)
        looks = int(0)
        stream = sampling.Stream()
        for i in range(wp.max(steering.first_hits, wanted)):
            on = i < wanted
            look = i < steering.first_hits and (i < steering.first_look or seen.spread > 1.0)
            if on or look:
                if wp.static(sobol):
                    stream.scrambling = sampling.stream_key(sampling.absorb(state, -1))
                    stream.reversed_index = reverse_bits(wp.uint32(i))
                stream.key = sampling.stream_key(sampling.absorb(state, i))
                sample = shoot(scene, camera, settings, pixel, 0, stream, not on)
                # A sample that is not finite is dropped whole.
                sound = sampling.finite(sample.normal)
                if look and sound and sampling.finite(sample.emission):
                    seen = see(seen, sample)
                if on:
                    if sound and sampling.finite(sample.radiance):
                        sums = _reflect(sums, sample)
                    paths = paths + 1
                    if paths == steering.before:
                        e = _irradiance(sums, last - kept)
                    if paths == next_paths and traced <= steering.top:
                        if traced == base:
                            e = _irradiance(sums, last - kept)
                        # Until the picture's irradiance is known, that of the grade.
                        correction[traced, pixel] = _irradiance(sums, last)
                        traced = traced + 1
                        next_paths = _paths_of(traced, steering, settings.samples)
                else:
                    looks = looks + 1

        if paths > 0:
            e = _beside(e, kept)
            for i in range(traced):
                correction[i, pixel] = e - correction[i, pixel]
            if steering.before == 0:
                traced = wp.max(traced, known[pixel])
            known[pixel] = traced
            irradiance[pixel] = e
        _store(seen, looks + paths, e, pixel, out_planes)
        out_spent[0, pixel] = looks
        out_spent[1, pixel] = paths

    return render_steered
