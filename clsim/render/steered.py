# Warp: a variable that changes must be born by a call.
# ruff: noqa: UP018, RUF046
"""The kernel that spends samples where they are worth their cost.

A pixel of a frame gets three sorts of samples. *First-hit rays* see what is there, and nothing more: they cost a
fraction of a path and end early where all look alike. *Probe* paths are traced in every pixel, or in every n-th in
turn. Where an event is near, paths go on to the full number, of which the probe's are the first. A path begins with the
first-hit ray of its number, so that what it hits first need not be looked for again.

The picture is put together as light seen directly + albedo × irradiance: the first two from the first-hit rays, so that
neither textures nor edges are noisy, the irradiance as a ratio of what the paths reflect and their own albedo. Where
only probes were traced, the last difference of full number and probe is added to the irradiance (a control variate kept
from an earlier frame). With common random numbers that difference changes as slowly as the scene. Where the full number
itself is changed, the step that this makes is kept and taken off likewise: no change of the numbers fires an event.
"""

from typing import Any

import warp as wp

from clsim.render import sampling
from clsim.render.film import Sample
from clsim.render.sampling import luminance
from clsim.render.sobol import reverse_bits

LEAST_LOOK = 4
"""First-hit rays, or a quarter of them all if that is more, after which a pixel may be found to show one thing."""
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
    """How many samples pixels get in this frame; ``before`` is the probe of the frame before."""

    first_hits: int
    first_look: int
    probe: int
    before: int
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
def _lit_albedo(sample: Sample) -> wp.vec3:
    a = sample.albedo
    return wp.vec3(wp.max(a[0], _DARK), wp.max(a[1], _DARK), wp.max(a[2], _DARK))


@wp.func
def _see(seen: FirstHits, sample: Sample) -> FirstHits:
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
        s.albedo = s.albedo + _lit_albedo(sample)
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
        s.albedo = s.albedo + _lit_albedo(sample)
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
def _store3(out: wp.array2d(dtype=float), plane: int, pixel: int, value: wp.vec3):
    out[plane, pixel] = value[0]
    out[plane + 1, pixel] = value[1]
    out[plane + 2, pixel] = value[2]


@wp.func
def _store(seen: FirstHits, samples: int, e: wp.vec3, pixel: int, out_planes: wp.array2d(dtype=float)):
    """Planes in the order of ``frames.FIRST_HIT_PLANES``."""
    coverage = seen.hits / wp.max(seen.count, 1.0)
    share = 1.0 / wp.max(seen.hits, 1.0)
    emission = seen.emission / wp.max(seen.count, 1.0)
    albedo = seen.albedo * share
    _store3(out_planes, 0, pixel, emission + wp.cw_mul(albedo, e) * coverage)
    _store3(out_planes, 3, pixel, albedo)
    _store3(out_planes, 6, pixel, seen.normal * share)
    out_planes[9, pixel] = seen.depth * share
    out_planes[10, pixel] = coverage
    out_planes[11, pixel] = float(samples)
    out_planes[12, pixel] = luminance(emission)


def make_steered(sobol: bool, shoot: Any, scene_type: Any, view_type: Any, settings_type: Any, options: Any) -> Any:
    """Return the kernel; a thread is a pixel.

    ``near`` is uint8 ``[H·W]``, not 0 where all ``settings.samples`` paths are wanted. Kept from frame to frame, vec3
    ``[H·W]``: the ``irradiance`` of the last frame; ``correction``, by which it differed from the probe's, and
    ``offset``, by which it differed from that of all ``full_samples`` (int32; 0 for none yet). ``out_spent`` int32
    ``[2, H·W]`` counts first-hit rays that no path begins with, and paths.
    """

    @wp.kernel(module="unique", enable_backward=False, module_options=options)
    def render_steered(
        scene: scene_type,
        camera: view_type,
        settings: settings_type,
        first_pixel: int,
        steering: Steering,
        near: wp.array(dtype=wp.uint8),
        irradiance: wp.array(dtype=wp.vec3),
        correction: wp.array(dtype=wp.vec3),
        offset: wp.array(dtype=wp.vec3),
        full_samples: wp.array(dtype=int),
        out_planes: wp.array2d(dtype=float),
        out_spent: wp.array2d(dtype=int),
    ):
        pixel = first_pixel + wp.tid()
        state = sampling.absorb(settings.stream, pixel)
        full = near[pixel] != wp.uint8(0)
        wanted = wp.max(steering.probe, steering.before)
        if full:
            wanted = wp.max(wanted, settings.samples)
        elif (pixel + steering.turn) % steering.every != 0:
            wanted = int(0)
        seen = FirstHits()
        sums = Reflected()
        by_probe = Reflected()
        by_before = Reflected()
        by_all = Reflected()
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
                sample = shoot(scene, camera, settings, pixel, stream, not on)
                # A sample that is not finite is dropped whole.
                sound = sampling.finite(sample.normal)
                if look and sound and sampling.finite(sample.emission):
                    seen = _see(seen, sample)
                if on:
                    if sound and sampling.finite(sample.radiance):
                        sums = _reflect(sums, sample)
                    paths = paths + 1
                    if paths == steering.probe:
                        by_probe = sums
                    if paths == steering.before:
                        by_before = sums
                    if paths == settings.samples:
                        by_all = sums
                else:
                    looks = looks + 1

        e = irradiance[pixel]
        kept = correction[pixel]
        fresh = full_samples[pixel] == 0
        if full and (fresh or full_samples[pixel] == settings.samples):
            e = _beside(_irradiance(by_all, e - offset[pixel]), offset[pixel])
            kept = e - _irradiance(by_probe, e)
        elif paths > 0:
            e = _beside(_irradiance(by_before, e - kept), kept)
            kept = e - _irradiance(by_probe, e)
            if full:
                offset[pixel] = e - _irradiance(by_all, e)
        if full:
            full_samples[pixel] = settings.samples
        irradiance[pixel] = e
        correction[pixel] = kept
        _store(seen, looks + paths, e, pixel, out_planes)
        out_spent[0, pixel] = looks
        out_spent[1, pixel] = paths

    return render_steered
