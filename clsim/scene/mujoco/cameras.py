"""MuJoCo's cameras: what their lenses see, as one of ours."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from clsim.scene.motion import Matrix, Motion, compose
from clsim.scene.world import Camera, Lens

FREE = -1
"""Number of the camera with which MuJoCo's own viewer starts, for models that have none."""


def free_pose(model: Any) -> Matrix:
    """Return where MuJoCo's free camera stands at first, in MuJoCo's world ``[4, 4]``; it looks along −z."""
    import mujoco

    eye = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, eye)
    turn, tilt = math.radians(eye.azimuth), math.radians(eye.elevation)
    ahead = np.array([math.cos(tilt) * math.cos(turn), math.cos(tilt) * math.sin(turn), math.sin(tilt)])
    right = np.array([math.sin(turn), -math.cos(turn), 0.0])
    return compose(eye.lookat - eye.distance * ahead, np.stack([right, np.cross(right, ahead), -ahead], axis=1))


def camera_of(model: Any, index: int, resolution: tuple[int, int], motion: Motion) -> Camera:
    """Return a camera of the model.

    A camera with a ``sensorsize`` has its intrinsics: focal lengths along both axes and a principal point, for the
    whole sensor, whatever the resolution; others their vertical field of view, with square pixels; orthographic ones
    the height of what they see.

    Args:
        model: an ``MjModel``.
        index: number of the camera, or ``FREE``.
        resolution: width and height [pixels].
        motion: where it is.
    """
    width, height = resolution
    if _is_orthographic(model, index):
        # Its field of view is a height, in metres.
        height_m = float(model.vis.global_.fovy if index == FREE else model.cam_fovy[index])
        lens = Lens(model="orthographic", view_width_m=height_m * width / height)
        return Camera(width, height, 45.0, motion, lens=lens)
    if index == FREE:
        upward = math.tan(math.radians(float(model.vis.global_.fovy)) / 2)
        return Camera(width, height, 2 * math.degrees(math.atan(upward * width / height)), motion)
    sensor_m = np.asarray(model.cam_sensorsize[index], np.float64)
    upward = math.tan(math.radians(float(model.cam_fovy[index])) / 2)
    if (sensor_m > 0).all():
        fx, fy, cx, cy = map(float, model.cam_intrinsic[index])
        across = float(sensor_m[0]) / fx
        aspect = (width / across) / (height / float(sensor_m[1]) * fy)
        # MuJoCo's frustum is off to the right for a positive x, so that its axis is left of the picture's middle; a
        # positive y lowers the frustum, and the axis is above.
        offset = -cx / float(sensor_m[0]), -cy / float(sensor_m[1]) * height / width
        fov = 2 * math.degrees(math.atan(across / 2))
        return Camera(width, height, fov, motion, lens=Lens(principal_point=offset, aspect=aspect))
    fov = 2 * math.degrees(math.atan(upward * width / height))
    return Camera(width, height, fov, motion)


def _is_orthographic(model: Any, index: int) -> bool:
    if index == FREE:
        return bool(model.vis.global_.orthographic)
    if hasattr(model, "cam_projection"):
        return bool(model.cam_projection[index] != 0)
    return bool(getattr(model, "cam_orthographic", np.zeros(index + 1))[index])
