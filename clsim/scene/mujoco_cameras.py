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


def camera_of(model: Any, data: Any, index: int, resolution: tuple[int, int], motion: Motion) -> tuple[Camera, str]:
    """Return a camera of the model, and what of it clsim lacks, as a sentence or nothing.

    A camera with a ``sensorsize`` has its intrinsics: focal lengths along both axes and a principal point, for the
    whole sensor, whatever the resolution; others their vertical field of view, with square pixels.

    Args:
        model: an ``MjModel``.
        data: its ``MjData``, brought up to date.
        index: number of the camera, or ``FREE``.
        resolution: width and height [pixels].
        motion: where it is.
    """
    width, height = resolution
    if index == FREE:
        upward = math.tan(math.radians(float(model.vis.global_.fovy)) / 2)
        return Camera(width, height, 2 * math.degrees(math.atan(upward * width / height)), motion), ""
    sensor_m = np.asarray(model.cam_sensorsize[index], np.float64)
    upward, warning = math.tan(math.radians(float(model.cam_fovy[index])) / 2), ""
    if _is_orthographic(model, index):
        upward = float(model.cam_fovy[index]) / 2 / _middle_m(model, data, index)
        warning = "the orthographic camera is a pinhole that sees as much at the distance of the model's middle"
    elif (sensor_m > 0).all():
        fx, fy, cx, cy = map(float, model.cam_intrinsic[index])
        across = float(sensor_m[0]) / fx
        aspect = (width / across) / (height / float(sensor_m[1]) * fy)
        # MuJoCo's frustum is off to the right for a positive x, so that its axis is left of the picture's middle; a
        # positive y lowers the frustum, and the axis is above.
        offset = -cx / float(sensor_m[0]), -cy / float(sensor_m[1]) * height / width
        fov = 2 * math.degrees(math.atan(across / 2))
        return Camera(width, height, fov, motion, lens=Lens(principal_point=offset, aspect=aspect)), warning
    fov = 2 * math.degrees(math.atan(upward * width / height))
    return Camera(width, height, fov, motion), warning


def _is_orthographic(model: Any, index: int) -> bool:
    if hasattr(model, "cam_projection"):
        return bool(model.cam_projection[index] != 0)
    return bool(getattr(model, "cam_orthographic", np.zeros(index + 1))[index])


def _middle_m(model: Any, data: Any, index: int) -> float:
    """Return how far ahead of a camera the model's middle is [m]; its extent, where that is not ahead."""
    ahead = -data.cam_xmat[index].reshape(3, 3)[:, 2] @ (model.stat.center - data.cam_xpos[index])
    return float(ahead) if ahead > 0 else float(model.stat.extent)
