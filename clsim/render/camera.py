"""The camera: rays through the pixels, as a Warp function."""

import math

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.scene import Camera


@wp.struct
class Pinhole:
    """A pinhole camera; ``right`` and ``down`` span one pixel, ``corner`` points to the image's top left corner."""

    origin: wp.vec3
    right: wp.vec3
    down: wp.vec3
    corner: wp.vec3


@wp.func
def camera_ray(camera: Pinhole, x: float, y: float) -> wp.vec3:
    """Return the unit direction through image position x, y [pixels], the top left corner being 0, 0."""
    return wp.normalize(camera.corner + camera.right * x + camera.down * y)


def pinhole(camera: Camera, pose: npt.NDArray[np.float64]) -> Pinhole:
    """Return the camera at a pose (4×4, camera to world; it looks along −z, +y up); scale in the pose is ignored."""
    right, up, back = (pose[:3, i] / np.linalg.norm(pose[:3, i]) for i in range(3))
    pixel = 2.0 * math.tan(math.radians(camera.fov_deg) / 2.0) / camera.width
    corner = -back - right * (pixel * camera.width / 2.0) + up * (pixel * camera.height / 2.0)
    result = Pinhole()
    result.origin = wp.vec3(*pose[:3, 3])
    result.right = wp.vec3(*(right * pixel))
    result.down = wp.vec3(*(-up * pixel))
    result.corner = wp.vec3(*corner)
    return result
