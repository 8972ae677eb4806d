"""A small motion for the camera of scenes that stand still: without motion there are no events."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from clsim.scene.motion import Matrix, look_at
from clsim.scene.world import World

PERIOD_S = 2.0
SHARE = 0.03
"""Radius of the circle, as a share of the distance to what the camera looks at."""
F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Drift:
    """A circle in the image plane through the camera's own place; it keeps looking at one point.

    Attributes:
        start: the camera's pose, where the circle starts and ends.
        distance_m: how far in front of it the point lies that it looks at.
        duration_s: time of a full turn.
    """

    start: Matrix
    distance_m: float
    duration_s: float = PERIOD_S

    def pose(self, time_s: float) -> Matrix:
        """Return the pose at that time."""
        angle = 2 * math.pi * time_s / self.duration_s
        right, up, back, eye = self.start[:3, 0], self.start[:3, 1], self.start[:3, 2], self.start[:3, 3]
        radius = SHARE * self.distance_m
        moved = eye + radius * (math.sin(angle) * right + (1 - math.cos(angle)) * up)
        return look_at(moved, eye - self.distance_m * back, up)


def drifting(world: World) -> World:
    """Return the world with its camera on a small closed path, unless something moves in it already."""
    deformed = (mesh.deformation for mesh in world.meshes)
    motions = [world.camera.motion, *(instance.motion for instance in world.instances)]
    motions += [light.motion for light in world.sphere_lights] + [light.motion for light in world.punctual_lights]
    if any(motion.duration_s > 0 for motion in motions) or any(d is not None and d.duration_s > 0 for d in deformed):
        return world
    pose = world.camera.motion.pose(0.0)
    distance_m = _distance_ahead(world, pose[:3, 3], -pose[:3, 2])
    note = (
        f"nothing moves in {world.name}: its camera circles by {SHARE * distance_m:.3g} m in {PERIOD_S:g} s, "
        f"looking at what lies {distance_m:.3g} m ahead"
    )
    camera = replace(world.camera, motion=Drift(pose, distance_m))
    return replace(world, camera=camera, duration_s=PERIOD_S, notes=(*world.notes, note))


def _distance_ahead(world: World, origin: F64, direction: F64) -> float:
    """Return the distance to the first triangle straight ahead; where there is none, to the middle of everything."""
    nearest, middles = math.inf, []
    for instance in world.instances:
        mesh, matrix = world.meshes[instance.mesh], instance.motion.pose(0.0)
        inverse = np.linalg.inv(matrix)
        start, ray = inverse[:3, :3] @ origin + inverse[:3, 3], inverse[:3, :3] @ direction
        nearest = min(nearest, _first_hit(mesh.vertices, mesh.triangles, start, ray))
        middles.append(matrix[:3, :3] @ mesh.vertices.mean(axis=0, dtype=np.float64) + matrix[:3, 3])
    if math.isfinite(nearest):
        return nearest
    away = float(np.linalg.norm(np.mean(middles, axis=0) - origin)) if middles else 0.0
    return away if away > 0 else 1.0


def _first_hit(vertices: npt.NDArray[np.float32], triangles: npt.NDArray[np.int32], start: F64, ray: F64) -> float:
    """Return the smallest t > 0 at which ``start + t·ray`` meets a triangle (Möller–Trumbore, JGT 1997), or inf."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    edge1, edge2 = b - a, c - a
    direction, to_start = ray.astype(np.float32), start.astype(np.float32) - a
    p, q = np.cross(direction, edge2), np.cross(to_start, edge1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        scale = 1.0 / np.einsum("ij,ij->i", edge1, p)
        u = np.einsum("ij,ij->i", to_start, p) * scale
        v = (q @ direction) * scale
        t = np.einsum("ij,ij->i", edge2, q) * scale
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-6) & np.isfinite(t)
    return float(t[hit].min()) if hit.any() else math.inf
