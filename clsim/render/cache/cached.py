# ruff: noqa: SIM102, UP018, RUF046
"""The kernel that shades pixels from the radiance cache, and traces paths that refine it.

A pixel's primary rays have the same random numbers in every frame. Each takes the light at its own first hit from the
cells of ``light_cache.py``, so that where a pixel shows two surfaces, each has its own light. Paths have new random
numbers in every frame. What they find is added to the cells, and shown from the next frame on. A pixel traces few of
them, and the full number where little is known.

Some pixels may be sampled a second time, with other random numbers and the same cache, whose error is added to one
estimate and taken off the other. The difference between the two estimates is noise.

Where pixels are also traced between frames, they are shaded by the cache as it was before the frame that ends the step,
and so is that frame: brightness then does not depend on the frames' times.
"""

from typing import Any

import warp as wp

from clsim.render.accel.geometry import transform_vector
from clsim.render.cache.cached_light import (
    GatheredLight,
    Gathering,
    finished,
    gain,
    holds_lamps,
    is_smooth,
    light_of,
    shown_in,
    wrong_by,
)
from clsim.render.cache.light_cache import Cell, Followed
from clsim.render.cache.light_grid import layer_of
from clsim.render.cache.stored_hits import StoredHits, corner_stays, pixel_stays, store_hits, stored_surfaces
from clsim.render.cache.stored_paths import OWN, Met
from clsim.render.camera.film import Sample
from clsim.render.camera.pixel_width import width_at
from clsim.render.kernel_input import spectral_of
from clsim.render.primary.first_hits import Seen
from clsim.render.primary.refinement import SHARE_ERROR, error_allowed, fire, level_of, refine_primary_rays
from clsim.render.primary.seen_surfaces import MOST_SURFACES, SeenSurface, lit_albedo, store_surfaces
from clsim.render.primary.shadow_rays import Shadow, Shadows
from clsim.render.sampling import sampling
from clsim.render.sampling.sampling import brightness
from clsim.render.sampling.sobol import reverse_bits

_DUPLICATE = wp.constant(-3)
"""Number of the random numbers of a duplicate sample."""
_OFF = wp.constant(0.5**0.5)
"""Standard errors of cached light added to one estimate and taken off the other: so they differ as two runs do."""


def make_cached(
    sobol: bool,
    anchored: bool,
    moves: bool,
    stores: bool,
    sample_primary: Any,
    shoot: Any,
    scene_type: Any,
    view_type: Any,
    settings_type: Any,
    options: Any,
) -> Any:
    """Return the kernel; a thread is ``pixels`` pixels, or corners of pixels in the pass that fills ``corners``.

    State from frame to frame: ``own``, vec3 ``[H·W]``, is the irradiance that a pixel's own paths found last;
    ``traced``, int32 ``[H·W]``, how many paths it ever had; ``learnt``, float ``[H·W]``, by how much its log luminance
    has changed in all because the cache became better. Where ``settings.samples`` is 0 no path is traced, and
    ``learnt`` does not change. ``out_positions``, ``out_normals`` and ``out_lights`` ``[settings.samples, H·W]`` tell
    where the paths of the frame began and what they found (``light_cache.py``). ``out_spent`` int32 ``[2, H·W]`` counts
    primary rays, and the paths of the last frame that traced any.

    ``fired``, float ``[H·W]``, is the level at which each pixel fired last, NaN before the first frame. It is state
    too, where ``steering.event`` has thresholds. So is ``rays``, int32 ``[H·W]``, the largest number of primary rays
    that each pixel might get in the last frame.

    ``duplicate_learnt``, float ``[3, H·W / n]``, holds in its last row ``learnt`` of the second estimate of every n-th
    pixel, and in the others what each estimate has learnt more because of its assumed error.

    ``own_before`` is a copy of ``own`` from before the last frame that traced any path. It is read only where the light
    is shown as it was ``earlier``.

    ``out_shadows`` ``[H·W]`` records which rays of pixels in soft shadows reach the lamps, if ``tells_shadows``.

    Where kernels have ``stores``, ``stored`` has what pixels saw in the last frame (`stored_hits.py`).

    Once a frame is done, a pass with ``duplicate_every`` = n > 0, whose threads are every n-th pixel, samples these a
    second time. It writes to ``duplicate_learnt`` and ``out_duplicate`` ``[2, H·W / n]`` alone. The latter gets the
    luminance of the frame and that of the second sample, one raised and one lowered by the error of the cached light.
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
        corners: wp.array[Sample],
        steering: Gathering,
        stored: StoredHits,
        cells: wp.array[Cell],
        followed: wp.array[Followed],
        own: wp.array[wp.vec3],
        traced: wp.array[int],
        learnt: wp.array[float],
        fired: wp.array[float],
        rays: wp.array[int],
        own_before: wp.array[wp.vec3],
        duplicate_learnt: wp.array2d[float],
        duplicate_every: int,
        out_planes: wp.array2d[float],
        out_duplicate: wp.array2d[float],
        out_positions: wp.array2d[wp.vec4],
        out_normals: wp.array2d[wp.vec4],
        out_lights: wp.array2d[wp.vec3],
        out_met: wp.array2d[Met],
        out_spent: wp.array2d[int],
        out_shadows: wp.array[Shadow],
    ) -> None:
        # Room is made, and arguments are copied, once for all pixels of a thread.
        surfaces = wp.zeros(shape=wp.static(MOST_SURFACES), dtype=SeenSurface)
        gathering = steering
        gathering.asked.tells_error = duplicate_every > 0
        first = first_pixel + wp.tid() * pixels
        for number in range(first, first + pixels):
            pixel = number * wp.max(duplicate_every, 1)
            spectral = spectral_of(settings, pixel)
            state = sampling.absorb(settings.stream, pixel)
            if duplicate_every > 0:
                state = sampling.absorb(state, _DUPLICATE)
            stream = sampling.Stream()
            corner = wp.where(corner_pass, pixel, -1)
            nearest = wp.where(corner_pass, pixel, pixel + pixel // settings.width)
            row = settings.width + 1
            primary_rays = steering.primary_rays
            gathered = GatheredLight()
            seen = Seen()
            last = int(0)
            error = float(SHARE_ERROR)
            told = steering.event.on > 0.0
            stays = bool(False)
            if wp.static(stores):
                if corner_pass:
                    if corner_stays(stored, corners[nearest]):
                        continue
                else:
                    stays = duplicate_every == 0 and pixel_stays(stored, pixel)
            least_rays = int(0)
            if steering.stands and not corner_pass:
                least_rays = rays[pixel]
            while primary_rays.most > last:
                last = primary_rays.most
                if stays:
                    seen = stored_surfaces(stored, pixel, surfaces)
                else:
                    seen = sample_primary(
                        scene,
                        camera,
                        settings,
                        pixel,
                        0,
                        state,
                        primary_rays,
                        corner,
                        corners,
                        nearest,
                        row,
                        seen,
                        Shadows(),
                        surfaces,
                    )
                if corner_pass:
                    break
                gathered = light_of(cells, followed, surfaces, seen.surfaces, gathering, spectral)
                if told and seen.counted:
                    so_far = finished(gathered, own[pixel], own[pixel], spectral)
                    gained = wp.where(duplicate_every > 0, 0.0, gain(so_far, settings.darkest, learnt[pixel], spectral))
                    level = level_of(shown_in(so_far, False, learnt[pixel] + gained), steering.event, spectral)
                    error = error_allowed(level, fired[pixel], steering.event)
                if stays:
                    least_rays = stored.pixels[pixel].most
                primary_rays = refine_primary_rays(
                    gathered.brightness,
                    gathered.squares,
                    settings.darkest,
                    seen,
                    steering.primary_rays,
                    primary_rays,
                    error,
                    # Gloss shows nothing small: how much its rays differ says how many it needs.
                    told and not surfaces[0].first.spread,
                    least_rays,
                )
                if stays:
                    stays = primary_rays.most == stored.pixels[pixel].most
                    primary_rays = steering.primary_rays
                    if not stays:
                        # In other light, or near an event, it needs more rays.
                        least_rays = rays[pixel]
                        seen = Seen()
                        last = 0
            if corner_pass:
                continue
            if wp.static(stores):
                if stored.writes and not stays and duplicate_every == 0:
                    fewest = steering.primary_rays
                    most = refine_primary_rays(
                        gathered.brightness, gathered.squares, settings.darkest, seen, fewest, fewest, error, told, 0
                    ).most
                    store_hits(stored, pixel, seen, most, surfaces)
            if not stays and duplicate_every == 0:
                rays[pixel] = primary_rays.most
            if steering.tells_shadows and duplicate_every == 0:
                out_shadows[pixel] = seen.shadow
            if duplicate_every > 0:
                gathered = finished(gathered, own[pixel], own_before[pixel], spectral)
                # Its rays hit other cells, which learn something else.
                learnt_then = duplicate_learnt[2, number]
                if settings.samples > 0:
                    duplicate_learnt[2, number] = learnt_then + gain(gathered, settings.darkest, learnt_then, spectral)
                if not steering.earlier:
                    learnt_then = duplicate_learnt[2, number]
                shows = wp.vec3(out_planes[0, pixel], out_planes[1, pixel], out_planes[2, pixel])
                sees = shown_in(gathered, steering.earlier, learnt_then)
                for one in range(2):
                    errors = wp.where(one == 0, _OFF, -_OFF)
                    off, gained = wrong_by(gathered, errors, steering.earlier, settings.darkest, spectral)
                    seen_by = brightness(wp.where(one == 0, shows, sees), spectral)
                    duplicate_learnt[one, number] = duplicate_learnt[one, number] + gained
                    then = wp.where(steering.earlier, gained, 0.0)
                    out_duplicate[one, number] = seen_by * wp.exp(off - duplicate_learnt[one, number] + then)
                continue
            wanted = int(settings.samples)
            if gathered.known >= steering.known and gathered.in_finest >= steering.in_finest * gathered.from_lamps:
                phase = pixel % settings.width + pixel // settings.width + steering.phase
                wanted = wp.where(phase % steering.every == 0, steering.probe, 0)
            if gathered.covered == 0.0 and steering.primary_rays.most > 0:
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
                    layer = layer_of(sample.in_coat, holds_lamps(sample, steering), instance)
                    kind = float(2 * layer) + wp.where(is_smooth(sample, sample.in_coat, steering), 1.0, 0.0)
                    out_normals[i, pixel] = wp.vec4(n[0], n[1], n[2], kind)
                    out_lights[i, pixel] = wp.cw_div(reflected, lit_albedo(sample))
                    if not sample.in_coat:
                        radiance = radiance + reflected
                        albedo = albedo + lit_albedo(sample)
                out_positions[i, pixel] = where
            if albedo[0] > 0.0:
                own[pixel] = wp.cw_div(radiance, albedo)
            traced[pixel] = traced[pixel] + wanted
            gathered = finished(gathered, own[pixel], before, spectral)
            learnt_so_far = learnt[pixel]
            if settings.samples > 0:
                learnt[pixel] = learnt_so_far + gain(gathered, settings.darkest, learnt_so_far, spectral)
                out_spent[1, pixel] = wanted
            if not steering.earlier:
                learnt_so_far = learnt[pixel]
            shown = shown_in(gathered, steering.earlier, learnt_so_far)
            if steering.event.on > 0.0:
                level = level_of(shown, steering.event, spectral)
                fired[pixel] = fire(level, fired[pixel], steering.event)
            store_surfaces(surfaces, seen.surfaces, seen.rays + wanted, shown, settings.spectral, pixel, out_planes)
            out_spent[0, pixel] = wp.where(stays, 0, seen.rays)

    return render_cached
