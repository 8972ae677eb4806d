# ruff: noqa: UP018, RUF046
"""The kernels that trace chosen pixels at chosen times, with the random numbers that these pixels have in every frame.

So a pixel has the same bits at the same time, whether a frame or a request asked for it.
"""

from typing import Any

import warp as wp

from clsim.render.cache.cached_light import GatheredLight, Gathering, light_of, seen_light
from clsim.render.cache.light_cache import Cell, Followed
from clsim.render.camera.film import Sample
from clsim.render.primary.corners import corner_near
from clsim.render.primary.first_hits import Seen
from clsim.render.primary.lamp_light import same_light
from clsim.render.primary.ray_numbers import PrimaryRays
from clsim.render.primary.refinement import SHARE_ERROR, refine_primary_rays
from clsim.render.primary.seen_surfaces import MOST_SURFACES, SeenSurface, store_surfaces
from clsim.render.primary.shadow_rays import Shadow, Shadows, asks_neighbours
from clsim.render.sampling import sampling

_ROW, _FIRST = wp.constant(4), wp.constant(5)
"""Corners of a pixel lie in the middle of so many to a row, from that one on; around it are those next to them."""
_LAST = wp.constant(12)
"""Corners that are sampled before the pixel."""


@wp.func
def _are_lit_alike(corners: wp.array[Sample], many: bool) -> bool:
    """Whether light of lamps was found at a pixel's own corners, as far as they asked, and the same share of it."""
    asker = int(_FIRST)
    alike = bool(True)
    for i in range(1, 4):
        other = _FIRST + (i & 1) + (i // 2) * _ROW
        alike = alike and same_light(corners[other], corners[asker])
        if corners[asker].lamp_all <= 0.0:
            asker = other
    return alike and (many or corners[asker].lamp_all > 0.0)


def make_retraced(
    sample_primary: Any,
    gather: Any,
    store: Any,
    wide_lamps: bool,
    scene_type: Any,
    view_type: Any,
    settings_type: Any,
    options: Any,
) -> tuple[Any, Any, Any]:
    """Return three kernels, of which a thread is a request: all paths of the pixel, its primary rays alone, or these
    shaded from the radiance cache.

    ``pixels`` and ``instants``, int32 ``[N]``, tell the pixel (y·width + x) and the instant of each request;
    ``out_planes``, float32 ``[C, N]``, is as for frames, and ``out_bits`` the same memory as unsigned integers. Of
    primary rays alone, the plane of radiance is that of emission, and ``primary_rays`` tells how many there are.
    Cached light is that of the last frame (``cached.py``); ``passed``, float ``[instants]``, is the share of the time
    from the frame before to the last one that has passed, −1 where that is not asked, and the shadows are theirs.
    ``light_passed`` is the same for cached light, which changes linearly.
    ``wide_lamps`` is whether shadow rays go to lamps that have a size.
    """

    @wp.kernel(module="unique", enable_backward=False, module_options=options)
    def retrace_paths(
        scene: scene_type,
        camera: view_type,
        settings: settings_type,
        first: int,
        count: int,
        pixels: wp.array[int],
        instants: wp.array[int],
        out_planes: wp.array2d[float],
        out_bits: wp.array2d[wp.uint32],
    ) -> None:
        begin = first + wp.tid() * count
        for request in range(begin, begin + count):
            moments = gather(scene, camera, settings, pixels[request], instants[request])
            store(moments, request, out_planes, out_bits)

    # Inlined, as what it calls is: a function of its own would copy the scene for each pixel.
    @wp.func(inline=True)
    def sample_with_corners(
        scene: scene_type,
        camera: view_type,
        settings: settings_type,
        pixel: int,
        instant: int,
        primary_rays: PrimaryRays,
        before: Seen,
        shadows: Shadows,
        corners: wp.array[Sample],
        surfaces: wp.array[SeenSurface],
    ) -> Seen:
        """Sample the corners of a pixel, and then the pixel; or go on from what was seen of it before.

        If all corners get the same share of the lamps' light, corners next to them tell whether it is a soft shadow.
        """
        state = sampling.absorb(settings.stream, pixel)
        seen = Seen()
        line = pixel // settings.width
        column = pixel - line * settings.width
        i = wp.where(primary_rays.steps > 0 and not before.counted, 0, _LAST)
        while i <= _LAST:
            around = wp.static(wide_lamps) or asks_neighbours(scene.lights)
            if i == 4 and not (around and _are_lit_alike(corners, asks_neighbours(scene.lights))):
                i = int(_LAST)
            place = corner_near(i)
            x = column + place[0]
            y = line + place[1]
            if i < _LAST and (x < 0 or y < 0 or x > settings.width or y > settings.height):
                corners[_FIRST + place[0] + place[1] * _ROW] = Sample()
                i = i + 1
                continue
            seen = sample_primary(
                scene,
                camera,
                settings,
                pixel,
                instant,
                state,
                primary_rays,
                wp.where(i < _LAST, x + y * (settings.width + 1), -1),
                corners,
                wp.where(i < _LAST, _FIRST + place[0] + place[1] * _ROW, _FIRST),
                _ROW,
                before,
                shadows,
                surfaces,
            )
            i = i + 1
        return seen

    @wp.kernel(module="unique", enable_backward=False, module_options=options)
    def retrace_first_hits(
        scene: scene_type,
        camera: view_type,
        settings: settings_type,
        first: int,
        count: int,
        primary_rays: PrimaryRays,
        pixels: wp.array[int],
        instants: wp.array[int],
        out_planes: wp.array2d[float],
    ) -> None:
        surfaces = wp.zeros(shape=wp.static(MOST_SURFACES), dtype=SeenSurface)
        corners = wp.zeros(shape=16, dtype=Sample)
        begin = first + wp.tid() * count
        for request in range(begin, begin + count):
            seen = sample_with_corners(
                scene,
                camera,
                settings,
                pixels[request],
                instants[request],
                primary_rays,
                Seen(),
                Shadows(),
                corners,
                surfaces,
            )
            emission = wp.vec3()
            for k in range(seen.surfaces):
                emission += surfaces[k].emission * surfaces[k].share
            store_surfaces(surfaces, seen.surfaces, seen.rays, emission, settings.spectral, request, out_planes)

    @wp.kernel(module="unique", enable_backward=False, module_options=options)
    def retrace_in_cached_light(
        scene: scene_type,
        camera: view_type,
        settings: settings_type,
        first: int,
        count: int,
        steering: Gathering,
        cells: wp.array[Cell],
        followed: wp.array[Followed],
        own: wp.array[wp.vec3],
        own_before: wp.array[wp.vec3],
        learnt: wp.array[float],
        shadows_before: wp.array[Shadow],
        shadows_after: wp.array[Shadow],
        passed: wp.array[float],
        light_passed: wp.array[float],
        pixels: wp.array[int],
        instants: wp.array[int],
        out_planes: wp.array2d[float],
    ) -> None:
        surfaces = wp.zeros(shape=wp.static(MOST_SURFACES), dtype=SeenSurface)
        corners = wp.zeros(shape=16, dtype=Sample)
        begin = first + wp.tid() * count
        for request in range(begin, begin + count):
            pixel = pixels[request]
            gathering = steering
            gathering.asked.to_go = 1.0 - light_passed[instants[request]]
            gathering.asked.between = gathering.asked.last_update >= 0
            primary_rays = steering.primary_rays
            gathered = GatheredLight()
            seen = Seen()
            shadows = Shadows()
            shadows.share = passed[instants[request]]
            if shadows.share >= 0.0:
                shadows.before = shadows_before[pixel]
                shadows.after = shadows_after[pixel]
            last = int(0)
            while primary_rays.most > last:
                last = primary_rays.most
                seen = sample_with_corners(
                    scene, camera, settings, pixel, instants[request], primary_rays, seen, shadows, corners, surfaces
                )
                gathered = light_of(cells, followed, surfaces, seen.surfaces, gathering, settings.spectral)
                primary_rays = refine_primary_rays(
                    gathered.brightness,
                    gathered.squares,
                    settings.darkest,
                    seen,
                    steering.primary_rays,
                    primary_rays,
                    SHARE_ERROR,
                    False,
                    0,
                )
            shown = seen_light(gathered, steering, own[pixel], own_before[pixel], learnt[pixel], settings.spectral)
            store_surfaces(surfaces, seen.surfaces, seen.rays, shown, settings.spectral, request, out_planes)

    return retrace_paths, retrace_first_hits, retrace_in_cached_light
