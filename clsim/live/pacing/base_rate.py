"""How fast objects move over the image, and the base rate: the fewest frames a second, with pixels traced between."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from clsim.scene import Camera, Instance, World

BASE_FPS = 30.0
"""Frames per simulated second where nothing asks for more."""
MOST_FPS = 64 * BASE_FPS
"""Frames per simulated second beyond which changing light asks for no more."""
_WAY_PX = 12.0
"""Way from frame to frame beyond which an object, its light and its shadow are sampled too seldom [pixels]."""
_APART_S = 1e-3
"""Time over which speeds are taken [s]."""
_MOST_POSES = 2000
_MOST_POINTS = 1000
"""Vertices that tell how fast a camera is."""
_CAMERA_TIMES = 32
"""Times of a camera's way at which that is asked."""

F64 = npt.NDArray[np.float64]


def base_fps(world: World) -> float:
    """Return how many frames a second brightness between frames is found from: 30, or 2, 4, 8 … times as many.

    They are so many that no object goes much farther than 12 pixels from one to the next, but no more than the scene's
    own; and as many as changing light asks for, up to `MOST_FPS`.
    """
    fps = min(_in_steps(fastest_px_s(world) / _WAY_PX), world.fps)
    rates = [change.least_fps for _, change in world.modulations()] + [film.least_fps for _, film in world.films()]
    by_light = max(rates, default=0.0)
    return max(fps, min(_in_steps(by_light), MOST_FPS)) if by_light > fps else fps


def fastest_px_s(world: World) -> float:
    """Return how fast the boxes of rigid objects move over the image, seen from where the camera is then [pixels/s]."""
    moving = [each for each in world.instances if each.motion.duration_s > 0]
    duration_s = max((each.motion.duration_s for each in moving), default=0.0)
    fastest = 0.0
    for time_s in np.linspace(0.0, duration_s, max(4, min(64, _MOST_POSES // max(1, len(moving)))), endpoint=False):
        to_camera = np.linalg.inv(world.camera.motion.pose(float(time_s)))
        for each in moving:
            corners = _corners(world.meshes[each.mesh].vertices)
            places = [
                _on_image(to_camera @ each.motion.pose(float(t)), corners, world.camera)
                for t in (time_s, time_s + _APART_S)
            ]
            if _seen(places[0], world.camera.width, world.camera.height) and np.isfinite(places[1]).all():
                fastest = max(fastest, float(np.linalg.norm(places[1] - places[0], axis=1).max()) / _APART_S)
    return fastest


def camera_px_s(world: World) -> float:
    """Return how fast all but a tenth of what stands still goes over the image, where the camera is fastest [pixels/s].

    What stands still is told by some vertices in the picture, be they hidden or not; without one nothing is told.
    """
    motion, still = world.camera.motion, [each for each in world.instances if each.motion.duration_s == 0]
    if motion.duration_s == 0 or not still:
        return 0.0
    some = still[:: -(-len(still) // _MOST_POINTS)]
    points = np.concatenate([_places(world, each, -(-_MOST_POINTS // len(some))) for each in some])
    half = np.array((world.camera.width / 2.0, world.camera.height / 2.0))
    fastest = 0.0
    for time_s in np.linspace(0.0, motion.duration_s, _CAMERA_TIMES, endpoint=False):
        poses = (np.linalg.inv(motion.pose(float(t))).astype(np.float64) for t in (time_s, time_s + _APART_S))
        before, after = (_on_image(pose, points, world.camera) for pose in poses)
        way_px = np.linalg.norm(after - before, axis=1)
        seen = (np.abs(before) < half).all(axis=1) & np.isfinite(way_px)
        if seen.any():
            fastest = max(fastest, float(np.quantile(way_px[seen], 0.9)) / _APART_S)
    return fastest


def _places(world: World, instance: Instance, number: int) -> F64:
    """Return where about so many vertices of an instance are at the start [m], ``[n, 3]``."""
    vertices, pose = world.meshes[instance.mesh].vertices, instance.motion.pose(0.0)
    some = vertices[:: -(-len(vertices) // number)].astype(np.float64)
    return np.asarray(some @ pose[:3, :3].T + pose[:3, 3])


def _in_steps(fps: float) -> float:
    """Return the least of 30, 60, 120 … that is no less."""
    return BASE_FPS * 2.0 ** max(0, math.ceil(math.log2(max(fps, BASE_FPS) / BASE_FPS) - 1e-6))


def _corners(vertices: npt.NDArray[np.float32]) -> F64:
    """Return the corners of the box around vertices, ``[8, 3]``."""
    ends = np.array((vertices.min(axis=0), vertices.max(axis=0)), np.float64)
    x, y, z = np.unravel_index(np.arange(8), (2, 2, 2))
    return np.stack([ends[x, 0], ends[y, 1], ends[z, 2]], axis=1)


def _on_image(pose: F64, points: F64, camera: Camera) -> F64:
    """Return where points are from the image's middle [pixels], ``[n, 2]``; NaN for those behind the camera."""
    x, y, z = pose[:3, :3] @ points.T + pose[:3, 3:]
    ahead = np.where(z < 0.0, -z, np.nan)
    if camera.lens.model == "orthographic":
        return np.stack([x, -y], axis=1) * np.where(ahead > 0, abs(camera.focal_px()[0]), np.nan)[:, None]
    focal_px = camera.width / (2.0 * math.tan(math.radians(min(camera.fov_deg, 170.0)) / 2.0))
    return np.stack([x / ahead, -y / ahead], axis=1) * focal_px


def _seen(places: F64, width: int, height: int) -> bool:
    """Whether the box around places, ``[8, 2]``, overlaps the picture."""
    if not np.isfinite(places).all():
        return False
    half = np.array((width / 2.0, height / 2.0))
    return bool((places.min(axis=0) < half).all() and (places.max(axis=0) > -half).all())
