# Warp: a variable that changes must be born by a call.
# ruff: noqa: UP018, RUF046
"""The kernel that spends samples where they are worth their cost.

A pixel of a frame gets three sorts of samples. *First-hit rays* see what is there, and nothing more: they cost a
fraction of a path and end early where all look alike. Where something changes and an event is near, several times as
many count the shares of what a pixel shows. *Probe* paths are traced in every pixel, or in every n-th in turn. Where a
decision needs more, paths go on to twice, four times … the probe, at most to the full number; the probe's are the first
of them. How often the probe is doubled is the pixel's *grade*.

The picture is put together as light seen directly + albedo × irradiance: the first two from the first-hit rays, so that
neither textures nor edges are noisy, the irradiance as a ratio of what the paths reflect and their own albedo. To what
the paths of a grade find, the last difference between a higher grade and this one is added (control variates kept from
earlier frames, one for each grade, as in multilevel Monte Carlo). With common random numbers these differences change
as slowly as the scene. The first time that a grade is traced, and where the numbers of paths themselves are changed,
the step that this makes is kept and taken off likewise: no change of the numbers fires an event.
"""

from typing import Any

import warp as wp

from clsim.render.camera.film import Sample
from clsim.render.primary.closer_look import SHARE_ERROR, rays_needed
from clsim.render.primary.first_hits import Looks, Seen
from clsim.render.primary.shadow_rays import Shadows
from clsim.render.primary.things import THINGS, Thing, covered_by, lit_albedo, store_things
from clsim.render.sampling import sampling
from clsim.render.sampling.sampling import brightness
from clsim.render.sampling.sobol import reverse_bits

GRADES = 6
"""Numbers of paths among which a pixel has its choice: the probe, doubled again and again, and the full number."""
CLOSER = 0x80
"""Bit of a pixel's grade that tells of more first-hit rays."""
_CLOSER = wp.constant(CLOSER)
_USUAL = wp.constant(12.0)
"""First-hit rays with which shares may be wrong by `SHARE_ERROR` near an event; by less, where there are more."""
_GLOW = wp.constant(1.0e-5)
"""Part of the light straight from lamps that what shines by itself has at least; less is rounding."""
_ALIKE = wp.constant(2.0)
"""Times the first-hit rays that look near an event at the least."""
_LEAST = wp.constant(0.2)
"""A difference kept from an earlier frame takes away at most all but this share of the probe's irradiance."""


@wp.struct
class Steering:
    """How many samples pixels get in this frame.

    At the grade ``top`` it is the full number. ``before`` is the probe of the frame before where the numbers of paths
    have changed since, else 0.
    """

    looks: Looks
    probe: int
    before: int
    top: int
    every: int
    turn: int


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
def _corrected(grade: int, known: int, before: int) -> int:
    """Return the grade whose correction is added: none, −1, where that of another number of paths is."""
    base = wp.min(grade, known - 1)
    if known == 0:
        base = grade
    if before > 0:
        base = int(-1)
    return base


@wp.func
def _rays_at_event(things: wp.array(dtype=Thing), number: int, weights: wp.vec3, looks: Looks) -> int:
    """Return how many rays look near an event, by how different the things are that a first look saw.

    Colours count, and how light straight from lamps differs from thing to thing, and not how much light there is: where
    that alone changes, as many look. Some more look where all are alike: small things are easily missed. Where
    something shines by itself, or there is a background, all look.
    """
    own = float(0.0)
    colour = float(0.0)
    colours = float(0.0)
    lit = float(0.0)
    lights = float(0.0)
    for k in range(number):
        share = things[k].share
        own = wp.max(own, brightness(things[k].emission - things[k].from_lamps, weights))
        if not things[k].first.hit:
            own = 1.0
        one = brightness(things[k].albedo, weights)
        colour += one * share
        colours += one * one * share
        one = brightness(things[k].from_lamps, weights)
        lit += one * share
        lights += one * one * share
    most = float(looks.at_event)
    error = SHARE_ERROR * _USUAL / float(looks.most)
    needed = wp.max(rays_needed(colour, colours, error), rays_needed(lit, lights, error))
    if own > _GLOW * lit:
        needed = most
    return int(wp.clamp(needed, wp.min(_ALIKE * float(looks.most), most), most))


@wp.func
def _lit(things: wp.array(dtype=Thing), number: int, e: wp.vec3) -> wp.vec3:
    """Return the radiance of what is seen, in light of that irradiance over π."""
    radiance = wp.vec3()
    for k in range(number):
        radiance += (things[k].emission + wp.cw_mul(things[k].albedo, e)) * things[k].share
    return radiance


def make_steered(
    sobol: bool,
    look: Any,
    shoot: Any,
    scene_type: Any,
    view_type: Any,
    settings_type: Any,
    options: Any,
) -> Any:
    """Return the kernel; a thread is ``pixels`` pixels, or corners of pixels in the pass that fills ``corners``.

    ``grades`` is uint8 ``[H·W]``: 0 where the probe will do and may wait for its turn, else 1 more than how often it is
    doubled; beyond ``steering.top`` doublings, all ``settings.samples`` paths are wanted. `CLOSER` is added where more
    first-hit rays are to count shares. Kept from frame to frame: ``irradiance``, vec3 ``[H·W]``, of the last frame;
    ``correction``, vec3 ``[GRADES, H·W]``, by which it differed from that of each grade's paths when these were last
    traced; ``known``, int32 ``[H·W]``: for how many grades, from the lowest, there is a correction. ``out_spent`` int32
    ``[2, H·W]`` counts first-hit rays and paths.
    """

    @wp.kernel(module="unique", enable_backward=False, module_options=options)
    def render_steered(
        scene: scene_type,
        camera: view_type,
        settings: settings_type,
        first_pixel: int,
        pixels: int,
        corner_pass: bool,
        corners: wp.array(dtype=Sample),
        steering: Steering,
        grades: wp.array(dtype=wp.uint8),
        irradiance: wp.array(dtype=wp.vec3),
        correction: wp.array2d(dtype=wp.vec3),
        known: wp.array(dtype=int),
        out_planes: wp.array2d(dtype=float),
        out_spent: wp.array2d(dtype=int),
    ):
        # Room is made, and arguments are copied, once for all pixels of a thread.
        things = wp.zeros(shape=wp.static(THINGS), dtype=Thing)
        first = first_pixel + wp.tid() * pixels
        for pixel in range(first, first + pixels):
            state = sampling.absorb(settings.stream, pixel)
            corner = wp.where(corner_pass, pixel, -1)
            nearest = wp.where(corner_pass, pixel, pixel + pixel // settings.width)
            row = settings.width + 1
            looks = steering.looks
            seen = Seen()
            done = int(0)
            while looks.most > done:
                done = looks.most
                seen = look(
                    scene, camera, settings, pixel, 0, state, looks, corner, corners, nearest, row, seen, Shadows(),
                    things,
                )  # fmt: skip
                if corner_pass:
                    break
                closer = (int(grades[pixel]) & _CLOSER) > 0 and looks.at_event > looks.most
                if seen.counted and closer and done == steering.looks.most:
                    looks.most = _rays_at_event(things, seen.things, settings.spectral, looks)
            if corner_pass:
                continue
            graded = int(grades[pixel]) & (_CLOSER - 1)
            grade = wp.clamp(graded - 1, 0, steering.top)
            wanted = wp.max(_paths_of(grade, steering, settings.samples), steering.before)
            # Diagonals, so that each who waits has neighbours on all sides who do not.
            turn = pixel % settings.width + pixel // settings.width + steering.turn
            waits = graded == 0 and steering.before == 0 and turn % steering.every != 0
            # What paths find is of surfaces: where none is seen they are not wanted, and nothing is known of the next.
            # Where one has just come into view they are, as nothing is known there.
            if covered_by(things, seen.things) == 0.0:
                wanted = int(0)
                known[pixel] = 0
            elif waits and known[pixel] > 0:
                wanted = int(0)
            base = _corrected(grade, known[pixel], steering.before)
            kept = wp.vec3()
            if known[pixel] > 0:
                kept = correction[wp.max(base, 0), pixel]
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
                    e = _irradiance(sums, last - kept)
                if paths == next_paths and traced <= steering.top:
                    if traced == base:
                        e = _irradiance(sums, last - kept)
                    # Until the picture's irradiance is known, that of the grade.
                    correction[traced, pixel] = _irradiance(sums, last)
                    traced = traced + 1
                    next_paths = _paths_of(traced, steering, settings.samples)

            if paths > 0:
                e = _beside(e, kept)
                for i in range(traced):
                    correction[i, pixel] = e - correction[i, pixel]
                if steering.before == 0:
                    traced = wp.max(traced, known[pixel])
                # Paths may all have missed the surface that first-hit rays saw.
                if sums.albedo[0] > 0.0:
                    known[pixel] = traced
                irradiance[pixel] = e
            shown = _lit(things, seen.things, e)
            store_things(things, seen.things, seen.rays + paths, shown, settings.spectral, pixel, out_planes)
            out_spent[0, pixel] = seen.rays
            out_spent[1, pixel] = paths

    return render_steered
