# ruff: noqa: UP018, RUF046
"""The kernel of adaptive sampling: it spends samples where they are worth their cost.

A pixel of a frame gets three sorts of samples. *Primary rays* find the first hits: they cost a fraction of a path and
end early where all see the same. Where something changes and an event is near, several times as many count the shares
of what a pixel shows. *Probe* paths are traced in every pixel, or in every n-th, another one in each frame. Where a
decision needs more, paths go on to twice, four times … the probe, at most to the full number; the probe's are the first
of them. How often the probe is doubled is the pixel's *grade*.

The picture is composed as light seen directly + albedo × irradiance: the first two from the primary rays, so that
neither textures nor edges are noisy, the irradiance as a ratio of what the paths reflect and their own albedo. To what
the paths of a grade find, the last difference between a higher grade and this one is added (control variates from
earlier frames, one for each grade, as in multilevel Monte Carlo). With common random numbers these differences change
as slowly as the scene. The first time that a grade is traced, and where the numbers of paths themselves are changed,
the step that this makes is stored and subtracted likewise: no change of the numbers fires an event.
"""

from typing import Any

import warp as wp

from clsim.render.camera.film import Sample
from clsim.render.primary.first_hits import Seen
from clsim.render.primary.ray_numbers import PrimaryRays
from clsim.render.primary.refinement import SHARE_ERROR, rays_needed
from clsim.render.primary.seen_surfaces import DARK, MOST_SURFACES, SeenSurface, covered_by, lit_albedo, store_surfaces
from clsim.render.primary.shadow_rays import Shadows
from clsim.render.sampling import sampling
from clsim.render.sampling.sampling import brightness
from clsim.render.sampling.sobol import reverse_bits

GRADES = 6
"""Numbers of paths among which a pixel has its choice: the probe, doubled again and again, and the full number."""
REFINED = 0x80
"""Bit of a pixel's grade that asks for more primary rays."""
_REFINED = wp.constant(REFINED)
_USUAL = wp.constant(12.0)
"""Primary rays with which shares may be wrong by `SHARE_ERROR` near an event; by less, where there are more."""
_GLOW = wp.constant(1.0e-5)
"""Least emission of what shines by itself, as a part of the direct light; less is rounding."""
_ALIKE = wp.constant(2.0)
"""Least multiple of the primary rays that is used near an event."""
_LEAST = wp.constant(0.2)
"""Least share of the probe's irradiance that a control variate leaves."""


@wp.struct
class Steering:
    """The sample numbers of a frame.

    At the grade ``top`` it is the full number. ``before`` is the probe of the frame before where the numbers of paths
    have changed since, else 0.
    """

    primary_rays: PrimaryRays
    probe: int
    before: int
    top: int
    every: int
    phase: int


@wp.struct
class Reflected:
    """Sums over a pixel's paths: what reached the camera by way of a surface, and that surface's albedo."""

    radiance: wp.vec3
    albedo: wp.vec3


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
def _with_control(e: wp.vec3, control: wp.vec3) -> wp.vec3:
    """Return an irradiance with its control variate, which never takes away nearly all of it."""
    return wp.vec3(
        wp.max(e[0] + control[0], e[0] * _LEAST),
        wp.max(e[1] + control[1], e[1] * _LEAST),
        wp.max(e[2] + control[2], e[2] * _LEAST),
    )


@wp.func
def _paths_of(grade: int, steering: Steering, full: int) -> int:
    paths = full
    if grade < steering.top:
        paths = wp.lshift(steering.probe, grade)
    return paths


@wp.func
def _corrected(grade: int, known: int, before: int) -> int:
    """Return the grade whose correction is added: none, −1, where that of another number of paths is."""
    base = wp.min(grade, known - 1)
    if known == 0:
        base = grade
    if before > 0:
        base = int(-1)
    return base


@wp.func
def _rays_at_event(
    surfaces: wp.array[SeenSurface], number: int, darkest: float, weights: wp.vec3, primary_rays: PrimaryRays
) -> int:
    """Return how many primary rays a pixel gets near an event, by how its surfaces differ.

    Colours count, and how direct light differs between surfaces, and not how much light there is: where that alone
    changes, the number stays. Some more are used where all are alike, as small surfaces are easily missed. Where
    something shines by itself, or there is a background, all are used.
    """
    own = float(0.0)
    colour = float(0.0)
    colours = float(0.0)
    lit = float(0.0)
    lights = float(0.0)
    for k in range(number):
        share = surfaces[k].share
        own = wp.max(own, brightness(surfaces[k].emission - surfaces[k].from_lamps, weights))
        if not surfaces[k].first.hit:
            own = 1.0
        one = brightness(surfaces[k].albedo, weights)
        colour += one * share
        colours += one * one * share
        one = brightness(surfaces[k].from_lamps, weights)
        lit += one * share
        lights += one * one * share
    most = float(primary_rays.at_event)
    error = SHARE_ERROR * _USUAL / float(primary_rays.most)
    needed = wp.max(rays_needed(colour, colours, DARK, error), rays_needed(lit, lights, darkest, error))
    if own > _GLOW * lit:
        needed = most
    return int(wp.clamp(needed, wp.min(_ALIKE * float(primary_rays.most), most), most))


@wp.func
def _lit(surfaces: wp.array[SeenSurface], number: int, e: wp.vec3) -> wp.vec3:
    """Return the radiance of what is seen, in light of that irradiance over π."""
    radiance = wp.vec3()
    for k in range(number):
        radiance += (surfaces[k].emission + wp.cw_mul(surfaces[k].albedo, e)) * surfaces[k].share
    return radiance


def make_steered(
    sobol: bool,
    sample_primary: Any,
    shoot: Any,
    scene_type: Any,
    view_type: Any,
    settings_type: Any,
    options: Any,
) -> Any:
    """Return the kernel; a thread is ``pixels`` pixels, or corners of pixels in the pass that fills ``corners``.

    ``grades`` is uint8 ``[H·W]``: 0 where the probe will do and may wait for its turn, else 1 more than how often it is
    doubled; beyond ``steering.top`` doublings, all ``settings.samples`` paths are wanted. `REFINED` is added where more
    primary rays are to count shares. State from frame to frame: ``irradiance``, vec3 ``[H·W]``, of the last frame;
    ``correction``, vec3 ``[GRADES, H·W]``, by which it differed from that of each grade's paths when these were last
    traced; ``known``, int32 ``[H·W]``: for how many grades, from the lowest, there is a correction. ``out_spent`` int32
    ``[2, H·W]`` counts primary rays and paths.
    """

    @wp.kernel(module="unique", enable_backward=False, module_options=options)
    def render_steered(
        scene: scene_type,
        camera: view_type,
        settings: settings_type,
        first_pixel: int,
        pixels: int,
        corner_pass: bool,
        corners: wp.array[Sample],
        steering: Steering,
        grades: wp.array[wp.uint8],
        irradiance: wp.array[wp.vec3],
        correction: wp.array2d[wp.vec3],
        known: wp.array[int],
        out_planes: wp.array2d[float],
        out_spent: wp.array2d[int],
    ) -> None:
        # Room is made, and arguments are copied, once for all pixels of a thread.
        surfaces = wp.zeros(shape=wp.static(MOST_SURFACES), dtype=SeenSurface)
        first = first_pixel + wp.tid() * pixels
        for pixel in range(first, first + pixels):
            state = sampling.absorb(settings.stream, pixel)
            corner = wp.where(corner_pass, pixel, -1)
            nearest = wp.where(corner_pass, pixel, pixel + pixel // settings.width)
            row = settings.width + 1
            primary_rays = steering.primary_rays
            seen = Seen()
            done = int(0)
            while primary_rays.most > done:
                done = primary_rays.most
                seen = sample_primary(
                    scene, camera, settings, pixel, 0, state, primary_rays, corner, corners, nearest, row, seen,
                    Shadows(), surfaces,
                )  # fmt: skip
                if corner_pass:
                    break
                refined = (int(grades[pixel]) & _REFINED) > 0 and primary_rays.at_event > primary_rays.most
                if seen.counted and refined and done == steering.primary_rays.most:
                    primary_rays.most = _rays_at_event(
                        surfaces, seen.surfaces, settings.darkest, settings.spectral, primary_rays
                    )
            if corner_pass:
                continue
            graded = int(grades[pixel]) & (_REFINED - 1)
            grade = wp.clamp(graded - 1, 0, steering.top)
            wanted = wp.max(_paths_of(grade, steering, settings.samples), steering.before)
            # Diagonals, so that each who waits has neighbours on all sides who do not.
            phase = pixel % settings.width + pixel // settings.width + steering.phase
            waits = graded == 0 and steering.before == 0 and phase % steering.every != 0
            # What paths find is of surfaces: where none is seen they are not wanted, and nothing is known of the next.
            # Where one has just come into view they are, as nothing is known there.
            if covered_by(surfaces, seen.surfaces) == 0.0:
                wanted = int(0)
                known[pixel] = 0
            elif waits and known[pixel] > 0:
                wanted = int(0)
            base = _corrected(grade, known[pixel], steering.before)
            control = wp.vec3()
            if known[pixel] > 0:
                control = correction[wp.max(base, 0), pixel]
            last = irradiance[pixel]
            e = irradiance[pixel]
            traced = int(0)
            next_paths = int(steering.probe)
            sums = Reflected()
            paths = int(0)
            stream = sampling.Stream()
            if wp.static(sobol):
                stream.scrambling = sampling.stream_key(sampling.absorb(state, -1))
            for i in range(wanted):
                if wp.static(sobol):
                    stream.reversed_index = reverse_bits(wp.uint32(i))
                stream.key = sampling.stream_key(sampling.absorb(state, i))
                sample = shoot(scene, camera, settings, pixel, 0, stream)
                # A sample that is not finite is dropped whole.
                if sampling.finite(sample.normal) and sampling.finite(sample.radiance):
                    sums = _reflect(sums, sample)
                paths = paths + 1
                if paths == steering.before:
                    e = _irradiance(sums, last - control)
                if paths == next_paths and traced <= steering.top:
                    if traced == base:
                        e = _irradiance(sums, last - control)
                    # Until the picture's irradiance is known, that of the grade.
                    correction[traced, pixel] = _irradiance(sums, last)
                    traced = traced + 1
                    next_paths = _paths_of(traced, steering, settings.samples)

            if paths > 0:
                e = _with_control(e, control)
                for i in range(traced):
                    correction[i, pixel] = e - correction[i, pixel]
                if steering.before == 0:
                    traced = wp.max(traced, known[pixel])
                # Paths may all have missed the surface that primary rays saw.
                if sums.albedo[0] > 0.0:
                    known[pixel] = traced
                irradiance[pixel] = e
            shown = _lit(surfaces, seen.surfaces, e)
            store_surfaces(surfaces, seen.surfaces, seen.rays + paths, shown, settings.spectral, pixel, out_planes)
            out_spent[0, pixel] = seen.rays
            out_spent[1, pixel] = paths

    return render_steered
