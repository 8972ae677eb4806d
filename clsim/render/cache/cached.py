# Warp: a variable that changes must be born by a call, and wp.static drops a branch only where it stands alone.
# ruff: noqa: UP018, RUF046
"""The kernel that takes light from what is kept on surfaces, and traces paths to know it better.

A pixel's first-hit rays see what is there, by the same random numbers in every frame. Each takes the light at its own
first hit from the cells of ``light_cache.py``, so that where a pixel shows two surfaces, each has its own light.
Paths have random numbers of their own in every frame, and only what they add to the cells is seen: in the next frame.
A pixel traces few of them, and the full number where little is known.

Some pixels may be looked at again, by other random numbers in the same light, which counts as somewhat wrong: what two
looks differ by is noise.

Where pixels are traced between frames, they are seen in the light as it was known before the frame that ends the step,
and so is that frame: brightness is then the same whatever the frames' times.
"""

from typing import Any

import warp as wp

from clsim.render.accel.geometry import transform_vector
from clsim.render.cache.kept_light import Gathering, Lit, finished, gain, is_smooth, light_of, shown_in, wrong_by
from clsim.render.cache.light_cache import Cell, Followed
from clsim.render.cache.light_grid import layer_of
from clsim.render.cache.stored_paths import OWN, Met
from clsim.render.camera.film import Sample
from clsim.render.camera.pixel_width import width_at
from clsim.render.kernel_input import spectral_of
from clsim.render.primary.closer_look import SHARE_ERROR, error_allowed, fire, level_of, look_closer
from clsim.render.primary.first_hits import Seen
from clsim.render.primary.shadow_rays import Shadow, Shadows
from clsim.render.primary.things import THINGS, Thing, lit_albedo, store_things
from clsim.render.sampling import sampling
from clsim.render.sampling.sampling import brightness
from clsim.render.sampling.sobol import reverse_bits

_AGAIN = wp.constant(-3)
"""Number of the random numbers of a second look."""
_OFF = wp.constant(0.5**0.5)
"""Standard errors of the light by which two looks are wrong, one up and one down: so they differ as two runs do."""


def make_cached(
    sobol: bool,
    anchored: bool,
    moves: bool,
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

    ``learnt_twice``, float ``[3, H·W / n]``, is ``learnt`` of the second look at every n-th pixel last, and what either
    has learnt more where the light might be off.

    ``own_before`` and ``learnt_before`` are copies of both from before the last frame that traced any path, and asked
    for only where the light is shown as it was ``earlier``.

    ``out_shadows`` ``[H·W]`` tells of pixels in soft shadows which rays reach the lamps, where that is asked for.

    Once a frame is done, a pass with ``again`` = n > 0, whose threads are every n-th pixel, looks at these once more.
    It writes to ``learnt_twice`` and ``out_twice`` ``[2, H·W / n]`` alone: the second has the luminance of what the
    frame shows, and of what they see, one somewhat brighter and one darker, by how far the light might be off.
    """

    @wp.func
    def met_by(scene: scene_type, sample: Sample) -> Met:
        met = Met()
        met.instance = sample.instance
        if sample.instance >= 0:
            met.triangle = sample.met_triangle
            met.weights = sample.weights
            met.front = sample.front
            met.toward = sample.toward
            if wp.static(moves):
                met.toward = transform_vector(scene.geometry.to_object[sample.instance], sample.toward)
        return met

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
        followed: wp.array(dtype=Followed),
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
        out_met: wp.array2d(dtype=Met),
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
            spectral = spectral_of(settings, pixel)
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
                lit = light_of(cells, followed, things, seen.things, gathering, spectral)
                error = float(SHARE_ERROR)
                told = steering.event.on > 0.0
                if told and seen.counted:
                    so_far = finished(lit, own[pixel], own[pixel], spectral)
                    gained = wp.where(again > 0, 0.0, gain(so_far, spectral))
                    level = level_of(shown_in(so_far, False, learnt[pixel] + gained), steering.event, spectral)
                    error = error_allowed(level, fired[pixel], steering.event)
                looks = look_closer(lit.brightness, lit.squares, seen, steering.looks, looks, error, told)
            if corner_pass:
                continue
            if steering.tells_shadows and again == 0:
                out_shadows[pixel] = seen.shadow
            if again > 0:
                lit = finished(lit, own[pixel], own_before[pixel], spectral)
                # Its rays end elsewhere in the cells, which learn something else there.
                learnt_then = learnt_twice[2, number]
                if settings.samples > 0:
                    learnt_twice[2, number] = learnt_then + gain(lit, spectral)
                if not steering.earlier:
                    learnt_then = learnt_twice[2, number]
                shows = wp.vec3(out_planes[0, pixel], out_planes[1, pixel], out_planes[2, pixel])
                sees = shown_in(lit, steering.earlier, learnt_then)
                for one in range(2):
                    off, gained = wrong_by(lit, wp.where(one == 0, _OFF, -_OFF), steering.earlier, spectral)
                    seen_by = brightness(wp.where(one == 0, shows, sees), spectral)
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
                stream.key = sampling.stream_key(sampling.absorb(state, OWN + number))
                sample = shoot(scene, camera, settings, pixel, 0, stream)
                if sample.hit and sampling.finite(sample.radiance) and sampling.finite(sample.normal):
                    reflected = sample.radiance - sample.emission
                    p = sample.position
                    n = sample.normal
                    instance = int(-1)
                    if wp.static(anchored):
                        p = sample.rest
                        n = sample.rest_normal
                        instance = sample.instance
                        out_met[i, pixel] = met_by(scene, sample)
                    where = wp.vec4(p[0], p[1], p[2], width_at(steering.cell, sample.depth))
                    layer = layer_of(wp.where(sample.in_coat, 1, 0), instance)
                    kind = float(2 * layer) + wp.where(is_smooth(sample, steering), 1.0, 0.0)
                    out_normals[i, pixel] = wp.vec4(n[0], n[1], n[2], kind)
                    out_lights[i, pixel] = wp.cw_div(reflected, lit_albedo(sample))
                    if not sample.in_coat:
                        radiance = radiance + reflected
                        albedo = albedo + lit_albedo(sample)
                out_positions[i, pixel] = where
            if albedo[0] > 0.0:
                own[pixel] = wp.cw_div(radiance, albedo)
            traced[pixel] = traced[pixel] + wanted
            lit = finished(lit, own[pixel], before, spectral)
            learnt_so_far = learnt[pixel]
            if settings.samples > 0:
                learnt[pixel] = learnt_so_far + gain(lit, spectral)
                out_spent[1, pixel] = wanted
            if not steering.earlier:
                learnt_so_far = learnt[pixel]
            shown = shown_in(lit, steering.earlier, learnt_so_far)
            if steering.event.on > 0.0:
                level = level_of(shown, steering.event, spectral)
                fired[pixel] = fire(level, fired[pixel], steering.event)
            store_things(things, seen.things, seen.rays + wanted, shown, settings.spectral, pixel, out_planes)
            out_spent[0, pixel] = seen.rays

    return render_cached
