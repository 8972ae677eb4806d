"""MuJoCo's geoms as meshes, in the geom's own frame (z is their axis)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.scene.meshes.geometry import joined, smooth_normals, transformed
from clsim.scene.mujoco.surfaces import is_cube, texture_of
from clsim.scene.shapes import box
from clsim.scene.world import Mesh

_AROUND = 48
"""Segments around the axis of what is round."""
_F64 = npt.NDArray[np.float64]


def mesh_of(model: Any, geom: int) -> Mesh | None:
    """Return the mesh of a geom; None for kinds that are not drawn as triangles here (signed distance fields).

    Round ones are of 48 segments, with smooth normals. An infinite plane reaches ten times as far as the model.
    """
    import mujoco

    kinds, size = mujoco.mjtGeom, model.geom_size[geom]
    kind = model.geom_type[geom]
    if kind == kinds.mjGEOM_PLANE:
        half = [each if each > 0 else 10.0 * float(model.stat.extent) for each in size[:2].tolist()]
        return _plane(half[0], half[1])
    if kind == kinds.mjGEOM_BOX:
        return _box(model, geom)
    if kind == kinds.mjGEOM_SPHERE:
        return _turned(_cap(size[0], 0.0, -1.0) + _cap(size[0], 0.0, 1.0))
    if kind == kinds.mjGEOM_ELLIPSOID:
        return transformed(_turned(_cap(1.0, 0.0, -1.0) + _cap(1.0, 0.0, 1.0)), np.diag(size))
    if kind == kinds.mjGEOM_CAPSULE:
        return _turned(_cap(size[0], -size[1], -1.0) + _cap(size[0], size[1], 1.0))
    if kind == kinds.mjGEOM_CYLINDER:
        r, z = size[0], size[1]
        ends = [(0.0, -z, 0.0, -1.0), (r, -z, 0.0, -1.0)], [(r, z, 0.0, 1.0), (0.0, z, 0.0, 1.0)]
        return _turned(ends[0] + [(r, -z, 1.0, 0.0), (r, z, 1.0, 0.0)] + ends[1])
    if kind == kinds.mjGEOM_MESH:
        return _own_mesh(model, int(model.geom_dataid[geom]))
    if kind == kinds.mjGEOM_HFIELD:
        return _height_field(model, int(model.geom_dataid[geom]))
    return None


def _box(model: Any, geom: int) -> Mesh:
    """Return a box, each of whose sides has u and v from 0 to 1, or those of its part of the texture of a cube."""
    size = model.geom_size[geom]
    mesh = box((2 * size[0], 2 * size[1], 2 * size[2]))
    texture = texture_of(model, geom)
    if not is_cube(model, texture):
        return replace(mesh, uvs=np.tile(np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32), (6, 1)))
    width, height = int(model.tex_width[texture]), int(model.tex_height[texture])
    uvs = []
    for side, corners in enumerate(np.sign(mesh.vertices.astype(np.float64)).reshape(6, 4, 3)):
        axis, up = side // 2, side % 2  # of two sides the lower one comes first
        x, y, z = corners.T
        # As OpenGL lays a cube's pictures; their rows go down.
        s = ((z, -z), (x, x), (-x, x))[axis][up]
        t = (-y, (z if up else -z), -y)[axis]
        picture = 2 * axis + 1 - up if height > width else 0
        inside = 0.5 + 0.5 * t * (1 - 1 / width)  # half a pixel from the next picture
        uvs.append(np.stack([0.5 + 0.5 * s, 1 - (picture + inside) * width / height], axis=1))
    return replace(mesh, uvs=np.concatenate(uvs).astype(np.float32))


def _plane(x: float, y: float) -> Mesh:
    """Return a rectangle that faces +z, with u and v in metres from its middle."""
    corners = np.array([(-x, -y), (x, -y), (x, y), (-x, y)], np.float32)
    vertices = np.column_stack([corners, np.zeros(4, np.float32)])
    return Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.zeros(2, np.int32), None, corners)


def _cap(radius: float, z: float, side: float) -> list[tuple[float, float, float, float]]:
    """Return the profile of a half sphere about ``z``, from the south pole or to the north pole."""
    angles = np.linspace(-math.pi / 2, 0.0, _AROUND // 4 + 1) if side < 0 else np.linspace(0, math.pi / 2, 13)
    return [(radius * math.cos(a), z + radius * math.sin(a), math.cos(a), math.sin(a)) for a in angles.tolist()]


def _turned(profile: list[tuple[float, float, float, float]]) -> Mesh:
    """Return the surface that a profile of radius, height, and its normal's two parts makes about z, bottom first."""
    r, z, outward, upward = np.array(profile).T[:, :, None]
    angles = np.linspace(0.0, 2 * math.pi, _AROUND + 1)[None]
    cos, sin, even = np.cos(angles), np.sin(angles), np.ones_like(angles)
    vertices = np.stack([r * cos, r * sin, z * even], axis=2)
    normals = np.stack([outward * cos, outward * sin, upward * even], axis=2)
    triangles = _grid(len(profile), _AROUND + 1)
    corners = vertices.reshape(-1, 3)[triangles]
    real = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) > 0
    return _mesh(vertices.reshape(-1, 3), triangles[real], normals.reshape(-1, 3))


def _grid(rows: int, columns: int) -> npt.NDArray[np.int32]:
    """Return the triangles of a grid of points, facing out where columns go round counter-clockwise and rows go up."""
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    low = np.stack([first, first + 1, first + columns + 1], axis=1)
    high = np.stack([first, first + columns + 1, first + columns], axis=1)
    return np.concatenate([low, high]).astype(np.int32)


def _height_field(model: Any, field: int) -> Mesh:
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    first = int(model.hfield_adr[field])
    x, y, top, below = model.hfield_size[field].tolist()
    heights = model.hfield_data[first : first + rows * columns].reshape(rows, columns) * top
    across, along = np.meshgrid(np.linspace(-x, x, columns), np.linspace(-y, y, rows))
    vertices = np.stack([across, along, heights], axis=2).reshape(-1, 3)
    field_itself = smooth_normals(_mesh(vertices, _grid(rows, columns), None))
    # It is solid: around it are walls, down to a floor below zero.
    grid = np.arange(rows * columns).reshape(rows, columns)
    around = np.concatenate([grid[0, :-1], grid[:-1, -1], grid[-1, :0:-1], grid[:0:-1, 0]])
    low = vertices * (1.0, 1.0, 0.0) - (0.0, 0.0, below)
    after = np.roll(around, -1)
    walls = np.stack([low[around], low[after], vertices[after], vertices[around]], axis=1)
    floor = low[[[grid[0, 0], grid[-1, 0], grid[-1, -1], grid[0, -1]]]]
    sides = np.concatenate([walls, floor]).reshape(-1, 3)
    faces = (np.arange(0, len(sides), 4)[:, None] + np.array((0, 1, 2, 0, 2, 3))).reshape(-1, 3)
    return joined([field_itself, smooth_normals(_mesh(sides, faces, None))])


def _own_mesh(model: Any, mesh: int) -> Mesh:
    """Return a mesh of the model, its corners apart: positions, normals and texture coordinates are numbered apart."""

    def part(name: str, first: Any, count: Any) -> Any:
        start = int(first[mesh])
        return getattr(model, name)[start : start + int(count[mesh])]

    faces = part("mesh_face", model.mesh_faceadr, model.mesh_facenum)
    vertices = part("mesh_vert", model.mesh_vertadr, model.mesh_vertnum)[faces.ravel()]
    normals = part("mesh_normal", model.mesh_normaladr, model.mesh_normalnum)
    normals = normals[part("mesh_facenormal", model.mesh_faceadr, model.mesh_facenum).ravel()]
    uvs = None
    if model.mesh_texcoordadr[mesh] >= 0:
        uvs = part("mesh_texcoord", model.mesh_texcoordadr, model.mesh_texcoordnum)
        uvs = uvs[part("mesh_facetexcoord", model.mesh_faceadr, model.mesh_facenum).ravel()]
        uvs = uvs * (1.0, -1.0) + (0.0, 1.0)  # MuJoCo's v goes down
    return _mesh(vertices, np.arange(len(vertices)).reshape(-1, 3), normals, uvs)


def _mesh(vertices: Any, triangles: Any, normals: Any, uvs: Any = None) -> Mesh:
    if normals is not None:
        normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    return Mesh(
        np.ascontiguousarray(vertices, np.float32),
        np.ascontiguousarray(triangles, np.int32),
        np.zeros(len(triangles), np.int32),
        None if normals is None else np.ascontiguousarray(normals, np.float32),
        None if uvs is None else np.ascontiguousarray(uvs, np.float32),
    )
