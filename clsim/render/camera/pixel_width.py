"""The width of a camera's pixels at a distance.

Seen through most lenses they are so many radians wide, and what they show is the wider the farther away it is; through
an orthographic one they are so many metres wide wherever that is. A pixel is both numbers, of which one is 0.
"""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from clsim.scene import Camera

_ANGLES = 1024
"""Angles from the axis at which a lens is sampled."""


@wp.func
def width_at(pixel: wp.vec2, depth: float) -> float:
    """Return how wide a pixel is at that distance [m]."""
    return float(wp.where(pixel[0] > 0.0, depth * pixel[0], pixel[1]))


def pixel_of(camera: Camera) -> tuple[float, float]:
    """Return how wide a pixel is on average [rad], along a row through the middle and without distortion, and [m]."""
    if camera.lens.model == "orthographic":
        return 0.0, camera.lens.view_width_m / camera.width
    return math.radians(camera.fov_deg) / camera.width, 0.0


def widest_pixel(camera: Camera) -> float:
    """Return the width of the widest pixel [rad], from the axis outwards or around it, by OpenCV's models.

    Tangential distortion is left out, and the lens is not orthographic.
    """
    fov, lens = math.radians(camera.fov_deg), camera.lens
    k = (*lens.distortion, *[0.0] * (5 - len(lens.distortion)))
    fisheye = lens.model == "fisheye"
    angle = np.linspace(1e-4, min(fov, math.pi) if fisheye else math.pi / 2 - 1e-4, _ANGLES)
    if fisheye:
        t = angle**2
        radius = angle * (1.0 + t * (k[0] + t * (k[1] + t * (k[2] + t * k[3]))))
    else:
        r2 = np.tan(angle) ** 2
        radius = np.tan(angle) * (1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4])))
    x, y = lens.principal_point
    fx, fy = map(abs, camera.focal_px())
    corner = math.hypot(camera.width * (0.5 + abs(x)) / fx, (camera.height / 2.0 + camera.width * abs(y)) / fy)
    # Beyond the fold of the distortion, or the picture's corner, there are no pixels.
    folds = np.flatnonzero(np.diff(radius) <= 0.0)
    seen = slice(0, min(folds[0] if len(folds) else _ANGLES, int(np.searchsorted(radius, corner)) + 1))
    outwards = np.diff(angle[seen]) / np.diff(radius[seen])
    around = np.sin(angle[seen]) / radius[seen]
    return float(max(outwards.max(initial=0.0), around.max()) / min(fx, fy))
