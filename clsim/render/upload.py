"""From a World to the arrays that the kernels read, and their change from frame to frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.render import lights_punctual
from clsim.render.bvh8 import Bvh8
from clsim.render.deform import DeformingMesh, box, deforms, flat_or_smooth, shaped
from clsim.render.environment import LUMINANCE, EnvironmentImage, EnvironmentTables, steps, tabulate
from clsim.render.features import Features
from clsim.render.geometry import Geometry, Tree, mat34
from clsim.render.integrator import Scene
from clsim.render.lights import Lamp, Lights
from clsim.render.lights_punctual import Punctual
from clsim.render.shutter import SHUTTER_KEYS, key_times
from clsim.render.upload_materials import upload_materials
from clsim.scene import Instance, Mesh, Static, World

_F64 = npt.NDArray[np.float64]
_NOTHING = Mesh(np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.int32), np.zeros(1, np.int32))
"""A triangle without area, for a world without meshes."""


@dataclass(frozen=True)
class _Placement:
    """The meshes that rays search and where they stand; all that never moves is one mesh in world space, the first.

    Deforming meshes are in their shape at time 0.
    """

    meshes: list[Mesh]
    instances: list[Instance]


def _place(world: World) -> _Placement:
    def moves(instance: Instance) -> bool:
        return instance.motion.duration_s > 0 or deforms(world.meshes[instance.mesh])

    still = [instance for instance in world.instances if not moves(instance)]
    moving = [instance for instance in world.instances if moves(instance)]
    meshes: list[Mesh] = []
    instances: list[Instance] = []
    if still or not moving:
        meshes.append(_merge(world, still) if still else _NOTHING)
        instances.append(Instance(0, Static(np.eye(4))))
    slots: dict[int, int] = {}
    for instance in moving:
        if instance.mesh not in slots:
            slots[instance.mesh] = len(meshes)
            meshes.append(shaped(world.meshes[instance.mesh], 0.0))
        instances.append(Instance(slots[instance.mesh], instance.motion, instance.name))
    return _Placement(meshes, instances)


def _merge(world: World, instances: list[Instance]) -> Mesh:
    """Join still instances to one mesh in world space."""
    vertices, triangles, normals, uvs, materials = [], [], [], [], []
    first = 0
    for instance in instances:
        mesh, pose = shaped(world.meshes[instance.mesh], 0.0), instance.motion.pose(0.0)
        vertices.append((mesh.vertices @ pose[:3, :3].T + pose[:3, 3]).astype(np.float32))
        triangles.append(mesh.triangles + np.int32(first))
        normals.append((flat_or_smooth(mesh) @ np.linalg.inv(pose[:3, :3])).astype(np.float32))
        uvs.append(_uvs(mesh))
        materials.append(mesh.material_ids)
        first += len(mesh.vertices)
    blended = np.concatenate(normals)
    lengths = np.linalg.norm(blended, axis=1, keepdims=True)
    return Mesh(
        np.concatenate(vertices),
        np.concatenate(triangles),
        np.concatenate(materials),
        np.divide(blended, lengths, out=np.zeros_like(blended), where=lengths > 0),
        np.concatenate(uvs),
    )


def _uvs(mesh: Mesh) -> npt.NDArray[np.float32]:
    return np.zeros((len(mesh.vertices), 2), np.float32) if mesh.uvs is None else mesh.uvs


class SceneData:
    """A world on a device.

    Attributes:
        scene: what the kernel takes.
    """

    def __init__(self, world: World, features: Features, tree: Tree, device: Any) -> None:
        """Copy the world to the device and build its acceleration structures, at time 0."""
        self._device = device
        self._features = features
        self._search = Bvh8 if tree == "bvh8" else wp.Mesh
        self._sphere_lights = world.sphere_lights
        self._punctual_lights = world.punctual_lights
        self._shutter_s = world.camera.shutter_s if features.motion_blur else 0.0
        placement = _place(world)
        self._instances = placement.instances
        self.scene = Scene()
        self.scene.materials = upload_materials(world, device)
        geometry = self._geometry(placement, world)
        self.scene.geometry = geometry
        self.scene.lights = self._lights(world, placement)

    def update(self, time_s: float) -> None:
        """Move everything to where it is at that time; work only where something moves."""
        times_s = key_times(time_s, self._shutter_s)
        for entry, (key, deforming) in self._deforming.items():
            self._boxes[entry] = deforming.update(float(times_s[key]))
            self._trees[entry] = deforming.tree
        if self._deforming:
            self._handles.assign(np.array([tree.id for tree in self._trees], np.uint64))
        if self._features.two_level:
            poses = self._poses(times_s)
            lowers, uppers = self._bounds(poses)
            self._to_world.assign(poses[..., :3, :].reshape(-1, 3, 4).astype(np.float32))
            if not self._features.motion_blur:
                self._to_object.assign(np.linalg.inv(poses[0])[:, :3].astype(np.float32))
            self._lowers.assign(lowers.astype(np.float32))
            self._uppers.assign(uppers.astype(np.float32))
            self._tree.refit()
        if any(light.motion.duration_s > 0 for light in self._sphere_lights):
            self._spheres.assign(self._sphere_rows(times_s))
        if any(light.motion.duration_s > 0 for light in self._punctual_lights):
            positions, axes = lights_punctual.rows(self._punctual_lights, times_s)
            self._punctual.positions.assign(positions)
            self._punctual.axes.assign(axes)

    def _poses(self, times_s: _F64) -> _F64:
        """Poses ``[times, instances, 4, 4]``."""
        return np.array([[instance.motion.pose(float(t)) for instance in self._instances] for t in times_s])

    def _array(self, values: Any, dtype: Any) -> Any:
        """Copy to the device; an empty array becomes one entry of zeros, since its fields are never read."""
        data = np.asarray(values)
        return (
            wp.array(data, dtype=dtype, device=self._device) if data.size else wp.zeros(1, dtype, device=self._device)
        )

    def _geometry(self, placement: _Placement, world: World) -> Any:
        meshes = placement.meshes
        first_triangle = np.cumsum([0, *(len(mesh.triangles) for mesh in meshes)])
        # A mesh that deforms within the exposure stands in the table once for each key.
        counts = [SHUTTER_KEYS if self._features.deforming_blur and deforms(mesh) else 1 for mesh in meshes]
        first_entry = np.cumsum([0, *counts])
        owner = np.repeat(np.arange(len(meshes)), counts)
        shapes = [meshes[i] for i in owner]
        first_vertex = np.cumsum([0, *(len(mesh.vertices) for mesh in shapes)])
        geometry = Geometry()
        geometry.mesh_first_vertex = self._array(first_vertex[:-1], wp.int32)
        geometry.mesh_first_triangle = self._array(first_triangle[owner], wp.int32)
        geometry.vertices = self._array(np.concatenate([mesh.vertices for mesh in shapes]), wp.vec3)
        geometry.indices = self._array(np.concatenate([mesh.triangles for mesh in meshes]).ravel(), wp.int32)
        geometry.material_ids = self._array(np.concatenate([mesh.material_ids for mesh in meshes]), wp.int32)
        if self._features.smooth_normals:
            geometry.normals = self._array(np.concatenate([flat_or_smooth(mesh) for mesh in shapes]), wp.vec3)
        if self._features.textures:
            geometry.uvs = self._array(np.concatenate([_uvs(mesh) for mesh in shapes]), wp.vec2)
        self._trees: list[Any] = []
        self._deforming: dict[int, tuple[int, DeformingMesh]] = {}
        for entry, (mesh, i) in enumerate(zip(shapes, owner, strict=True)):
            own = slice(int(first_vertex[entry]), int(first_vertex[entry + 1]))
            vertices = geometry.vertices[own]
            indices = geometry.indices[int(3 * first_triangle[i]) : int(3 * first_triangle[i + 1])]
            if deforms(mesh):
                normals = geometry.normals[own] if self._features.smooth_normals else None
                deforming = DeformingMesh(mesh, self._search, vertices, indices, normals)
                self._deforming[entry] = entry - int(first_entry[i]), deforming
                self._trees.append(deforming.tree)
            else:
                self._trees.append(self._search(vertices, indices))
        self._handles = self._array([tree.id for tree in self._trees], wp.uint64)
        geometry.mesh_handles = self._handles

        times_s = key_times(0.0, self._shutter_s)
        poses = self._poses(times_s)
        self._boxes = np.array([box(mesh) for mesh in shapes])
        of = np.array([instance.mesh for instance in placement.instances])
        keys = np.minimum(np.arange(max(counts))[:, None], np.array(counts)[of] - 1)
        self._entries = first_entry[of] + keys
        lowers, uppers = self._bounds(poses)
        spheres = self._sphere_rows(times_s)
        least = np.vstack([lowers, spheres[:, :3] - spheres[:, 3:]]).min(axis=0)
        most = np.vstack([uppers, spheres[:, :3] + spheres[:, 3:]]).max(axis=0)
        geometry.scale_m = float((most - least).max() / 2)
        self._radius_m = float(np.linalg.norm(most - least) / 2)

        geometry.instance_mesh = self._array(self._entries.ravel(), wp.int32)
        geometry.instance_count = len(placement.instances)
        self._to_world = self._array(poses[..., :3, :].reshape(-1, 3, 4).astype(np.float32), mat34)
        self._to_object = self._array(np.linalg.inv(poses[0])[:, :3].astype(np.float32), mat34)
        geometry.to_world, geometry.to_object = self._to_world, self._to_object
        if self._features.two_level:
            self._lowers = self._array(lowers.astype(np.float32), wp.vec3)
            self._uppers = self._array(uppers.astype(np.float32), wp.vec3)
            self._tree: Any = wp.Bvh(self._lowers, self._uppers)
            geometry.instance_tree = self._tree.id
        geometry.sphere_count = len(self._sphere_lights)
        if len(spheres):
            self._spheres = self._array(spheres, wp.vec4)
            geometry.spheres = self._spheres
        return geometry

    def _bounds(self, poses: _F64) -> tuple[_F64, _F64]:
        """World boxes of what the instances sweep, a little wide so that flat ones and rounding miss nothing."""
        boxes = self._boxes[self._entries]  # [keys, instances, 2, 3]
        low, high = boxes[:, :, 0].min(axis=0), boxes[:, :, 1].max(axis=0)
        centres = np.einsum("tnij,nj->tni", poses[..., :3, :3], (low + high) / 2) + poses[..., :3, 3]
        extents = np.einsum("tnij,nj->tni", np.abs(poses[..., :3, :3]), (high - low) / 2)
        extents += 1e-6 * (1.0 + np.abs(centres) + extents)
        return (centres - extents).min(axis=0), (centres + extents).max(axis=0)

    def _sphere_rows(self, times_s: _F64) -> npt.NDArray[np.float32]:
        rows = [(*light.motion.pose(float(t))[:3, 3], light.radius_m) for t in times_s for light in self._sphere_lights]
        return np.array(rows, np.float32).reshape(-1, 4)

    def _lights(self, world: World, placement: _Placement) -> Any:
        """Number the lights and give each its share of the power, as it is at time 0."""
        emission = np.array([material.emission for material in world.materials]).reshape(-1, 3)
        sides = np.array([2.0 if material.emits_behind else 1.0 for material in world.materials])
        power_of = emission @ LUMINANCE * sides * math.pi
        ranks, emitting = [], []
        for mesh in placement.meshes:
            emits = power_of[mesh.material_ids] > 0 if len(power_of) else np.zeros(len(mesh.triangles), bool)
            ranks.append(np.where(emits, np.cumsum(emits) - 1, -1))
            emitting.append(np.flatnonzero(emits))
        first_triangle = np.cumsum([0, *(len(mesh.triangles) for mesh in placement.meshes)])
        powers: list[_F64] = []
        instance_of, triangle_of, instance_first = [], [], [0]
        for k, instance in enumerate(placement.instances):
            mesh, local = placement.meshes[instance.mesh], emitting[instance.mesh]
            corners = (mesh.vertices @ instance.motion.pose(0.0)[:3, :3].T)[mesh.triangles[local]]
            cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            powers.append(0.5 * np.linalg.norm(cross, axis=1) * power_of[mesh.material_ids[local]])
            instance_of.append(np.full(len(local), k))
            triangle_of.append(first_triangle[instance.mesh] + local)
            instance_first.append(instance_first[-1] + len(local))
        for light in world.sphere_lights:
            surface_m2 = 4 * math.pi * light.radius_m**2
            powers.append(np.array([surface_m2 * math.pi * float(np.dot(light.radiance, LUMINANCE))]))
        for light in world.punctual_lights:
            powers.append(np.array([lights_punctual.power(light, self._radius_m) @ LUMINANCE]))
        power = np.concatenate(powers)
        sky = float(np.dot(world.environment, LUMINANCE))
        lights = Lights()
        if world.environment_map is not None:
            tables = tabulate(world.environment_map, world.environment)
            lights.environment_image = self._environment_image(tables, world.environment_map.to_world)
            sky = tables.mean
        environment = sky * (2 * math.pi * max(self._radius_m, 1e-3)) ** 2
        # Scattering finds a constant environment just as well, so that lamps keep at least half of the samples.
        power = np.append(power, min(environment, power.sum()) if power.sum() > 0 else environment)

        cumulative = steps(np.cumsum(power))
        probability = np.diff(cumulative, prepend=np.float32(0.0))
        lights.cumulative = self._array(cumulative, wp.float32)
        lights.probability = self._array(probability, wp.float32)
        lights.instance = self._array(np.concatenate(instance_of), wp.int32)
        lights.triangle = self._array(np.concatenate(triangle_of), wp.int32)
        lights.instance_first = self._array(instance_first[:-1], wp.int32)
        lights.triangle_rank = self._array(np.concatenate(ranks), wp.int32)
        if self._features.still_lamps:
            lights.lamps = self._lamps(placement.meshes[0], emitting[0])
        lights.first_sphere = instance_first[-1]
        lights.sphere_radiance = self._array([light.radiance for light in world.sphere_lights], wp.vec3)
        lights.first_punctual = lights.first_sphere + len(world.sphere_lights)
        lights.punctual = self._punctual_table(world)
        lights.first_environment = lights.first_punctual + len(world.punctual_lights)
        lights.environment = wp.vec3(*world.environment)
        lights.environment_probability = float(probability[-1])
        return lights

    def _lamps(self, mesh: Mesh, triangles: npt.NDArray[np.int64]) -> Any:
        """Return the table of emitting triangles, all of them in the mesh of what never moves."""
        corners = mesh.vertices[mesh.triangles[triangles]].astype(np.float64)
        rows = np.zeros(len(triangles), Lamp.numpy_dtype())
        rows["corner"] = corners[:, 0]
        rows["edge1"], rows["edge2"] = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        cross = np.cross(rows["edge1"].astype(np.float64), rows["edge2"].astype(np.float64))
        length = np.linalg.norm(cross, axis=1)
        rows["normal"] = cross / np.maximum(length, 1e-300)[:, None]
        rows["area"] = 0.5 * length
        rows["material"] = mesh.material_ids[triangles]
        return self._array(rows, Lamp)

    def _punctual_table(self, world: World) -> Any:
        lights, table = world.punctual_lights, Punctual()
        positions, axes = lights_punctual.rows(lights, key_times(0.0, self._shutter_s))
        table.count = len(lights)
        table.directional = self._array([int(light.kind == "directional") for light in lights], wp.int32)
        table.intensity = self._array([light.intensity for light in lights], wp.vec3)
        table.falloff = self._array([lights_punctual.falloff(light) for light in lights], wp.vec2)
        table.positions = self._array(positions, wp.vec3)
        table.axes = self._array(axes, wp.vec3)
        self._punctual = table
        return table

    def _environment_image(self, tables: EnvironmentTables, to_world: _F64) -> Any:
        image = EnvironmentImage()
        image.radiance = wp.array(tables.radiance, dtype=wp.vec3, device=self._device)
        image.rows = self._array(tables.rows, wp.float32)
        image.columns = self._array(tables.columns.ravel(), wp.float32)
        image.to_world = wp.mat33(*np.asarray(to_world, np.float64).ravel())
        return image
