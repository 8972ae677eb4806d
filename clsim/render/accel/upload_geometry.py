"""From a world's shapes to the arrays and trees that rays search, and their change from frame to frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.render.accel.bvh16 import Bvh16
from clsim.render.accel.geometry import Geometry, Place, ShadingRow, Tree, mat34
from clsim.render.accel.placement import Placement, uvs
from clsim.render.device.arrays import array, table, write
from clsim.render.features.features import SceneFeatures
from clsim.render.motion.deform import DeformingMesh, box, deforms, flat_or_smooth
from clsim.render.motion.shutter import SHUTTER_KEYS, chord_error, key_steps, quaternions
from clsim.scene import Mesh, Motion, SphereLight
from clsim.scene.meshes.geometry import colors_of

_F64 = npt.NDArray[np.float64]
_WIDER = 1e-6
"""Part of their sizes and places by which boxes are wider than what they hold."""
_MOST_INSTANTS = 64
"""Instants at a time where something moves: boxes of objects hold all places that they have meanwhile."""
_MOST_VERTICES = 1 << 18
"""Vertices of what deforms, all its shapes together: they take memory."""
_SPECKS = 1e-3
"""Part of all squared diagonals of boxes that makes no difference to how large a scene is."""


@dataclass(frozen=True)
class Places:
    """Where instances that move are.

    Attributes:
        time: when that is [s].
        count: how many instances there are, also such that never move.
        moving: which of them these are ``[n]``.
        deforming: which of these deform ``[n]``.
        poses: where they are ``[n, 4, 4]``.
        boxes: lower and upper corners of the boxes around them, along the axes, from the origin ``[n, 2, 3]``.
        into_boxes: what makes the box around each, along its own axes, the cube from −1 to 1 ``[n, 3, 4]``.
    """

    time: float | None
    count: int
    moving: npt.NDArray[np.int64]
    deforming: npt.NDArray[np.bool_]
    poses: _F64
    boxes: _F64
    into_boxes: _F64


def bulk_of(lowers: _F64, uppers: _F64) -> tuple[_F64, float]:
    """Return the middle and half the diagonal of the box around instances, without specks that are far off.

    Those farthest from the middle are left out as long as they have less than a thousandth of all squared diagonals.

    Args:
        lowers: lower corners of the instances' boxes ``[N, 3]``.
        uppers: upper ones.
    """
    sizes = np.square(uppers - lowers).sum(axis=1) + 1e-30
    middles = (lowers + uppers) / 2
    away = np.linalg.norm(middles - np.average(middles, axis=0, weights=sizes), axis=1)
    order = np.argsort(-away, kind="stable")
    specks = order[np.cumsum(sizes[order]) < _SPECKS * sizes.sum()]
    kept = np.setdiff1d(order, specks)
    low, high = lowers[kept].min(axis=0), uppers[kept].max(axis=0)
    return (low + high) / 2, float(np.linalg.norm(high - low) / 2)


class GeometryData:
    """Meshes, instances and sphere lights on a device.

    Attributes:
        geometry: what the kernel takes.
        most_instants: how many instants at a time serve well.
        middle_m: middle of the box around all triangles, from the origin, at the first times.
        radius_m: half the diagonal of that box.
        bulk: middle and half the diagonal of the box around nearly all, without specks that are far off.
        moving: indices of the instances that move or deform.
        moving_boxes: lower and upper corners of the boxes around these, from the origin, at the last times.
    """

    def __init__(
        self,
        placement: Placement,
        may_pass: npt.NDArray[np.bool_],
        sphere_lights: tuple[SphereLight, ...],
        features: SceneFeatures,
        tree: Tree,
        times_s: _F64,
        device: Any,
        pose: Callable[[Motion, float], _F64],
    ) -> None:
        """Copy the shapes, as they are at time 0, and build the trees for what stands somewhere at those times.

        ``may_pass`` says of each material whether rays may pass it.
        """
        self._device, self._pose = device, pose
        self._features = features
        self._instances = placement.instances
        self._sphere_lights = sphere_lights
        self.moving = np.flatnonzero(
            [each.motion.duration_s > 0 or deforms(placement.meshes[each.mesh]) for each in placement.instances]
        )
        meshes = placement.meshes
        first_triangle = np.cumsum([0, *(len(mesh.triangles) for mesh in meshes)])
        # A mesh that deforms stands in the table once for each key of the interval, or each of several instants.
        deforming_vertices = sum(len(mesh.vertices) for mesh in meshes if deforms(mesh))
        self.most_instants = max(2, min(_MOST_INSTANTS, _MOST_VERTICES // max(1, deforming_vertices)))
        shapes_of_one = SHUTTER_KEYS if features.deforming_blur else 1
        if features.deforming_instants:
            shapes_of_one = self.most_instants
        counts = [shapes_of_one if deforms(mesh) else 1 for mesh in meshes]
        first_entry = np.cumsum([0, *counts])
        owner = np.repeat(np.arange(len(meshes)), counts)
        shapes = [meshes[i] for i in owner]
        first_vertex = np.cumsum([0, *(len(mesh.vertices) for mesh in shapes)])
        self.geometry = geometry = Geometry()
        geometry.mesh_first_vertex = array(first_vertex[:-1], wp.int32, device)
        geometry.mesh_first_triangle = array(first_triangle[owner], wp.int32, device)
        geometry.vertices = array(np.concatenate([mesh.vertices for mesh in shapes]), wp.vec3, device)
        geometry.indices = array(np.concatenate([mesh.triangles for mesh in meshes]).ravel(), wp.int32, device)
        geometry.material_ids = array(np.concatenate([mesh.material_ids for mesh in meshes]), wp.int32, device)
        # What is read of a triangle first when it was hit.
        rows = geometry.material_ids
        if features.shading_rows:
            geometry.shading_rows = rows = array(_shading_rows(meshes[0], features), ShadingRow, device)
        elif features.smooth_normals:
            geometry.normals = array(np.concatenate([flat_or_smooth(mesh) for mesh in shapes]), wp.vec3, device)
        if not features.shading_rows and (features.textures or features.anisotropic):
            geometry.uvs = array(np.concatenate([uvs(mesh) for mesh in shapes]), wp.vec2, device)
        if features.vertex_colors:
            geometry.colors = array(np.concatenate([colors_of(mesh) for mesh in shapes]), wp.vec3, device)
        self._trees: list[Any] = []
        self._deforming: dict[int, tuple[int, DeformingMesh]] = {}
        for entry, (mesh, i) in enumerate(zip(shapes, owner, strict=True)):
            own = slice(int(first_vertex[entry]), int(first_vertex[entry + 1]))
            vertices = geometry.vertices[own]
            first, end = int(first_triangle[i]), int(first_triangle[i + 1])
            indices = geometry.indices[3 * first : 3 * end]
            passable, lasts = may_pass[mesh.material_ids], not deforms(mesh)
            bvh16 = partial(Bvh16, may_pass=passable, rows=rows[first:end], lasts=lasts)
            search = bvh16 if tree == "bvh16" else wp.Mesh
            key = entry - int(first_entry[i])
            # All shapes of a mesh have one tree until each is given its own.
            self._trees.append(search(vertices, indices) if key == 0 else self._trees[-1])
            if deforms(mesh):
                normals = geometry.normals[own] if features.smooth_normals else None
                shape = DeformingMesh(mesh, search, vertices, indices, normals, self._trees[-1])
                self._deforming[entry] = key, shape
        self._handles = array([each.id for each in self._trees], wp.uint64, device)
        geometry.mesh_handles = self._handles
        self._boxes = np.array([box(mesh) for mesh in shapes])
        of = np.array([instance.mesh for instance in placement.instances])
        keys = np.minimum(np.arange(max(counts))[:, None], np.array(counts)[of] - 1)
        self._entries = first_entry[of] + keys
        geometry.instance_mesh = array(self._entries.ravel(), wp.int32, device)
        geometry.instance_count = len(placement.instances)
        geometry.sphere_count = len(sphere_lights)
        self._origin_m = placement.origin_m
        geometry.rest_vertices = array(geometry.vertices.numpy(), wp.vec3, device)
        scales = [abs(np.linalg.det(each.motion.pose(0.0)[:3, :3])) ** (1 / 3) for each in placement.instances]
        geometry.rest_scales = array(np.array(scales, np.float32), wp.float32, device)
        geometry.trails = wp.zeros((1, 1), dtype=wp.vec3, device=device)  # type: ignore[assignment]
        self._deforms = np.array([deforms(placement.meshes[placement.instances[i].mesh]) for i in self.moving], bool)
        self._create_places(times_s)

    def places(self, time_s: float | None) -> Places:
        """Return where all that moves was put last, which was for that time."""
        boxes = np.stack(self.moving_boxes, axis=1)
        if self._features.motion_blur:
            into = into_boxes(np.broadcast_to(np.eye(4), (len(boxes), 4, 4)), boxes[:, 0], boxes[:, 1])
        else:
            own = self._boxes[self._entries[0, self.moving]]
            into = into_boxes(self._moving_poses, own[:, 0], own[:, 1])
        return Places(time_s, len(self._instances), self.moving, self._deforms, self._moving_poses, boxes, into)

    def boxes_of_moving(self) -> tuple[_F64, _F64]:
        """Return corners ``[n, 3]`` of the boxes around what moves and all sphere lights, at the last times."""
        lowers, uppers = self.moving_boxes
        if self._sphere_lights:
            low, high = self._sphere_corners
            lowers, uppers = np.concatenate([lowers, low]), np.concatenate([uppers, high])
        return lowers, uppers

    def balls(self) -> tuple[_F64, _F64]:
        """Return middles ``[keys, n, 3]`` and radii ``[keys, n]`` of balls around instances, and of all sphere lights.

        They are from the origin, at each of the last times, or at all of these.
        """
        # Without a tree over instances, all stand still.
        middles, radii = self._balls if self._features.two_level else (part[:1] for part in self._balls)
        if self._sphere_lights:
            places, sizes = self._sphere_balls
            keys = max(len(middles), len(places))
            middles, radii, places, sizes = (
                np.broadcast_to(part, (keys, *part.shape[1:])) for part in (middles, radii, places, sizes)
            )
            middles, radii = np.concatenate([middles, places], axis=1), np.concatenate([radii, sizes], axis=1)
        return middles, radii

    def update(self, times_s: _F64) -> None:
        """Move everything to where it is at those times, the keys of the interval; work only where something moves."""
        for entry, (key, deforming) in self._deforming.items():
            if key < len(times_s):
                self._boxes[entry] = deforming.update(float(times_s[key]))
                self._trees[entry] = deforming.tree
        if self._deforming:
            self._handles.assign(np.array([tree.id for tree in self._trees], np.uint64))
        if self._features.instants and len(times_s) > self._most_times:
            self._create_places(times_s)
            return
        if self._features.two_level:
            poses, steps = self._poses(times_s)
            lowers, uppers = self._bounds(poses, steps)
            self.moving_boxes = lowers[self.moving], uppers[self.moving]
            self._moving_poses = poses[0, self.moving]
            self._lowers.assign(lowers.astype(np.float32))
            self._uppers.assign(uppers.astype(np.float32))
            # A tree that is only fitted makes rays ever slower as objects disperse. To rebuild it takes .4 µs an
            # instance, which is less than to tell whether it is worth it, and much less than to find where all are.
            self._instance_tree.rebuild()
            if self._features.motion_blur:
                self._places.assign(_place_rows(poses, steps))
            else:
                to_world, to_object = _matrices(poses)
                write(self._to_world, to_world)
                write(self._to_object, to_object)
        if self._features.instants or any(light.motion.duration_s > 0 for light in self._sphere_lights):
            spheres, sphere_steps = self._sphere_rows(times_s)
            write(self._spheres, spheres)
            write(self._sphere_steps, sphere_steps)
            if self._sphere_lights:
                self._sphere_corners = self._sphere_bounds(spheres, sphere_steps)
            if self._features.sphere_tree:
                for corners, there in zip(self._sphere_boxes, self._sphere_corners, strict=True):
                    corners.assign(there)
                self._sphere_tree.rebuild()

    def _create_places(self, times_s: _F64) -> None:
        """Put instances and spheres where they are at those times and build the tree over instances."""
        geometry = self.geometry
        self._most_times = len(times_s)
        poses, steps = self._poses(times_s)
        lowers, uppers = self._bounds(poses, steps)
        self.moving_boxes = lowers[self.moving], uppers[self.moving]
        self._moving_poses = poses[0, self.moving]
        self.middle_m = (lowers.min(axis=0) + uppers.max(axis=0)) / 2
        self.radius_m = float(np.linalg.norm(uppers.max(axis=0) - lowers.min(axis=0)) / 2)
        self.bulk = bulk_of(lowers, uppers)
        if self._features.two_level:
            self._lowers = array(lowers.astype(np.float32), wp.vec3, self._device)
            self._uppers = array(uppers.astype(np.float32), wp.vec3, self._device)
            self._instance_tree: Any = wp.Bvh(self._lowers, self._uppers)
            geometry.instance_tree = self._instance_tree.id
            if self._features.motion_blur:
                self._places = array(_place_rows(poses, steps), Place, self._device)
                geometry.places = self._places
            else:
                to_world, to_object = _matrices(poses)
                self._to_world = array(to_world, mat34, self._device)
                self._to_object = array(to_object, mat34, self._device)
                geometry.to_world, geometry.to_object = self._to_world, self._to_object
        if self._sphere_lights or self._features.instants:
            spheres, sphere_steps = self._sphere_rows(times_s)
            self._spheres = array(spheres, wp.vec4, self._device)
            self._sphere_steps = array(sphere_steps, wp.vec3, self._device)
            geometry.spheres, geometry.sphere_steps = self._spheres, self._sphere_steps
            if self._sphere_lights:
                self._sphere_corners = self._sphere_bounds(spheres, sphere_steps)
            if self._features.sphere_tree:
                self._sphere_boxes: list[Any] = [
                    array(corners, wp.vec3, self._device) for corners in self._sphere_corners
                ]
                self._sphere_tree: Any = wp.Bvh(*self._sphere_boxes)
                geometry.sphere_tree = self._sphere_tree.id

    def _poses(self, times_s: _F64) -> tuple[_F64, _F64]:
        """Poses from the origin ``[keys, instances, 4, 4]`` and their steps (``shutter.key_steps``)."""
        motions = [instance.motion for instance in self._instances]
        poses = np.array([[self._pose(motion, float(t)) for motion in motions] for t in times_s])
        poses[..., :3, 3] -= self._origin_m
        return poses, self._steps(motions, times_s, poses[..., :3, 3])

    def _steps(self, motions: list[Motion], times_s: _F64, positions: _F64) -> _F64:
        return key_steps(motions, times_s, positions) if self._features.motion_blur else np.zeros_like(positions)

    def _bounds(self, poses: _F64, steps: _F64) -> tuple[_F64, _F64]:
        """Boxes of what the instances sweep, a little wide so that flat ones and rounding miss nothing."""
        boxes = self._boxes[self._entries[: len(poses)]]  # [keys, instances, 2, 3]
        low, high = boxes[:, :, 0].min(axis=0), boxes[:, :, 1].max(axis=0)
        centres = np.einsum("tnij,nj->tni", poses[..., :3, :3], (low + high) / 2) + poses[..., :3, 3]
        extents = np.einsum("tnij,nj->tni", np.abs(poses[..., :3, :3]), (high - low) / 2)
        self._balls = centres, np.linalg.norm(extents, axis=2)
        extents += _WIDER * (1.0 + np.abs(centres) + extents)
        lowers, uppers = (centres - extents).min(axis=0), (centres + extents).max(axis=0)
        if self._features.motion_blur:
            farthest = np.linalg.norm(np.maximum(np.abs(low), np.abs(high)), axis=1)
            beyond = chord_error(poses[..., :3, 3], steps) + _sagitta(poses[..., :3, :3], farthest)[:, None]
            lowers, uppers = lowers - beyond, uppers + beyond
        return lowers, uppers

    def _sphere_bounds(
        self, rows: npt.NDArray[np.float32], steps: npt.NDArray[np.float32]
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """Return the corners of boxes around what each sphere sweeps ``[spheres, 3]``; rows are of `_sphere_rows`."""
        places = rows.reshape(-1, len(self._sphere_lights), 4).astype(np.float64)
        centres, extents = places[..., :3], places[..., 3:]
        self._sphere_balls = centres, extents[..., 0]
        extents = extents + _WIDER * (1.0 + np.abs(centres) + extents)
        lowers, uppers = (centres - extents).min(axis=0), (centres + extents).max(axis=0)
        if self._features.motion_blur:
            beyond = chord_error(centres, steps.reshape(centres.shape).astype(np.float64))
            lowers, uppers = lowers - beyond, uppers + beyond
        return lowers.astype(np.float32), uppers.astype(np.float32)

    def _sphere_rows(self, times_s: _F64) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """Centres from the origin and radii ``[keys · spheres, 4]``, and steps (``shutter.key_steps``)."""
        motions = [light.motion for light in self._sphere_lights]
        centres = np.array([[self._pose(motion, float(t))[:3, 3] for motion in motions] for t in times_s])
        centres = centres.reshape(len(times_s), -1, 3) - self._origin_m
        radii = np.broadcast_to([light.radius_m for light in self._sphere_lights], centres.shape[:2])
        rows = np.concatenate([centres, radii[..., None]], axis=2).reshape(-1, 4)
        steps = self._steps(motions, times_s, centres).reshape(-1, 3)
        return rows.astype(np.float32), steps.astype(np.float32)


def into_boxes(poses: _F64, lower: _F64, upper: _F64) -> _F64:
    """Return what makes boxes the cube from −1 to 1 ``[n, 3, 4]``: a little wide, so that rounding misses nothing.

    ``poses`` ``[n, 4, 4]`` take them to the world, corners ``[n, 3]`` are in their own spaces.
    """
    centres, extents = (lower + upper) / 2, (upper - lower) / 2
    back = np.linalg.inv(poses)
    # How far a unit of the world reaches along each of their axes.
    units = np.linalg.norm(back[:, :3, :3], axis=2)
    reach = 1.0 + np.abs(poses[:, :3, 3]).max(axis=1, keepdims=True) + np.abs(centres) / np.maximum(units, 1e-30)
    extents = extents * (1.0 + _WIDER) + _WIDER * reach * units
    back[:, :3, 3] -= centres
    return np.asarray(back[:, :3] / extents[..., None])


def _shading_rows(mesh: Mesh, features: SceneFeatures) -> npt.NDArray[np.void]:
    """Return the table of ``ShadingRow`` of the one mesh that holds all that stands still."""
    rows: npt.NDArray[np.void] = table(ShadingRow, len(mesh.triangles))
    normals, at = flat_or_smooth(mesh), uvs(mesh)
    for corner, vertices in enumerate(mesh.triangles.T):
        if features.smooth_normals:
            rows[f"normal{corner}"] = normals[vertices]
        rows[f"uv{corner}"] = at[vertices]
    rows["material"] = mesh.material_ids
    return rows


def _matrices(poses: _F64) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Return the upper three rows of poses ``[times, instances, 4, 4]`` and of their inverses, one after the other."""
    poses = poses.reshape(-1, 4, 4)
    return poses[:, :3].astype(np.float32), np.linalg.inv(poses)[:, :3].astype(np.float32)


def _place_rows(poses: _F64, steps: _F64) -> npt.NDArray[np.void]:
    """Return the table of ``Place``, instance by instance for each key."""
    rows: npt.NDArray[np.void] = table(Place, poses.shape[:2])
    turns, rows["scale"] = _turns(poses[..., :3, :3])
    rows["rotation"], rows["position"], rows["step"] = turns, poses[..., :3, 3], steps
    return rows.ravel()


def _sagitta(linear: _F64, radii_m: _F64) -> _F64:
    """Return by how much a point so far from an instance's place leaves the chord between keys as that turns [m].

    ``linear`` is ``[keys, n, 3, 3]``, ``radii_m`` ``[n]`` in the instance's own units.
    """
    turns, scales = _turns(linear)
    # The cosine of half the angle from key to key.
    cosines = (turns[1:] * turns[:-1]).sum(axis=-1)
    return np.asarray(radii_m * scales.max(axis=0) * (1.0 - np.clip(cosines, 0.0, 1.0)).max(axis=0))


def _turns(linear: _F64) -> tuple[_F64, _F64]:
    """Return the unit quaternions and the scales of rotations times a positive number, ``[keys, n, 3, 3]``."""
    scales = np.cbrt(np.linalg.det(linear))
    return quaternions(linear / scales[..., None, None]), np.asarray(scales)
