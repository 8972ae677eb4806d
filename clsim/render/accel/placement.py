"""The placement of meshes that rays search: all that never moves is one mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from clsim.render.motion.deform import box, deforms, flat_or_smooth, shaped
from clsim.scene import Instance, Mesh, Static, World
from clsim.scene.meshes.geometry import colors_of

_NOTHING = Mesh(np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.int32), np.zeros(1, np.int32))
"""A triangle without area, for a world without meshes."""
_FAR_OFF = 4.0
"""A world whose middle is farther from its origin than so many times its size has it in its middle on a device."""


@dataclass(frozen=True)
class Placement:
    """The meshes that rays search and where they stand; all that never moves is one mesh, the first.

    Deforming meshes are in their shape at time 0.

    Attributes:
        meshes: the meshes; the one of what never moves has coordinates from ``origin_m``.
        instances: where they are in the world.
        origin_m: the world's point at which the device has its origin.
        instance_objects: which of the world's instances each is; −1 for what never moves.
        triangle_objects: which of the world's instances each triangle of what never moves belongs to.
    """

    meshes: list[Mesh]
    instances: list[Instance]
    origin_m: npt.NDArray[np.float64]
    instance_objects: npt.NDArray[np.int32]
    triangle_objects: npt.NDArray[np.int32]


def place(world: World) -> Placement:
    """Return the world's instances, all that never moves joined to one."""

    def moves(instance: Instance) -> bool:
        return instance.motion.duration_s > 0 or deforms(world.meshes[instance.mesh])

    moving_objects = [number for number, instance in enumerate(world.instances) if moves(instance)]
    still_objects = sorted(set(range(len(world.instances))) - set(moving_objects))
    still = [world.instances[number] for number in still_objects]
    moving = [world.instances[number] for number in moving_objects]
    meshes: list[Mesh] = []
    instances: list[Instance] = []
    origin_m = _origin(world)
    if still or not moving:
        meshes.append(_merge(world, still, origin_m) if still else _NOTHING)
        moved = np.eye(4)
        moved[:3, 3] = origin_m
        instances.append(Instance(0, Static(moved)))
    slots: dict[int, int] = {}
    for instance in moving:
        if instance.mesh not in slots:
            slots[instance.mesh] = len(meshes)
            meshes.append(shaped(world.meshes[instance.mesh], 0.0))
        instances.append(Instance(slots[instance.mesh], instance.motion, instance.name))
    joined = [-1] * (len(instances) - len(moving))
    lengths = [len(world.meshes[instance.mesh].triangles) for instance in still]
    return Placement(
        meshes,
        instances,
        origin_m,
        np.array(joined + moving_objects, np.int32),
        np.repeat(np.array(still_objects, np.int32), lengths),
    )


def _origin(world: World) -> npt.NDArray[np.float64]:
    """Return the world's origin or, where all is far from it, the middle of all, so that coordinates stay exact."""
    corners = []
    for instance in world.instances:
        pose, (low, high) = instance.motion.pose(0.0), box(shaped(world.meshes[instance.mesh], 0.0))
        middle, half = pose[:3, :3] @ (low + high) / 2 + pose[:3, 3], np.abs(pose[:3, :3]) @ (high - low) / 2
        corners += [middle - half, middle + half]
    if not corners:
        return np.zeros(3)
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    middle = (low + high) / 2
    return np.asarray(middle if np.abs(middle).max() > _FAR_OFF * (high - low).max() else np.zeros(3))


def _merge(world: World, instances: list[Instance], origin_m: npt.NDArray[np.float64]) -> Mesh:
    """Join still instances to one mesh, with coordinates from the origin."""
    vertices, triangles, normals, coordinates, meshes, materials = [], [], [], [], [], []
    first = 0
    for instance in instances:
        mesh, pose = shaped(world.meshes[instance.mesh], 0.0), instance.motion.pose(0.0)
        vertices.append((mesh.vertices @ pose[:3, :3].T + (pose[:3, 3] - origin_m)).astype(np.float32))
        triangles.append(mesh.triangles + np.int32(first))
        normals.append((flat_or_smooth(mesh) @ np.linalg.inv(pose[:3, :3])).astype(np.float32))
        coordinates.append(uvs(mesh))
        meshes.append(mesh)
        materials.append(mesh.material_ids)
        first += len(mesh.vertices)
    blended = np.concatenate(normals)
    lengths = np.linalg.norm(blended, axis=1, keepdims=True)
    return Mesh(
        np.concatenate(vertices),
        np.concatenate(triangles),
        np.concatenate(materials),
        np.divide(blended, lengths, out=np.zeros_like(blended), where=lengths > 0),
        np.concatenate(coordinates),
        np.concatenate([colors_of(mesh) for mesh in meshes]) if any(m.colors is not None for m in meshes) else None,
    )


def uvs(mesh: Mesh) -> npt.NDArray[np.float32]:
    """Return texture coordinates ``[n, 2]``; 0 where the mesh has none."""
    return np.zeros((len(mesh.vertices), 2), np.float32) if mesh.uvs is None else mesh.uvs
