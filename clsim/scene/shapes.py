"""Triangle meshes of the built-in shapes; u and v run in metres: a checker's squares have one size on all of them."""

from __future__ import annotations

import numpy as np

from clsim.scene.world import Mesh


def box(size: tuple[float, float, float], material: int = 0) -> Mesh:
    """Return an axis-aligned box about the origin; ``size`` along x, y, z [m]."""
    vertices: list[list[float]] = []
    uvs: list[tuple[float, float]] = []
    triangles: list[tuple[int, int, int]] = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            # u × v points outwards
            u, v = ((axis + 1) % 3, (axis + 2) % 3) if sign > 0 else ((axis + 2) % 3, (axis + 1) % 3)
            first = len(vertices)
            for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
                corner = [0.0, 0.0, 0.0]
                corner[axis], corner[u], corner[v] = sign * size[axis] / 2, (a - 0.5) * size[u], (b - 0.5) * size[v]
                vertices.append(corner)
                uvs.append((a * size[u], b * size[v]))
            triangles += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
    return _mesh(vertices, triangles, uvs, material)


def quad(size: tuple[float, float], material: int = 0) -> Mesh:
    """Return a rectangle in the xz plane about the origin, facing +y; ``size`` along x, z [m]."""
    x, z = size[0] / 2, size[1] / 2
    vertices = [(-x, 0, z), (x, 0, z), (x, 0, -z), (-x, 0, -z)]
    uvs = [(0, 0), (size[0], 0), (size[0], size[1]), (0, size[1])]
    return _mesh(vertices, [(0, 1, 2), (0, 2, 3)], uvs, material)


def sphere(radius_m: float, segments: int, material: int = 0) -> Mesh:
    """Return a sphere about the origin with smooth normals; ``segments`` round the equator."""
    rows = max(segments // 2, 2)
    theta, phi = np.meshgrid(np.linspace(0, np.pi, rows + 1), np.linspace(0, 2 * np.pi, segments + 1), indexing="ij")
    normals = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], -1).reshape(-1, 3)
    uvs = radius_m * np.stack([phi, np.pi - theta], -1).reshape(-1, 2)
    i, j = np.meshgrid(np.arange(rows), np.arange(segments), indexing="ij")
    top_left = (i * (segments + 1) + j).ravel()
    below_left = top_left + segments + 1
    upper = np.stack([top_left, below_left + 1, top_left + 1], -1)[segments:]  # none at the north pole
    lower = np.stack([top_left, below_left, below_left + 1], -1)[: segments * (rows - 1)]  # none at the south pole
    return _mesh(normals * radius_m, np.concatenate([upper, lower]), uvs, material, normals)


def _mesh(vertices: object, triangles: object, uvs: object, material: int, normals: object = None) -> Mesh:
    faces = np.ascontiguousarray(triangles, np.int32)
    return Mesh(
        vertices=np.ascontiguousarray(vertices, np.float32),
        triangles=faces,
        material_ids=np.full(len(faces), material, np.int32),
        normals=None if normals is None else np.ascontiguousarray(normals, np.float32),
        uvs=np.ascontiguousarray(uvs, np.float32),
    )
