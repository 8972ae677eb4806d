"""What stands in where a file lacks it: a lamp, a dim environment, and a camera that orbits around everything."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.scene.motion import Motion, Orbit, Static, compose
from clsim.scene.world import Camera, Instance, Lens, Material, Mesh, SphereLight, Vec3

F64 = npt.NDArray[np.float64]
MAX_COORDINATE = 1e15
"""Farther out, squares of distances overflow in 32 bits."""
RESOLUTION = (346, 260)
"""That of a DAVIS346, a camera of frames and events."""
ENVIRONMENT: Vec3 = (0.5, 0.5, 0.5)
ORBIT_S = 6.0
SAMPLES = 9


def bounds(path: Path, meshes: Sequence[Mesh], instances: Sequence[Instance]) -> tuple[Vec3, F64]:
    """Return the centre and the size of the box around everything, wherever its motion takes it.

    Raises:
        InputError: naming the file, if there is nothing to frame.
    """
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    used = {index: _used(meshes[index]) for index in {instance.mesh for instance in instances}}
    for instance in instances:
        deformation = meshes[instance.mesh].deformation
        vertices = meshes[instance.mesh].vertices[used[instance.mesh]].astype(np.float64)
        if not len(vertices):
            continue
        corners = _corners(vertices.min(axis=0), vertices.max(axis=0)) if instance.motion.duration_s else vertices
        last = max(instance.motion.duration_s, deformation.duration_s if deformation else 0.0)
        for time_s in np.linspace(0.0, last, SAMPLES) if last else (0.0,):
            points = corners
            if deformation is not None:
                points = deformation.vertices_at(float(time_s))[0][used[instance.mesh]].astype(np.float64)
            matrix = instance.motion.pose(float(time_s))
            points = points @ matrix[:3, :3].T + matrix[:3, 3]
            low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
    farthest = float(np.maximum(np.abs(low), np.abs(high)).max())
    if not ((low < high).any() and farthest < MAX_COORDINATE):
        raise InputError(f"{path}: has no extent, expected triangles that span a finite space")
    x, y, z = ((low + high) / 2).tolist()
    return (x, y, z), high - low


def _used(mesh: Mesh) -> npt.NDArray[np.bool_]:
    """Return which vertices are a triangle's corner; not by np.unique, which takes seconds for millions."""
    used = np.zeros(len(mesh.vertices), np.bool_)
    used[mesh.triangles.ravel()] = True
    return used


def glow_lights(
    meshes: Sequence[Mesh], instances: Sequence[Instance], materials: Sequence[Material], size: F64
) -> bool:
    """Tell whether surfaces that emit light a scene, rather than only being seen to glow.

    They do where they send out a hundredth of what the default environment sends into the box around everything.
    Emission that a texture shapes may be anything, and counts as none.
    """
    emission = np.array([m.emission if m.emission_texture < 0 else (0.0, 0.0, 0.0) for m in materials]).reshape(-1, 3)
    power = 0.0
    for instance in instances:
        mesh = meshes[instance.mesh]
        local = mesh.triangles[emission[mesh.material_ids].any(axis=1)]
        if not len(local):
            continue
        corners = (mesh.vertices.astype(np.float64) @ instance.motion.pose(0.0)[:3, :3].T)[local]
        areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
        power += float(areas @ emission[mesh.material_ids[emission[mesh.material_ids].any(axis=1)]].mean(axis=1))
    around = 2 * float(size[0] * size[1] + size[1] * size[2] + size[2] * size[0])
    return power > 0 and power >= 0.01 * ENVIRONMENT[0] * around


def lamp(center: Vec3, size: F64) -> SphereLight:
    """Return a large soft lamp to the upper right in front of a box."""
    (x, y, z), radius = center, float(np.linalg.norm(size)) / 2
    return SphereLight(
        radius_m=0.5 * radius,
        radiance=(30.0, 28.8, 27.0),
        motion=Static(compose((x + 1.5 * radius, y + 2.5 * radius, z + 1.5 * radius), np.eye(3))),
        name="lamp",
    )


def orthographic_camera(width: int, width_m: float, height_m: float, motion: Motion) -> Camera:
    """Return a camera of so many columns that sees an area of that size, with square pixels, along parallel rays."""
    height = max(1, min(round(width * height_m / width_m), 16384))
    return Camera(width, height, 45.0, motion, lens=Lens(model="orthographic", view_width_m=width_m))


def orbiting_camera(center: Vec3, size: F64, period_s: float = ORBIT_S) -> Camera:
    """Return a camera that turns around a box, 20° above its middle, and just sees all of it."""
    (width, height), fov_deg = RESOLUTION, 45.0
    right_limit = math.tan(math.radians(fov_deg / 2))
    up_limit = right_limit * height / width
    elevation = math.radians(20.0)
    corners = _corners(-size / 2, size / 2)
    angle = np.linspace(0, 2 * np.pi, 72, endpoint=False)[:, None]
    right = corners[:, 0] * np.cos(angle) - corners[:, 2] * np.sin(angle)
    ahead = corners[:, 0] * np.sin(angle) + corners[:, 2] * np.cos(angle)
    up = corners[:, 1] * math.cos(elevation) - ahead * math.sin(elevation)
    near = corners[:, 1] * math.sin(elevation) + ahead * math.cos(elevation)
    # A corner is in view where |right| and |up| are at most its distance times the limit.
    distance = 1.05 * float((near + np.maximum(np.abs(right) / right_limit, np.abs(up) / up_limit)).max())
    orbit = Orbit(
        center=center,
        radius_m=distance * math.cos(elevation),
        period_s=period_s,
        height_m=distance * math.sin(elevation),
        target=center,
    )
    return Camera(width, height, fov_deg, orbit)


def _corners(low: F64, high: F64) -> F64:
    choice = np.stack(np.meshgrid(*[(0.0, 1.0)] * 3), axis=-1).reshape(-1, 3)
    corners: F64 = low + choice * (high - low)
    return corners
