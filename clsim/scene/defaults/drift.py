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
ROOM = 1.5
"""How far the way to a point of the circle is looked along for walls, as a multiple of its length."""
F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Drift:
    """A circle through the camera's own place; it keeps looking at one point.

    Attributes:
        start: the camera's pose, where the circle starts and ends.
        distance_m: how far in front of it the point lies that it looks at.
        across: direction ``[3]`` in which the circle starts.
        along: direction ``[3]`` from the camera's place to the circle's centre.
        radius_m: radius of the circle.
        duration_s: time of a full turn.
    """

    start: Matrix
    distance_m: float
    across: F64
    along: F64
    radius_m: float
    duration_s: float = PERIOD_S

    def pose(self, time_s: float) -> Matrix:
        """Return the pose at that time."""
        angle = 2 * math.pi * time_s / self.duration_s
        up, back, eye = self.start[:3, 1], self.start[:3, 2], self.start[:3, 3]
        moved = eye + self.radius_m * (math.sin(angle) * self.across + (1 - math.cos(angle)) * self.along)
        return look_at(moved, eye - self.distance_m * back, up)


def drifting(world: World) -> World:
    """Return the world with its camera on a small closed path, unless something moves or changes in it already."""
    if world.moving_s() > 0 or world.light_changes():
        return world
    pose = world.camera.motion.pose(0.0)
    distance_m = _distance_ahead(world, pose[:3, 3], -pose[:3, 2])
    drift = _roomiest(world, pose, distance_m)
    note = (
        f"nothing moves in {world.name}: its camera circles by {drift.radius_m:.3g} m in {PERIOD_S:g} s, "
        f"looking at what lies {distance_m:.3g} m ahead"
    )
    camera = replace(world.camera, motion=drift)
    return replace(world, camera=camera, duration_s=PERIOD_S, notes=(*world.notes, note))


def _roomiest(world: World, pose: Matrix, distance_m: float) -> Drift:
    """Return the first circle with room, upwards, downwards or sideways; where none has, the widest that fits."""
    right, up = pose[:3, 0], pose[:3, 1]
    planes = ((right, up), (right, -up), (up, right), (up, -right))
    radius_m = SHARE * distance_m
    angles = 2 * np.pi * (np.arange(8) + 0.5) / 8  # half a step off the start, to which no ray leads
    turns = np.stack([np.sin(angles), 1 - np.cos(angles)], axis=1)
    ways = radius_m * np.einsum("ak,pkx->pax", turns, np.array(planes))
    vertices, triangles = _triangles_within(world, pose[:3, 3], ROOM * np.abs(ways).max(axis=(0, 1)))
    best, largest = planes[0], -1.0
    for plane, points in zip(planes, ways, strict=True):
        clear = min(_first_hit(vertices, triangles, np.zeros(3), way) for way in points)
        share = min(1.0, clear / ROOM)
        if share > largest:
            best, largest = plane, share
        if share == 1:
            break
    return Drift(pose, distance_m, *best, radius_m=radius_m * largest)


def _triangles_within(world: World, origin: F64, reach_m: F64) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]]:
    """Return vertices, relative to the origin, and triangles of all that may reach into the box ``origin ± reach_m``.

    Most scenes have few triangles there, so that many rays cost little more than one.
    """
    corners = [np.empty((0, 3, 3), np.float32)]
    for instance in world.instances:
        mesh, matrix = world.meshes[instance.mesh], instance.motion.pose(0.0)
        points = mesh.vertices @ matrix[:3, :3].T + (matrix[:3, 3] - origin)
        below, above = points < -reach_m, points > reach_m
        beside = np.zeros(len(mesh.triangles), bool)
        for side in (*below.T, *above.T):
            a, b, c = (side[mesh.triangles[:, k]] for k in range(3))
            beside |= a & b & c
        corners.append(points[mesh.triangles[~beside]].astype(np.float32))
    found = np.concatenate(corners)
    return found.reshape(-1, 3), np.arange(3 * len(found), dtype=np.int32).reshape(-1, 3)


def _distance_ahead(world: World, origin: F64, direction: F64) -> float:
    """Return the distance to the first triangle straight ahead; where there is none, to the middle of everything."""
    nearest, middles = math.inf, []
    for instance in world.instances:
        mesh, matrix = world.meshes[instance.mesh], instance.motion.pose(0.0)
        vertices, start, ray = mesh.vertices, origin, direction
        if np.linalg.det(matrix) == 0:
            # Squeezed flat: the way back into the mesh's own space does not exist.
            vertices = (vertices @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32)
        else:
            inverse = np.linalg.inv(matrix)
            start, ray = inverse[:3, :3] @ origin + inverse[:3, 3], inverse[:3, :3] @ direction
        nearest = min(nearest, _first_hit(vertices, mesh.triangles, start, ray))
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
