"""glTF scenes: nodes, animation, skins, morph targets, materials, lights and cameras, from the file to the world.

Several animations: the first plays, and with it each one that moves nothing that an earlier one moves already
(exporters write one per object); ``#NAME`` or ``#INDEX`` after the file's name plays that one alone. Where the file
brings no camera, it is an asset rather than a scene: the camera orbits around it, and its animation repeats.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.scene.defaults.framing import (
    ENVIRONMENT,
    ORBIT_S,
    bounds,
    glow_lights,
    lamp,
    orbiting_camera,
)
from clsim.scene.defaults.indoors import stand_inside
from clsim.scene.gltf import schema
from clsim.scene.gltf.accessors import GltfFile
from clsim.scene.gltf.animation import Channel, MeshDeformation, NodeMotion, NodeTree
from clsim.scene.gltf.cameras import camera_of
from clsim.scene.gltf.channels import read_channels
from clsim.scene.gltf.instancing import copies
from clsim.scene.gltf.light import LightTracks
from clsim.scene.gltf.materials import MaterialReader
from clsim.scene.gltf.meshes import Geometry, read_geometry
from clsim.scene.meshes.geometry import is_similarity, placed_rigidly, transformed
from clsim.scene.motion import Matrix, Motion, Static
from clsim.scene.parts import Parts
from clsim.scene.rigid import Facing, facing
from clsim.scene.world import Camera, Instance, Mesh, PunctualLight, Vec3, World

LUMENS_PER_WATT = 683.0
"""Luminous efficacy that lights' candela and lux are divided by, as Blender's exporter multiplies."""
MAX_DEPTH = 1000
MAX_INSTANCES = 100_000
F64 = npt.NDArray[np.float64]


def load_gltf(path: Path, animation: str | None = None) -> World:
    """Load a ``.gltf`` or ``.glb`` as a whole scene.

    Args:
        path: the file.
        animation: name or index of the one animation to play; None plays all that do not contradict each other.

    Raises:
        InputError: one sentence that names the file and what is wrong with it.
    """
    file = GltfFile(path)
    has_camera = any(node.camera is not None for node in file.json.nodes)
    parts = _Reader(file, animation, repeat=not has_camera).read()
    _check_meshes(path, parts)
    warnings, notes = list(parts.warnings), list(parts.notes)
    duration_s = parts.duration_s
    center, size = (0.0, 0.0, 0.0), np.ones(3)
    if not (parts.lights and parts.cameras):
        center, size = bounds(path, parts.meshes, parts.instances)
    lit = bool(parts.lights) or glow_lights(parts.meshes, parts.instances, parts.materials, size)
    if not lit:
        glows = any(any(material.emission) for material in parts.materials)
        notes.append(f"{path.name}: has no lights{', and what glows is weak' if glows else ''}: a lamp is added")
    lamps = (lamp(center, size),)
    if parts.cameras:
        camera = parts.cameras[0]
        if len(parts.cameras) > 1:
            notes.append(f"{path.name}: has {len(parts.cameras)} cameras, the first is used")
    else:  # a whole number of the animation's cycles, so that the end joins the start
        period_s = duration_s * max(1, round(ORBIT_S / duration_s)) if duration_s else ORBIT_S
        camera = orbiting_camera(center, size, period_s)
        if inside := stand_inside(parts.meshes, parts.instances, center, size, period_s):
            camera, lamps = inside[0], (inside[1],)
            notes.append(f"{path.name}: {inside[2]}")
        duration_s = period_s
    return World(
        name=path.stem,
        camera=camera,
        meshes=tuple(parts.meshes),
        instances=tuple(parts.instances),
        materials=tuple(parts.materials),
        textures=tuple(parts.textures),
        punctual_lights=tuple(parts.lights),
        sphere_lights=() if lit else lamps,
        environment=(0.0, 0.0, 0.0) if lit else ENVIRONMENT,
        duration_s=duration_s or 1.0,
        warnings=tuple(warnings),
        notes=tuple(notes),
    )


def read_gltf(path: Path) -> Parts:
    """Read a ``.gltf`` or ``.glb`` as part of another scene; its animation repeats.

    Raises:
        InputError: as `load_gltf`.
    """
    parts = _Reader(GltfFile(path), None, repeat=True).read()
    _check_meshes(path, parts)
    return parts


def read_camera(path: Path) -> Camera:
    """Return the first camera of a ``.gltf`` or ``.glb``, which plays its animation once; raises InputError."""
    cameras = _Reader(GltfFile(path), None, repeat=False).read().cameras
    if not cameras:
        raise InputError(f"{path}: has no camera")
    return cameras[0]


def _check_meshes(path: Path, parts: Parts) -> None:
    if not parts.instances:
        raise InputError(f"{path}: has no triangles, expected a mesh")


class _Reader:
    """Collects a file's contents as its nodes are visited."""

    def __init__(self, file: GltfFile, animation: str | None, *, repeat: bool) -> None:
        self.file, self.path = file, file.path
        self.warnings: list[str] = []
        self.notes: list[str] = []
        self.meshes: list[Mesh] = []
        self.instances: list[Instance] = []
        self.lights: list[PunctualLight] = []
        self.cameras: list[Camera] = []
        if unknown := file.unknown():
            self._warn(f"extensions are left out: {', '.join(unknown)}")
        channels = read_channels(file, animation, self._warn, self.notes)
        self.tree = self._tree(channels, repeat)
        self.light = LightTracks(channels, self.tree.duration_s, repeat=repeat)
        self.materials = MaterialReader(file, self.light, self._warn)
        self.geometries: dict[int, Geometry | None] = {}
        self.plain: dict[int, int] = {}

    def read(self) -> Parts:
        """Visit the nodes of the scene and return what stands there."""
        json = self.file.json
        for index in self._scene_nodes():
            node = json.nodes[index]
            if node.mesh is not None:
                self._add_mesh(index, node, node.mesh)
            if node.camera is not None:
                self._add_camera(index, node.camera)
            if node.extensions.KHR_lights_punctual is not None:
                self._add_light(index, node.extensions.KHR_lights_punctual.light)
            if len(self.instances) > MAX_INSTANCES:
                raise InputError(f"{self.path}: places more than {MAX_INSTANCES} meshes")
        return Parts(
            self.meshes,
            self.materials.materials,
            self.materials.textures,
            self.instances,
            self.lights,
            self.cameras,
            self.tree.duration_s,
            self.warnings,
            self.notes,
        )

    def _warn(self, sentence: str) -> None:
        text = f"{self.path.name}: {sentence}"
        if text not in self.warnings:
            self.warnings.append(text)

    def _scene_nodes(self) -> list[int]:
        """Return the nodes of the default scene, parents first."""
        json = self.file.json
        if json.scenes:
            pending = list(self.file.item("scenes", json.scenes, json.scene or 0).nodes)
        else:
            children = {child for node in json.nodes for child in node.children}
            pending = [i for i in range(len(json.nodes)) if i not in children]
        found: list[int] = []
        seen: set[int] = set()
        pending.reverse()
        while pending:
            index = pending.pop()
            node = self.file.item("nodes", json.nodes, index)
            if index not in seen and node.extensions.KHR_node_visibility.visible:
                seen.add(index)
                found.append(index)
                pending += reversed(node.children)
        return found

    def _tree(self, channels: list[Channel], repeat: bool) -> NodeTree:
        nodes = self.file.json.nodes
        parents = [-1] * len(nodes)
        for i, node in enumerate(nodes):
            for child in node.children:
                if child >= len(nodes) or parents[child] >= 0 or child == i:
                    raise InputError(
                        f"{self.path}: nodes[{i}] has child {child}, expected an existing node of no other parent"
                    )
                parents[child] = i
        level, reached = [i for i in range(len(nodes)) if parents[i] < 0], 0
        for _ in range(MAX_DEPTH):
            reached += len(level)
            level = [child for i in level for child in nodes[i].children]
        if reached < len(nodes):
            raise InputError(
                f"{self.path}: a node is its own ancestor or lies {MAX_DEPTH} levels deep, expected a tree of nodes"
            )
        fixed = {i: np.array(node.matrix).reshape(4, 4).T for i, node in enumerate(nodes) if node.matrix is not None}
        trs = (
            np.array([node.translation or (0.0, 0.0, 0.0) for node in nodes]).reshape(-1, 3),
            np.array([node.rotation or (0.0, 0.0, 0.0, 1.0) for node in nodes]).reshape(-1, 4),
            np.array([node.scale or (1.0, 1.0, 1.0) for node in nodes]).reshape(-1, 3),
        )
        return NodeTree(parents, trs, fixed, channels, repeat=repeat)

    def _geometry(self, index: int) -> Geometry | None:
        if index not in self.geometries:
            self.geometries[index] = read_geometry(self.file, index, self.materials, self._warn)
        return self.geometries[index]

    def _add_mesh(self, index: int, node: schema.Node, mesh_index: int) -> None:
        geometry = self._geometry(mesh_index)
        if geometry is None:
            return
        name = node.name or self.file.json.meshes[mesh_index].name or f"nodes[{index}]"
        skin = None
        if node.skin is not None and geometry.joints.shape[1]:
            skin = self.file.item("skins", self.file.json.skins, node.skin)
        placed = copies(self.file, index, node)
        if skin is None and not len(geometry.targets):
            if placed is None:
                self._add_plain(index, mesh_index, geometry, name)
            else:
                self._add_copies(index, geometry, name, placed)
            return
        if placed is not None:
            self._warn("copies of meshes that change their shape are left out, but for one")
        weights: Channel | F64 | None = self.tree.weights(index)
        if weights is None:
            listed = node.weights or self.file.json.meshes[mesh_index].weights
            weights = np.zeros(len(geometry.targets))
            weights[: len(listed)] = listed[: len(geometry.targets)]
        joints, bind = np.zeros(0, np.int64), np.zeros((0, 4, 4))
        if skin is not None:
            joints, bind = self._joints(node.skin or 0, skin, geometry)
        elif not self._placeable(index):
            joints, bind = np.array([index]), np.eye(4)[None]
        deformed = self._deformed(geometry, weights, joints, bind)
        if skin is not None or len(joints):
            self._place(deformed, Static(np.eye(4)), name)
        else:
            self._place(deformed, self._node_motion(index), name)

    def _add_plain(self, index: int, mesh_index: int, geometry: Geometry, name: str) -> None:
        """Place a mesh that keeps its shape; a place that stretches it over time makes it a deformation."""
        if not self.tree.moving[index]:
            matrix = self.tree.matrices(0.0)[index]
            if mesh_index not in self.plain:
                self.plain[mesh_index] = len(self.meshes)
                self.meshes.append(geometry.mesh())
            placed, pose = placed_rigidly(self.meshes, self.plain[mesh_index], matrix)
            self.instances.append(Instance(placed, Static(pose), name))
        elif self._placeable(index):
            if mesh_index not in self.plain:
                self.plain[mesh_index] = len(self.meshes)
                self.meshes.append(geometry.mesh())
            self.instances.append(Instance(self.plain[mesh_index], self._node_motion(index), name))
        elif self._placeable(index, all_but_own_scale=True):
            own = np.diag(self.tree.scales(index)[0])
            self._place(transformed(geometry.mesh(), own), NodeMotion(self.tree, index, _inverse_scale(own)), name)
        else:
            self._place(
                self._deformed(geometry, np.zeros(0), np.array([index]), np.eye(4)[None]), Static(np.eye(4)), name
            )

    def _add_copies(self, index: int, geometry: Geometry, name: str, placed: list[Matrix]) -> None:
        """Place copies of a mesh that keeps its shape; they move as their node does, one scale for all axes."""
        if len(self.instances) + len(placed) > MAX_INSTANCES:
            raise InputError(f"{self.path}: places more than {MAX_INSTANCES} meshes")
        first = len(self.meshes)
        self.meshes.append(geometry.mesh())
        moves = self.tree.moving[index]
        if moves and not self._placeable(index):
            self._warn(f"{name} stretches over time; its copies stand still")
            moves = False
        still = np.eye(4) if moves else self.tree.matrices(0.0)[index]
        for k, matrix in enumerate(placed):
            copy, pose = placed_rigidly(self.meshes, first, still @ matrix)
            motion: Motion = NodeMotion(self.tree, index, pose) if moves else Static(pose)
            self.instances.append(Instance(copy, motion, f"{name}[{k}]"))

    def _place(self, mesh: Mesh, motion: Motion, name: str) -> None:
        self.file.claim(mesh.vertices.nbytes + mesh.triangles.nbytes, f"the deformed copy {name}")
        self.instances.append(Instance(len(self.meshes), motion, name))
        self.meshes.append(mesh)

    def _placeable(self, index: int, *, all_but_own_scale: bool = False) -> bool:
        """Tell whether a node's matrix is at all times a rotation with one positive scale."""
        if not self.tree.moving[index]:
            return is_similarity(self.tree.matrices(0.0)[index][:3, :3])
        for node in self.tree.chain(index):
            if self.file.json.nodes[node].matrix is not None:
                if not is_similarity(self.tree.rest_local(node)[:3, :3]):
                    return False
                continue
            scales, own = self.tree.scales(node), all_but_own_scale and node == index
            if self.tree.spline_scaled(node) or (own and (len(scales) > 1 or np.abs(scales).min() < 1e-9)):
                return False
            uniform = np.abs(scales - scales[:, :1]).max() <= 1e-6 * np.abs(scales).max()
            if not own and (not uniform or scales.min() < 1e-9):
                return False
        return True

    def _node_motion(self, index: int) -> Motion:
        if self.tree.moving[index]:
            return NodeMotion(self.tree, index, np.eye(4))
        return Static(self.tree.matrices(0.0)[index].copy())

    def _joints(self, skin_index: int, skin: schema.Skin, geometry: Geometry) -> tuple[npt.NDArray[np.int64], Matrix]:
        joints = np.array(skin.joints, np.int64)
        place = f"{self.path}: skins[{skin_index}]"
        if joints.max() >= len(self.file.json.nodes):
            raise InputError(f"{place} uses node {joints.max()}, of {len(self.file.json.nodes)}")
        if geometry.joints.max(initial=0) >= len(joints) or geometry.joints.min(initial=0) < 0:
            raise InputError(f"{place} has {len(joints)} joints, a vertex uses joint {geometry.joints.max()}")
        bind = np.tile(np.eye(4), (len(joints), 1, 1))
        if skin.inverseBindMatrices is not None:
            given = self.file.accessor(skin.inverseBindMatrices, "inverse bind matrices", "MAT4")
            if len(given) < len(joints):
                raise InputError(f"{place} has {len(given)} inverse bind matrices for {len(joints)} joints")
            bind = given[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)
        return joints, bind

    def _deformed(
        self, geometry: Geometry, weights: Channel | F64, joints: npt.NDArray[np.int64], bind: Matrix
    ) -> Mesh:
        skinned = geometry.joints.shape[1] > 0 and len(joints) > 0
        if len(joints) and np.linalg.det((self.tree.matrices(0.0)[joints[0]] @ bind[0])[:3, :3]) < 0:
            geometry = geometry.mirrored()
        deformation = MeshDeformation(
            self.tree,
            geometry.vertices,
            geometry.normals,
            geometry.targets,
            None if geometry.normals is None else geometry.normal_targets,
            weights,
            joints,
            bind,
            geometry.joints if skinned else np.zeros((len(geometry.vertices), 0), np.int32),
            geometry.weights if skinned else np.zeros((len(geometry.vertices), 0), np.float32),
        )
        vertices, normals = deformation.vertices_at(0.0)
        mesh = replace(geometry.mesh(), vertices=vertices, normals=normals)
        return replace(mesh, deformation=deformation) if deformation.duration_s > 0 else mesh

    def _add_camera(self, index: int, camera_index: int) -> None:
        camera = self.file.item("cameras", self.file.json.cameras, camera_index)
        motion: Motion = Facing(NodeMotion(self.tree, index, np.eye(4)))
        if not self.tree.moving[index]:
            motion = Static(facing(self.tree.matrices(0.0)[index]))
        seen = camera_of(camera, self.tree.matrices(0.0)[index], motion, self._warn)
        self.cameras += [] if seen is None else [seen]

    def _add_light(self, index: int, light_index: int) -> None:
        light = self.file.item("lights", self.file.json.extensions.KHR_lights_punctual.lights, light_index)
        (r, g, b), modulation = self.light.lamp(light_index, light.color, light.intensity)
        intensity: Vec3 = (r / LUMENS_PER_WATT, g / LUMENS_PER_WATT, b / LUMENS_PER_WATT)
        motion: Motion = Facing(NodeMotion(self.tree, index, np.eye(4)))
        if not self.tree.moving[index]:
            motion = Static(facing(self.tree.matrices(0.0)[index]))
        if light.range is not None:
            self._warn("the range of lamps is left out: their light never ends")
        cone = light.spot
        self.lights.append(
            PunctualLight(
                light.type,
                intensity,
                motion,
                inner_deg=math.degrees(min(cone.innerConeAngle, cone.outerConeAngle)),
                outer_deg=math.degrees(cone.outerConeAngle),
                name=self.file.json.nodes[index].name or light.name or f"nodes[{index}]",
                modulation=modulation,
            )
        )


def _inverse_scale(linear: Matrix) -> Matrix:
    matrix = np.eye(4)
    matrix[:3, :3] = np.diag(1.0 / np.diag(linear))
    return matrix
