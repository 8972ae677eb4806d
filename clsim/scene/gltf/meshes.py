"""glTF meshes: the primitives of one mesh as one set of triangles (glTF 2.0, section 3.7)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.scene.gltf import schema
from clsim.scene.gltf.accessors import GltfFile
from clsim.scene.gltf.draco import unpacked
from clsim.scene.gltf.materials import MaterialReader
from clsim.scene.world import F32, I32, Mesh

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Geometry:
    """Triangles, and what pulls at their vertices.

    Attributes:
        vertices: float32 ``[n, 3]``.
        triangles: int32 ``[m, 3]``.
        material_ids: int32 ``[m]``.
        normals: float32 ``[n, 3]``, or None where no primitive has them.
        uvs: float32 ``[n, 2]`` with v up, or None where no primitive has them.
        colors: float32 ``[n, 3]``, or None where no primitive has them.
        targets: float32 ``[t, n, 3]``, differences of the vertices per morph target.
        normal_targets: likewise of the normals.
        joints: int32 ``[n, 4·sets]``, indices into a skin's joints.
        weights: float32 ``[n, 4·sets]``, of sum 1.
    """

    vertices: F32
    triangles: I32
    material_ids: I32
    normals: F32 | None
    uvs: F32 | None
    colors: F32 | None
    targets: F32
    normal_targets: F32
    joints: I32
    weights: F32

    def mirrored(self) -> Geometry:
        """Return it with the triangles turned round, as a matrix that mirrors asks for."""
        normals = None if self.normals is None else -self.normals
        triangles = np.ascontiguousarray(self.triangles[:, ::-1])
        return replace(self, triangles=triangles, normals=normals, normal_targets=-self.normal_targets)

    def mesh(self) -> Mesh:
        """Return it as it is at rest."""
        return Mesh(self.vertices, self.triangles, self.material_ids, self.normals, self.uvs, self.colors)


def read_geometry(
    file: GltfFile, index: int, materials: MaterialReader, warn: Callable[[str], None]
) -> Geometry | None:
    """Join the primitives of a mesh; None where none of them has triangles.

    Raises:
        InputError: if arrays do not fit together.
    """
    mesh = file.item("meshes", file.json.meshes, index)
    parts: list[Geometry] = []
    for k, primitive in enumerate(mesh.primitives):
        if primitive.mode < 4:
            warn("points and lines are left out")
            continue
        place = f"meshes[{index}].primitives[{k}]"
        part = _read_primitive(file, place, unpacked(file, place, primitive), materials, warn)
        if part.normals is not None and not np.isfinite(part.normals).all():
            warn("a mesh with normals that are not finite is rendered flat")
            part = replace(part, normals=None)
        if len(part.triangles):
            parts.append(part)
    if not parts:
        return None
    if any(part.normals is not None for part in parts):
        parts = [part if part.normals is not None else _flat(part) for part in parts]
    return parts[0] if len(parts) == 1 else _joined(file, f"meshes[{index}]", parts)


def _read_primitive(
    file: GltfFile, place: str, primitive: schema.Primitive, materials: MaterialReader, warn: Callable[[str], None]
) -> Geometry:
    attributes = primitive.attributes
    if "POSITION" not in attributes:
        raise InputError(f"{file.path}: {place} has no POSITION")
    n = len(file.accessor(attributes["POSITION"], "POSITION", "VEC3"))

    def values(source: dict[str, int], name: str, *types: str) -> Array | None:
        if name not in source:
            return None
        found = file.accessor(source[name], name, *types)
        if len(found) != n:
            raise InputError(f"{file.path}: {place} has {n} vertices and {len(found)} of {name}")
        return found

    positions = np.ascontiguousarray(values(attributes, "POSITION", "VEC3"), np.float32)
    told = values(attributes, "NORMAL", "VEC3")
    if told is not None and not told.any():
        warn("a mesh whose normals are all 0 is rendered flat")
        told = None
    normals = _unit(told)
    material = materials.index(primitive.material)
    coordinates = values(attributes, f"TEXCOORD_{materials.texcoord(primitive.material)}", "VEC2")
    uvs = None
    if coordinates is None and materials.is_textured(primitive.material):
        warn("a texture on a mesh without its texture coordinates shows one colour")
    if coordinates is not None:
        uvs = np.stack([coordinates[:, 0], 1.0 - coordinates[:, 1].astype(np.float64)], axis=1).astype(np.float32)
    colors = _colors(values(attributes, "COLOR_0", "VEC3", "VEC4"), warn)
    if colors is not None and materials.is_unlit(primitive.material):
        warn("colours of vertices of unlit materials are left out")
    targets: list[Array] = []
    normal_targets: list[Array] = []
    for target in primitive.targets:
        for name in sorted(name for name in target if name.startswith(("COLOR_", "TEXCOORD_"))):
            warn(f"{name} of morph targets is left out")
        for name, found in (("POSITION", targets), ("NORMAL", normal_targets)):
            delta = values(target, name, "VEC3")
            file.claim(0 if delta is not None else n * 12, f"{place}.targets")
            found.append(np.zeros((n, 3), np.float32) if delta is None else np.nan_to_num(delta.astype(np.float32)))
    joints, weights = [], []
    for k in range(4):
        pair = values(attributes, f"JOINTS_{k}", "VEC4"), values(attributes, f"WEIGHTS_{k}", "VEC4")
        if pair[0] is not None and pair[1] is not None:
            joints.append(pair[0].astype(np.int32))
            weights.append(np.maximum(pair[1].astype(np.float32), 0.0))
    triangles = _triangles(file, place, primitive, n)
    return Geometry(
        vertices=positions,
        triangles=triangles,
        material_ids=np.full(len(triangles), material, np.int32),
        normals=normals,
        uvs=uvs,
        colors=colors,
        targets=np.stack(targets) if targets else np.zeros((0, n, 3), np.float32),
        normal_targets=np.stack(normal_targets) if targets else np.zeros((0, n, 3), np.float32),
        joints=np.concatenate(joints, axis=1) if joints else np.zeros((n, 0), np.int32),
        weights=_normalised(np.concatenate(weights, axis=1)) if weights else np.zeros((n, 0), np.float32),
    )


def _colors(colors: Array | None, warn: Callable[[str], None]) -> F32 | None:
    """Return vertex colours, which multiply the base colour and are linear; None where all are white."""
    if colors is None or not len(colors):
        return None
    if colors.shape[1] == 4 and colors[:, 3].min() < 1 - 1 / 256:
        warn("the opacity of vertex colours is left out")
    rgb = np.clip(np.nan_to_num(colors[:, :3].astype(np.float32)), 0.0, 1.0)
    return None if (rgb == 1).all() else np.ascontiguousarray(rgb)


def _triangles(file: GltfFile, place: str, primitive: schema.Primitive, n: int) -> I32:
    if primitive.indices is None:
        order = np.arange(n, dtype=np.int64)
    else:
        order = file.accessor(primitive.indices, "indices", "SCALAR")[:, 0]
        if order.dtype.kind == "f":
            raise InputError(f"{file.path}: {place}.indices are floats, expected whole numbers")
        if len(order) and not (order.min() >= 0 and order.max() < n):
            wrong = order[(order < 0) | (order >= n)][0]
            raise InputError(f"{file.path}: {place}.indices has {wrong}, expected 0 to {n - 1}")
    if primitive.mode == 4:
        triangles = order[: len(order) // 3 * 3].reshape(-1, 3)
    elif len(order) < 3:
        triangles = order[:0].reshape(0, 3)
    elif primitive.mode == 5:  # a strip: every second triangle runs the other way round
        first = np.arange(len(order) - 2)
        odd = first % 2
        triangles = np.stack([order[first], order[first + 1 + odd], order[first + 2 - odd]], axis=1)
    else:  # a fan
        triangles = np.stack([np.full(len(order) - 2, order[0]), order[1:-1], order[2:]], axis=1)
    return np.ascontiguousarray(triangles, np.int32)


def _unit(normals: Array | None) -> F32 | None:
    if normals is None:
        return None
    lengths = np.linalg.norm(normals.astype(np.float64), axis=1, keepdims=True)
    return np.where(~(lengths <= 1e-12), normals / np.maximum(lengths, 1e-12), (0.0, 1.0, 0.0)).astype(np.float32)


def _normalised(weights: Array) -> F32:
    sums = weights.sum(axis=1, keepdims=True)
    scaled = np.where(sums > 0, weights / np.maximum(sums, 1e-30), 0.0)
    scaled[sums[:, 0] <= 0, 0] = 1.0
    return np.asarray(scaled, np.float32)


def _flat(part: Geometry) -> Geometry:
    """Give every triangle vertices of its own, with its own normal: beside smooth parts it must look flat."""
    corners = part.triangles.ravel()
    own: dict[str, Any] = {}
    for field in fields(Geometry):
        value = getattr(part, field.name)
        if field.name in ("targets", "normal_targets"):
            own[field.name] = np.ascontiguousarray(value[:, corners])
        elif field.name in ("vertices", "uvs", "colors", "joints", "weights"):
            own[field.name] = None if value is None else np.ascontiguousarray(value[corners])
    a, b, c = (own["vertices"][k::3].astype(np.float64) for k in range(3))
    own["normals"] = _unit(np.repeat(np.cross(b - a, c - a), 3, axis=0))
    triangles = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    return replace(part, triangles=triangles, **own)


def _joined(file: GltfFile, place: str, parts: list[Geometry]) -> Geometry:
    counts = [len(part.vertices) for part in parts]
    total = sum(counts)
    width = max(part.joints.shape[1] for part in parts)
    morphs = max(len(part.targets) for part in parts)
    triangles = sum(len(part.triangles) for part in parts)
    file.claim(total * (32 + 8 * width + 24 * morphs) + triangles * 16, place)
    first = np.cumsum([0, *counts])

    def padded(array: Array, shape: tuple[int, ...]) -> Array:
        room = np.zeros(shape, array.dtype)
        room[tuple(slice(0, size) for size in array.shape)] = array
        return room

    def uv_of(part: Geometry) -> F32:
        return np.zeros((len(part.vertices), 2), np.float32) if part.uvs is None else part.uvs

    def colors_of(part: Geometry) -> F32:
        return np.ones((len(part.vertices), 3), np.float32) if part.colors is None else part.colors

    normals = [part.normals for part in parts if part.normals is not None]
    colored = any(part.colors is not None for part in parts)
    weights = np.concatenate([padded(p.weights, (len(p.vertices), width)) for p in parts])
    return Geometry(
        vertices=np.concatenate([part.vertices for part in parts]),
        triangles=np.concatenate([part.triangles + np.int32(start) for part, start in zip(parts, first, strict=False)]),
        material_ids=np.concatenate([part.material_ids for part in parts]),
        normals=np.concatenate(normals) if normals else None,
        uvs=np.concatenate([uv_of(part) for part in parts]) if any(p.uvs is not None for p in parts) else None,
        colors=np.concatenate([colors_of(part) for part in parts]) if colored else None,
        targets=np.concatenate([padded(p.targets, (morphs, len(p.vertices), 3)) for p in parts], axis=1),
        normal_targets=np.concatenate([padded(p.normal_targets, (morphs, len(p.vertices), 3)) for p in parts], axis=1),
        joints=np.concatenate([padded(p.joints, (len(p.vertices), width)) for p in parts]),
        weights=_normalised(weights) if width else weights,
    )
