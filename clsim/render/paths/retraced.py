# Warp: a variable that changes must be born by a call.
# ruff: noqa: UP018, RUF046
"""The kernels that trace chosen pixels at chosen times, with the random numbers that these pixels have in every frame.

So a pixel has the same bits at the same time, whether a frame or a request asked for it.
"""

from typing import Any

import warp as wp

from clsim.render.cache.kept_light import Gathering, Lit, light_of, seen_light
from clsim.render.cache.light_cache import Cell, Followed
from clsim.render.camera.film import Sample
from clsim.render.primary.closer_look import SHARE_ERROR, look_closer
from clsim.render.primary.corners import corner_near
from clsim.render.primary.first_hits import Looks, Seen
from clsim.render.primary.lamp_light import same_light
from clsim.render.primary.shadow_rays import Shadow, Shadows
from clsim.render.primary.things import THINGS, Thing, store_things
from clsim.render.sampling import sampling

_ROW, _FIRST = wp.constant(4), wp.constant(5)
"""Corners of a pixel lie in the middle of so many to a row, from that one on; around it are those next to them."""
_LAST = wp.constant(12)
"""Corners that are looked through before the pixel."""


@wp.func
def _are_lit_alike(corners: wp.array(dtype=Sample)) -> bool:
    """Whether light of lamps was found at a pixel's own corners, as far as they asked, and the same share of it."""
    asker = int(_FIRST)
    alike = bool(True)
    for i in range(1, 4):
        other = _FIRST + (i & 1) + (i // 2) * _ROW
        alike = alike and same_light(corners[other], corners[asker])
        if corners[asker].lamp_all <= 0.0:
            asker = other
    return alike and corners[asker].lamp_all > 0.0


def make_retraced(
    look: Any,
    gather: Any,
    store: Any,
    wide_lamps: bool,
    scene_type: Any,
    view_type: Any,
    settings_type: Any,
    options: Any,
) -> tuple[Any, Any, Any]:
    """Return three kernels, of which a thread is a request: all paths of the pixel, its first-hit rays alone, or these
    in the light that is kept on surfaces.

    ``pixels`` and ``instants``, int32 ``[N]``, tell the pixel (y·width + x) and the instant of each request;
    ``out_planes``, float32 ``[C, N]``, is as for frames, and ``out_bits`` the same memory as unsigned integers. Of
    first-hit rays alone, the plane of radiance is that of emission, and ``looks`` tells how many there are. Kept light
    is that in which the last frame is seen (``cached.py``); ``passed``, float ``[instants]``, is the share of the time
    from the frame before to the last one that has passed, −1 where that is not asked, and the shadows are theirs.
    ``light_passed`` is the same for kept light, which changes along a line.
    ``wide_lamps`` is whether first-hit rays ask lamps that have a size.
    """

    @wp.kernel(module="unique", enable_backward=False, module_options=options)
    def retrace_paths(
        scene: scene_type,
        camera: view_type,
        settings: settings_type,
        first: int,
        count: int,
        pixels: wp.array(dtype=int),
        instants: wp.array(dtype=int),
        out_planes: wp.array2d(dtype=float),
        out_bits: wp.array2d(dtype=wp.uint32),
    ):
        begin = first + wp.tid() * count
        for request in range(begin, begin + count):
            moments = gather(scene, camera, settings, pixels[request], instants[request])
            store(moments, request, out_planes, out_bits)

    # It is put where it is called, as what it calls is: kept apart, the scene would be copied for each pixel.
    @wp.func(inline=True)
    def look_around(
        scene: scene_type,
        camera: view_type,
        settings: settings_type,
        pixel: int,
        instant: int,
        looks: Looks,
        before: Seen,
        shadows: Shadows,
        corners: wp.array(dtype=Sample),
        things: wp.array(dtype=Thing),
    ) -> Seen:
        """Look through the corners of a pixel, and then at it; or go on from what was seen of it before.

        If these all see lamps in the same light, corners next to them tell whether it lies in a soft shadow.
        """
        state = sampling.absorb(settings.stream, pixel)
        seen = Seen()
        line = pixel // settings.width
        column = pixel - line * settings.width
        i = wp.where(looks.steps > 0 and not before.counted, 0, _LAST)
        while i <= _LAST:
            if i == 4 and not (wp.static(wide_lamps) and _are_lit_alike(corners)):
                i = int(_LAST)
            place = corner_near(i)
            x = column + place[0]
            y = line + place[1]
            if i < _LAST and (x < 0 or y < 0 or x > settings.width or y > settings.height):
                corners[_FIRST + place[0] + place[1] * _ROW] = Sample()
                i = i + 1
                continue
            seen = look(
                scene,
                camera,
                settings,
                pixel,
                instant,
                state,
                looks,
                wp.where(i < _LAST, x + y * (settings.width + 1), -1),
                corners,
                wp.where(i < _LAST, _FIRST + place[0] + place[1] * _ROW, _FIRST),
                _ROW,
                before,
                shadows,
                things,
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
        looks: Looks,
        pixels: wp.array(dtype=int),
        instants: wp.array(dtype=int),
        out_planes: wp.array2d(dtype=float),
    ):
        things = wp.zeros(shape=wp.static(THINGS), dtype=Thing)
        corners = wp.zeros(shape=16, dtype=Sample)
        begin = first + wp.tid() * count
        for request in range(begin, begin + count):
            seen = look_around(
                scene, camera, settings, pixels[request], instants[request], looks, Seen(), Shadows(), corners, things
            )
            emission = wp.vec3()
            for k in range(seen.things):
                emission += things[k].emission * things[k].share
            store_things(things, seen.things, seen.rays, emission, settings.spectral, request, out_planes)

    @wp.kernel(module="unique", enable_backward=False, module_options=options)
    def retrace_in_kept_light(
        scene: scene_type,
        camera: view_type,
        settings: settings_type,
        first: int,
        count: int,
        steering: Gathering,
        cells: wp.array(dtype=Cell),
        followed: wp.array(dtype=Followed),
        own: wp.array(dtype=wp.vec3),
        own_before: wp.array(dtype=wp.vec3),
        learnt: wp.array(dtype=float),
        shadows_before: wp.array(dtype=Shadow),
        shadows_after: wp.array(dtype=Shadow),
        passed: wp.array(dtype=float),
        light_passed: wp.array(dtype=float),
        pixels: wp.array(dtype=int),
        instants: wp.array(dtype=int),
        out_planes: wp.array2d(dtype=float),
    ):
        things = wp.zeros(shape=wp.static(THINGS), dtype=Thing)
        corners = wp.zeros(shape=16, dtype=Sample)
        begin = first + wp.tid() * count
        for request in range(begin, begin + count):
            pixel = pixels[request]
            gathering = steering
            gathering.asked.to_go = 1.0 - light_passed[instants[request]]
            looks = steering.looks
            lit = Lit()
            seen = Seen()
            shadows = Shadows()
            shadows.share = passed[instants[request]]
            if shadows.share >= 0.0:
                shadows.before = shadows_before[pixel]
                shadows.after = shadows_after[pixel]
            last = int(0)
            while looks.most > last:
                last = looks.most
                seen = look_around(
                    scene, camera, settings, pixel, instants[request], looks, seen, shadows, corners, things
                )
                lit = light_of(cells, followed, things, seen.things, gathering, settings.spectral)
                looks = look_closer(lit.brightness, lit.squares, seen, steering.looks, looks, SHARE_ERROR, False)
            shown = seen_light(lit, steering, own[pixel], own_before[pixel], learnt[pixel], settings.spectral)
            store_things(things, seen.things, seen.rays, shown, settings.spectral, request, out_planes)

    return retrace_paths, retrace_first_hits, retrace_in_kept_light
