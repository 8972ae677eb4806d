"""Where pbrt-v4's shapes and camera stand: transforms at the start and at the end of the motion."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from clsim.errors import InputError
from clsim.scene.meshes.geometry import placed_rigidly
from clsim.scene.motion import Keyframes, Matrix, Motion, Nested, Static, compose
from clsim.scene.pbrt.tokens import Parameters
from clsim.scene.rigid import facing, quaternion_of, without_scale
from clsim.scene.world import Camera, Instance, Lens, Mesh, Vec3

FLIP_Z = np.diag((1.0, 1.0, -1.0, 1.0))
Pair = tuple[Matrix, Matrix]
"""The transform at the start and at the end of the motion."""
Times = tuple[float, float]
"""Start and end of the motion [s]."""


@dataclass(frozen=True)
class Placed:
    """A shape inside an object definition, or in the scene."""

    mesh: int
    transform: Pair


@dataclass(frozen=True)
class Film:
    """How many pixels a film has, and which of them are rendered: from ``start`` to before ``end``, right and down."""

    size: tuple[int, int] = (1280, 720)
    start: tuple[int, int] = (0, 0)
    end: tuple[int, int] = (1280, 720)


def read_film(parameters: Parameters) -> Film:
    """Return a film.

    Raises:
        InputError: with file and line, if it has no pixel.
    """
    width, height = (int(parameters.number(f"{axis}resolution", n)) for axis, n in (("x", 1280), ("y", 720)))
    if min(width, height) < 1:
        raise InputError(f"{parameters.place}: the film is {width}×{height}, expected at least one pixel")
    name, bounds = "pixelbounds", parameters.four("pixelbounds")
    if bounds is None and (window := parameters.four("cropwindow")) is not None:
        name = "cropwindow"
        # In 32 bits as pbrt's own, so that roundings end at the same pixel.
        sizes = (width, width, height, height)
        bounds = [math.ceil(np.float32(share) * np.float32(n)) for share, n in zip(window, sizes, strict=True)]
    x0, x1, y0, y1 = (0, width, 0, height) if bounds is None else (int(bound) for bound in bounds)
    start, end = (max(x0, 0), max(y0, 0)), (min(x1, width), min(y1, height))
    if not (start[0] < end[0] and start[1] < end[1]):
        raise InputError(f"{parameters.place}: {name} leaves no pixel of {width}×{height}")
    return Film((width, height), start, end)


def read_instance(
    placed: Placed, mirror: Matrix, times_s: Times, meshes: list[Mesh], warn: Callable[[str], None]
) -> Instance:
    """Return a shape placed in clsim's world; meshes that its transform stretches are added to ``meshes``."""
    start, end = (mirror @ matrix for matrix in placed.transform)
    if np.array_equal(start, end):
        index, pose = placed_rigidly(meshes, placed.mesh, start)
        return Instance(index, Static(pose), f"shape {placed.mesh}")
    # The stretch stays with the mesh, as it is at the start; the rest moves.
    turn = FLIP_Z if np.linalg.det(start[:3, :3]) < 0 else np.eye(4)
    stretch = without_scale(start @ turn).T[:3, :3] @ start[:3, :3]
    if not np.allclose(without_scale(end @ turn)[:3, :3] @ stretch, end[:3, :3], atol=1e-6):
        warn("shapes that change their stretch over time keep that of the start")
    index, offset = placed_rigidly(meshes, placed.mesh, compose((0.0, 0.0, 0.0), stretch))
    motion = _between(times_s, without_scale(start @ turn), without_scale(end @ turn))
    return Instance(index, Nested(motion, Static(offset)), f"shape {placed.mesh}")


def read_camera(
    transforms: Pair,
    parameters: Parameters,
    orthographic: bool,
    film: Film,
    times_s: Times,
    mirror: Matrix,
    warn: Callable[[str], None],
) -> Camera:
    """Return a camera, of perspective unless it is orthographic, from its camera-to-world transforms.

    Raises:
        InputError: with file and line, if its field of view is none.
    """
    fov = parameters.number("fov", 90.0)
    if not 0 < fov < 180:
        raise InputError(f"{parameters.place}: fov is {fov:g}, expected more than 0 and less than 180")
    left, right, bottom, top = _window(parameters, film)
    width, height = (b - a for a, b in zip(film.start, film.end, strict=True))
    stretch = (top - bottom) / height / ((right - left) / width)  # of pixels, where the window is not as the film
    shift = ((-left - right) / 2 / (right - left), (bottom + top) / 2 / (top - bottom) * height / width)
    start, end = (mirror @ matrix @ FLIP_Z for matrix in transforms)  # pbrt looks along +z, clsim along −z
    x, y, z = np.linalg.norm(start[:3, :3], axis=0).tolist()  # a unit of the camera's, in the world
    lens = Lens(principal_point=shift, aspect=round(stretch * y / x, 9))
    motion: Motion = Static(facing(start))
    if not np.array_equal(start, end):
        motion = _between(times_s, facing(start), facing(end))
    if orthographic:
        # It sees from −1 to 1 of its own along the shorter side.
        width_m = x * (right - left)
        if parameters.number("lensradius", 0.0):
            warn("the lens radius of an orthographic camera is left out")
        parameters.tell_unread("camera", warn)
        return Camera(width, height, 45.0, motion, 0.0, replace(lens, model="orthographic", view_width_m=width_m))
    across = math.tan(math.radians(fov / 2)) * (right - left) / 2 * x / z  # pbrt's fov is that of the shorter side
    if radius := parameters.number("lensradius", 0.0):
        focus = parameters.number("focaldistance", 1e6)
        lens = replace(lens, aperture_radius_m=radius * x, focus_distance_m=focus * z)
    parameters.tell_unread("camera", warn)
    return Camera(width, height, 2 * math.degrees(math.atan(across)), motion, 0.0, lens)


def _window(parameters: Parameters, film: Film) -> tuple[float, float, float, float]:
    """Return what the picture shows, where the film's shorter side is from −1 to 1: left, right, bottom and top."""
    width, height = film.size
    aspect = parameters.number("frameaspectratio", width / height)
    if not aspect > 0:
        raise InputError(f"{parameters.place}: frameaspectratio is {aspect:g}, expected more than 0")
    x, y = max(aspect, 1.0), max(1.0 / aspect, 1.0)
    left, right, bottom, top = parameters.four("screenwindow") or (-x, x, -y, y)
    if not (left < right and bottom < top):
        raise InputError(f"{parameters.place}: screenwindow is empty, expected left < right and bottom < top")
    if film.start == (0, 0) and film.end == film.size:
        return left, right, bottom, top
    across, down = (right - left) / width, (top - bottom) / height
    (x0, y0), (x1, y1) = film.start, film.end
    return left + x0 * across, left + x1 * across, top - y1 * down, top - y0 * down


def _between(times_s: Times, start: Matrix, end: Matrix) -> Motion:
    """Return the motion between two poses."""
    poses = (start, end)
    positions: list[Vec3] = [(float(p[0, 3]), float(p[1, 3]), float(p[2, 3])) for p in poses]
    return Keyframes(times_s, tuple(positions), tuple(quaternion_of(pose[:3, :3]) for pose in poses))
