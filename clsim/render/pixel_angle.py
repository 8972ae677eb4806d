"""How wide the pixels of a camera are, as angles seen from it."""

from __future__ import annotations

import math

import numpy as np

from clsim.scene import Camera

_ANGLES = 1024
"""Angles from the axis at which a lens is looked at."""


def pixel_angle(camera: Camera) -> float:
    """Return the width of a pixel on average [rad], along a row through the middle and without distortion."""
    return math.radians(camera.fov_deg) / camera.width


def widest_pixel(camera: Camera) -> float:
    """Return the width of the widest pixel [rad], from the axis outwards or around it, by OpenCV's models.

    Tangential distortion is left out.
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
