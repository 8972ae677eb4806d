# ruff: noqa: UP018
"""The camera: rays through the pixels, as Warp functions.

Distortion is that of OpenCV ("Camera calibration and 3D reconstruction": pinhole model with k1, k2, p1, p2, k3, and
fisheye model), whose pixel 0, 0 has its centre at image position 0.5, 0.5 here. ``fov_deg`` gives the focal length as
if there were no distortion: f = w / (2 tan(fov / 2)) in perspective, f = w / fov for a fisheye. Along columns it may
differ, and along rows it is negative where the image is mirrored. The rays of an orthographic lens are parallel and
begin in the plane of the camera's position; its focal lengths are pixels per metre. Other rays are found by inverting
the distortion for each sample by Newton's method, so that jitter within a pixel is distorted too. Where no ray leads to
a pixel (beyond the fold of the distortion, or behind a fisheye) it stays black, with coverage 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.render.camera.pixel_width import pixel_of, widest_pixel
from clsim.render.device.arrays import array
from clsim.render.features.features import Features
from clsim.render.motion.by_time import ByTime
from clsim.render.motion.shutter import (
    key_steps,
    key_times,
    position_between,
    quaternions,
    rotation_between,
    shutter_key,
    shutter_weight,
)
from clsim.scene import Camera

_ITERATIONS = wp.constant(12)
_TOLERANCE = wp.constant(2.0e-6)
vec5 = wp.types.vector(length=5, dtype=wp.float32)
Clear = Callable[[npt.NDArray[np.float64], npt.NDArray[np.float64], tuple[float, float]], npt.NDArray[np.float64]]
_NARROW_PX = 2.0
"""Width below which something may hide between the corners of a pixel [pixels]."""


@wp.struct
class CameraState:
    """A camera where it stands.

    A plain pinhole is ``origin`` and the plane of the image: ``right`` and ``down`` span one pixel, ``corner`` points
    to its top left corner. The others have their intrinsics in pixels, and a pose for each key of the exposure;
    ``limit`` is the tangent (fisheye: the angle) squared up to which distortion can be inverted. Where requests tell
    the instant, each has a pose, and of a plain pinhole ``positions`` and ``images`` (right, down and corner as rows).
    ``clear_m`` tells, for each instant, how far from there nothing is seen narrower than two pixels; 0 is unknown.
    """

    origin: wp.vec3
    right: wp.vec3
    down: wp.vec3
    corner: wp.vec3
    focal_px: wp.vec2
    centre_px: wp.vec2
    distortion: vec5
    limit: float
    aperture_m: float
    focus_m: float
    positions: wp.array[wp.vec3]
    steps: wp.array[wp.vec3]
    rotations: wp.array[wp.quat]
    images: wp.array[wp.mat33]
    clear_m: wp.array[float]


@wp.struct
class CameraRay:
    """A ray of unit direction; ``exists`` is false where the lens sees nothing."""

    origin: wp.vec3
    direction: wp.vec3
    exists: bool


@wp.func
def undistort_perspective(k: vec5, limit: float, distorted: wp.vec2) -> wp.vec3:
    """Return the x, y distorted to the given ones (image plane at distance 1), and 1, or 0 if there are none."""
    x = float(distorted[0])
    y = float(distorted[1])
    exists = float(0.0)
    for _ in range(_ITERATIONS):
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
        slope = 2.0 * (k[0] + r2 * (2.0 * k[1] + r2 * 3.0 * k[4]))
        error_x = x * radial + 2.0 * k[2] * x * y + k[3] * (r2 + 2.0 * x * x) - distorted[0]
        error_y = y * radial + k[2] * (r2 + 2.0 * y * y) + 2.0 * k[3] * x * y - distorted[1]
        exists = wp.where(r2 <= limit and wp.max(wp.abs(error_x), wp.abs(error_y)) < _TOLERANCE * (1.0 + r2), 1.0, 0.0)
        xx = radial + x * x * slope + 2.0 * k[2] * y + 6.0 * k[3] * x
        xy = x * y * slope + 2.0 * k[2] * x + 2.0 * k[3] * y
        yy = radial + y * y * slope + 6.0 * k[2] * y + 2.0 * k[3] * x
        determinant = xx * yy - xy * xy
        if determinant <= 0.0:
            break
        x = x - (yy * error_x - xy * error_y) / determinant
        y = y - (xx * error_y - xy * error_x) / determinant
    return wp.vec3(x, y, exists)


@wp.func
def undistort_fisheye(k: vec5, limit: float, distorted: float) -> wp.vec2:
    """Return the angle θ [rad] with θ·(1 + k1·θ² + …) as given, and 1, or 0 if there is none."""
    theta = float(distorted)
    exists = float(0.0)
    for _ in range(_ITERATIONS):
        t = theta * theta
        error = theta * (1.0 + t * (k[0] + t * (k[1] + t * (k[2] + t * k[3])))) - distorted
        exists = wp.where(t <= limit and wp.abs(error) < _TOLERANCE, 1.0, 0.0)
        slope = 1.0 + t * (3.0 * k[0] + t * (5.0 * k[1] + t * (7.0 * k[2] + t * 9.0 * k[3])))
        if slope <= 0.0:
            break
        theta = theta - error / slope
    return wp.vec2(theta, exists)


def make_camera(features: Features) -> Any:
    """Return the Warp function ``camera_ray(view, x, y, lens, time)``.

    x, y is the image position [pixels], the top left corner being 0, 0; ``lens`` a pair of random numbers for the
    position on the aperture, ``time`` goes from 0 to 1 through the exposure; of requests it is the instant's number.
    """

    @wp.func
    def camera_ray(view: CameraState, x: float, y: float, lens: wp.vec2, time: float) -> CameraRay:
        ray = CameraRay()
        ray.exists = True
        if wp.static(plain(features)):
            if wp.static(features.requests):
                image = view.images[int(time)]
                ray.origin = view.positions[int(time)]
                ray.direction = wp.normalize(image[2] + image[0] * x + image[1] * y)
            else:
                ray.origin = view.origin
                ray.direction = wp.normalize(view.corner + view.right * x + view.down * y)
        else:
            across = (x - view.centre_px[0]) / view.focal_px[0]
            down = (y - view.centre_px[1]) / view.focal_px[1]
            target = wp.vec3(across, -down, -1.0)
            if wp.static(features.projection == "perspective" and features.distortion):
                found = undistort_perspective(view.distortion, view.limit, wp.vec2(across, down))
                target = wp.vec3(found[0], -found[1], -1.0)
                ray.exists = found[2] > 0.0
            if wp.static(features.projection == "fisheye"):
                radius = wp.sqrt(across * across + down * down)
                angle = undistort_fisheye(view.distortion, view.limit, radius)
                scale = wp.sin(angle[0]) / wp.max(radius, 1.0e-12)
                target = wp.vec3(across * scale, -down * scale, -wp.cos(angle[0]))
                ray.exists = angle[1] > 0.0
            start = wp.vec3()
            if wp.static(features.projection == "orthographic"):
                start = wp.vec3(across, -down, 0.0)
                target = wp.vec3(0.0, 0.0, -1.0)
            if wp.static(features.aperture):
                # In perspective the plane at the focus distance is sharp, for a fisheye the sphere.
                r = view.aperture_m * wp.sqrt(lens[0])
                phi = 2.0 * wp.pi * lens[1]
                start = wp.vec3(r * wp.cos(phi), r * wp.sin(phi), 0.0)
                target = target * view.focus_m - start
            instant = int(0.0)
            if wp.static(features.requests):
                instant = int(time)
            position = view.positions[instant]
            rotation = view.rotations[instant]
            if wp.static(features.camera_blur):
                key = shutter_key(time)
                weight = shutter_weight(time)
                position = position_between(
                    view.positions[key], view.positions[key + 1], view.steps[key], view.steps[key + 1], weight
                )
                rotation = rotation_between(view.rotations[key], view.rotations[key + 1], weight)
            ray.origin = position + wp.quat_rotate(rotation, start)
            ray.direction = wp.normalize(wp.quat_rotate(rotation, target))
        return ray

    return camera_ray


def make_projection(features: Features) -> Any:
    """Return the Warp function ``project(view, way, instant)`` for a camera without blur.

    ``way`` leads from the camera's position to a point, in the world; the result is its image position [pixels], as
    ``camera_ray`` takes it, and 1, or 0 where the lens does not see that way.
    """

    @wp.func
    def project(view: CameraState, way: wp.vec3, instant: int) -> wp.vec3:
        k = view.distortion
        local = wp.quat_rotate_inv(view.rotations[instant], way)
        ahead = -local[2]
        x = float(0.0)
        y = float(0.0)
        seen = float(0.0)
        if wp.static(features.projection == "fisheye"):
            across = wp.sqrt(local[0] * local[0] + local[1] * local[1])
            angle = wp.atan2(across, ahead)
            t = angle * angle
            radius = angle * (1.0 + t * (k[0] + t * (k[1] + t * (k[2] + t * k[3]))))
            scale = radius / wp.max(across, 1.0e-20)
            x = local[0] * scale
            y = -local[1] * scale
            seen = wp.where(t <= view.limit, 1.0, 0.0)
        elif wp.static(features.projection == "orthographic"):
            x = local[0]
            y = -local[1]
            seen = wp.where(ahead > 0.0, 1.0, 0.0)
        else:
            if ahead > 0.0:
                x = local[0] / ahead
                y = -local[1] / ahead
                r2 = x * x + y * y
                seen = wp.where(r2 <= view.limit, 1.0, 0.0)
                if wp.static(features.distortion):
                    radial = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
                    u = x * radial + 2.0 * k[2] * x * y + k[3] * (r2 + 2.0 * x * x)
                    y = y * radial + k[2] * (r2 + 2.0 * y * y) + 2.0 * k[3] * x * y
                    x = u
        return wp.vec3(x * view.focal_px[0] + view.centre_px[0], y * view.focal_px[1] + view.centre_px[1], seen)

    return project


def plain(features: Features) -> bool:
    """Whether the camera is a still pinhole without distortion."""
    return (
        features.projection == "perspective"
        and not features.distortion
        and not features.aperture
        and not features.camera_blur
    )


class CameraData:
    """A camera on a device."""

    def __init__(
        self,
        camera: Camera,
        features: Features,
        origin_m: npt.NDArray[np.float64],
        device: Any,
        clear_m: Clear | None = None,
    ) -> None:
        """Take what does not change with time.

        Args:
            camera: what takes the pictures.
            features: what the kernels are built for.
            origin_m: the world's point at which the device's origin is.
            device: Warp's device.
            clear_m: returns how far from each of some places ``[K, 3]`` nothing is narrow at those times ``[K]``; what
                is narrow is told in rad, or if that is 0 in m. Without it, that is unknown.
        """
        self._camera = camera
        self._origin_m = origin_m
        self._shutter_s = camera.shutter_s if features.camera_blur else 0.0
        self._plain = plain(features)
        lens = camera.lens
        self._focal_px = camera.focal_px()
        self._centre_px = (
            camera.width * (0.5 + lens.principal_point[0]),
            camera.height / 2.0 + camera.width * lens.principal_point[1],
        )
        keys = len(key_times(0.0, self._shutter_s))
        self._view = CameraState()
        self._view.focal_px = wp.vec2(*self._focal_px)
        self._view.centre_px = wp.vec2(*self._centre_px)
        self._view.distortion = vec5(*lens.distortion, *[0.0] * (5 - len(lens.distortion)))
        self._view.limit = invertible(lens.distortion, lens.model == "fisheye")
        self._view.aperture_m = lens.aperture_radius_m
        self._view.focus_m = lens.focus_distance_m
        self._view.positions = wp.zeros(keys, dtype=wp.vec3, device=device)
        self._view.steps = wp.zeros(keys, dtype=wp.vec3, device=device)
        self._view.rotations = wp.zeros(keys, dtype=wp.quat, device=device)
        self._view.images = wp.zeros(1, dtype=wp.mat33, device=device)
        self._view.clear_m = wp.zeros(1, dtype=float, device=device)
        rad, wide_m = pixel_of(camera)
        if rad > 0.0:
            # Who asks takes all pixels for as wide as on average, and leaves room for those twice as wide.
            rad = max(rad, widest_pixel(camera) / 2.0)
        self._narrow = _NARROW_PX * rad, _NARROW_PX * wide_m
        self._clear_m = clear_m
        self._stood = ByTime(self._standing)

    def at(self, time_s: float) -> Any:
        """Return the view of the exposure about that time; scale in the camera's pose is ignored."""
        motion, times_s = self._camera.motion, key_times(time_s, self._shutter_s)
        poses = np.array([motion.pose(float(t)) for t in times_s])
        positions = poses[:, :3, 3] - self._origin_m
        self._view.positions.assign(positions.astype(np.float32))
        self._view.steps.assign(key_steps([motion], times_s, positions[:, None])[:, 0].astype(np.float32))
        self._view.rotations.assign(quaternions(_axes(poses)).astype(np.float32))
        middle = motion.pose(time_s)
        self._view.clear_m.assign(self._clear(middle[None], np.array([time_s])))
        self._view.origin = wp.vec3(*(middle[:3, 3] - self._origin_m))
        right, down, corner = self._images(middle[None])[0]
        self._view.right, self._view.down, self._view.corner = wp.vec3(*right), wp.vec3(*down), wp.vec3(*corner)
        return self._view

    def at_instants(self, times_s: npt.NDArray[np.float64]) -> Any:
        """Return the views at those times, one after the other."""
        rows = self._stood.rows(times_s)
        clear_m, positions, turned = (np.ascontiguousarray(part) for part in np.split(rows, (1, 4), axis=1))
        device = self._view.positions.device
        self._view.clear_m = array(clear_m[:, 0], float, device)
        self._view.positions = array(positions, wp.vec3, device)
        if self._plain:
            self._view.images = array(turned.reshape(-1, 3, 3), wp.mat33, device)
        else:
            self._view.rotations = array(turned, wp.quat, device)
        return self._view

    def pose_key(self, time_s: float) -> bytes:
        """Return what tells where the camera stands at a time."""
        return self._stood.rows(np.array([time_s]))[:, 1:].tobytes()

    def forget(self) -> None:
        """Forget the poses at instants: time has gone on, or the camera was moved."""
        self._stood.forget()

    def _standing(self, times_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:
        """Return a row for each instant: how far all is clear, the position, and the image or the rotation."""
        poses = np.array([self._camera.motion.pose(time_s) for time_s in times_s.tolist()])
        turned = self._images(poses).reshape(-1, 9) if self._plain else quaternions(_axes(poses))
        parts = self._clear(poses, times_s)[:, None], poses[:, :3, 3] - self._origin_m, turned
        return np.concatenate(parts, axis=1).astype(np.float32)

    def _clear(self, poses: npt.NDArray[np.float64], times_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:
        """Return how far from each of some poses ``[K, 4, 4]`` nothing is narrow [m]."""
        if self._clear_m is None:
            return np.zeros(len(poses), np.float32)
        return self._clear_m(poses[:, :3, 3], times_s, self._narrow).astype(np.float32)

    def _images(self, poses: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the planes of the images of poses ``[K, 4, 4]``: right, down and the corner, ``[K, 3, 3]``."""
        right, up, back = np.moveaxis(_axes(poses), 2, 0)
        (fx, fy), (cx, cy) = self._focal_px, self._centre_px
        return np.stack([right / fx, -up / fy, -back - right * (cx / fx) + up * (cy / fy)], axis=1)


def _axes(poses: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the axes of poses ``[K, 4, 4]`` as columns ``[K, 3, 3]``, without their scale."""
    lengths = np.sqrt(np.square(poses[:, :3, :3]).sum(axis=1, keepdims=True))
    return np.asarray(poses[:, :3, :3] / lengths)


def invertible(distortion: tuple[float, ...], fisheye: bool) -> float:
    """Return the squared radius (fisheye: angle) where the distorted radius stops growing; at most 1e12 (π²)."""
    k = (*distortion, *[0.0] * (5 - len(distortion)))
    radial = (k[0], k[1], k[2], k[3]) if fisheye else (k[0], k[1], k[4])
    slope = [(2 * i + 3) * value for i, value in enumerate(radial)]
    roots = np.roots([*slope[::-1], 1.0])
    folds = [root.real for root in roots if abs(root.imag) < 1e-9 * abs(root) and root.real > 0]
    return float(min([math.pi**2 if fisheye else 1e12, *folds]))
