# ruff: noqa: UP018
"""Camera rays, through places in a picture and in time, as Warp functions."""

from typing import Any

import warp as wp

from clsim.render.camera.camera import CameraState, make_camera
from clsim.render.camera.film import Sample
from clsim.render.features.features import Features
from clsim.render.kernel_input import Scene, Settings
from clsim.render.sampling import sampling
from clsim.render.sampling.sobol import make_sampler


def make_shoot_at(features: Features, trace: Any) -> Any:
    """Return the Warp function ``shoot_at(scene, camera, settings, pixel, place, instant, stream, width, wanted)``.

    Args:
        features: what the kernel is built for.
        trace: follows a path or a primary ray: ``trace(scene, start, toward, time, settings, stream, width, wanted)``,
            which returns a `Sample`.
    """
    camera_ray = make_camera(features)
    uniform2 = make_sampler(features.sobol)

    def shoot_at(
        scene: Scene,
        camera: CameraState,
        settings: Settings,
        pixel: int,
        place: wp.vec2,
        instant: int,
        stream: sampling.Stream,
        width: wp.vec2,
        wanted: bool,
    ) -> Sample:
        """Follow a ray through a place in a pixel, whose corners are at 0 and 1, if it is ``wanted``.

        A primary ray sees the mean of a texture over a square: a pixel of that ``width``, if it is not 0.
        """
        lens = wp.vec2()
        if wp.static(features.aperture):
            lens = uniform2(stream, sampling.LENS)
        shutter = float(0.0)
        if wp.static(features.camera_blur or features.motion_blur):
            shutter = uniform2(stream, sampling.TIME)[0]
        time = settings.opens + settings.lasts * shutter
        if wp.static(features.requests):
            shutter = float(instant)
            time = float(instant)
        x = float(pixel % settings.width)
        y = float(pixel // settings.width)
        ray = camera_ray(camera, x + place[0], y + place[1], lens, shutter)
        wanted_ray = wanted and ray.exists
        return trace(scene, ray.origin, ray.direction, time, settings, stream, width, wanted_ray)

    # Inlined, and ``trace`` too: a function of its own would copy the scene for each ray.
    return wp.func(shoot_at, inline=True)  # type: ignore[call-overload]


def make_shoot(sobol: bool, shoot_at: Any) -> Any:
    """Return the Warp function ``shoot(scene, camera, settings, pixel, instant, stream)``, from a random place."""
    uniform2 = make_sampler(sobol)

    @wp.func(inline=True)
    def shoot(
        scene: Scene, camera: CameraState, settings: Settings, pixel: int, instant: int, stream: sampling.Stream
    ) -> Sample:
        place = uniform2(stream, sampling.CAMERA)
        return shoot_at(scene, camera, settings, pixel, place, instant, stream, wp.vec2(), True)

    return shoot
