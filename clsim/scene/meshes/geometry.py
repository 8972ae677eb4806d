"""Linear algebra on meshes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from clsim.errors import InputError
from clsim.scene.motion import Matrix, compose
from clsim.scene.world import F32, Mesh, Vec3

MAX_BAKED_TRIANGLES = 20_000_000


def is_similarity(linear: Matrix) -> bool:
    """Tell whether a 3×3 matrix is a rotation times one positive factor: no shear, no mirror, no uneven scale."""
    gram = linear.T @ linear
    scale2 = float(np.trace(gram)) / 3
    return bool(
        np.isfinite(scale2)
        and scale2 > 0
        and np.abs(gram - scale2 * np.eye(3)).max() <= 1e-5 * scale2
        and np.linalg.det(linear) > 0
    )


def transformed(mesh: Mesh, linear: Matrix) -> Mesh:
    """Return the mesh with a 3×3 matrix applied to its vertices; a mirror also turns the triangles round."""
    triangles, normals = mesh.triangles, mesh.normals
    determinant = float(np.linalg.det(linear))
    if determinant < 0:
        triangles = np.ascontiguousarray(triangles[:, ::-1])
    if normals is not None:
        # Normals take the inverse transpose; the cofactor matrix is that times the determinant, and exists where
        # the matrix is singular.
        cofactor = np.cross(linear[:, [1, 2, 0]], linear[:, [2, 0, 1]], axis=0)
        turned = normals.astype(np.float64) @ (cofactor.T * (1.0 if determinant >= 0 else -1.0))
        turned /= np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-30)
        normals = np.ascontiguousarray(turned, np.float32)
    vertices = np.ascontiguousarray(mesh.vertices.astype(np.float64) @ linear.T, np.float32)
    return replace(mesh, vertices=vertices, triangles=triangles, normals=normals)


def placed_rigidly(meshes: list[Mesh], index: int, matrix: Matrix) -> tuple[int, Matrix]:
    """Return a mesh's index and a pose without stretch or mirror; what cannot be a pose goes into a mesh of its own.

    Args:
        meshes: all meshes so far; one is appended where the matrix stretches.
        index: the mesh to place.
        matrix: any affine 4×4 matrix.

    Raises:
        InputError: if the copies would fill the memory.
    """
    linear = matrix[:3, :3]
    if is_similarity(linear) or not np.isfinite(matrix).all():
        return index, matrix
    if sum(len(mesh.triangles) for mesh in meshes) + len(meshes[index].triangles) > MAX_BAKED_TRIANGLES:
        raise InputError(f"stretched copies of meshes have more than {MAX_BAKED_TRIANGLES} triangles in all")
    meshes.append(transformed(meshes[index], linear))
    return len(meshes) - 1, compose(matrix[:3, 3], np.eye(3))


def with_corner_uvs(mesh: Mesh, uvs: tuple[tuple[float, float], ...]) -> Mesh:
    """Return the mesh with the same three texture coordinates for each triangle, whose corners are then its own."""
    corners = mesh.triangles.ravel()
    return replace(
        mesh,
        vertices=mesh.vertices[corners],
        triangles=np.arange(len(corners), dtype=np.int32).reshape(-1, 3),
        normals=None if mesh.normals is None else mesh.normals[corners],
        uvs=np.tile(np.array(uvs, np.float32), (len(mesh.triangles), 1)),
        colors=None if mesh.colors is None else mesh.colors[corners],
    )


def facing_as_normals(mesh: Mesh) -> Mesh:
    """Return the mesh with each triangle turned round that faces away from its normals."""
    if mesh.normals is None:
        return mesh
    a, b, c = np.moveaxis(mesh.vertices.astype(np.float64)[mesh.triangles], 1, 0)
    away = np.einsum("ij,ij->i", np.cross(b - a, c - a), mesh.normals[mesh.triangles].sum(axis=1)) < 0
    return replace(mesh, triangles=np.where(away[:, None], mesh.triangles[:, ::-1], mesh.triangles))


def flipped_v(affine: Matrix) -> tuple[Vec3, Vec3]:
    """Return a 3×3 transform of texture coordinates with v down as the 2×3 one for coordinates with v up."""
    flip = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, 1.0]])
    (a, b, c), (d, e, f) = (flip @ affine @ flip)[:2].tolist()
    return (a, b, c), (d, e, f)


def smooth_normals(mesh: Mesh) -> Mesh:
    """Return the mesh with normals at its vertices: those of the faces around, weighted by their angles there.

    Source: Thürmer and Wüthrich, "Computing vertex normals from polygonal facets", JGT 1998.
    """
    corners = mesh.vertices.astype(np.float64)[mesh.triangles]
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    face /= np.maximum(np.linalg.norm(face, axis=1, keepdims=True), 1e-30)
    normals = np.zeros((len(mesh.vertices), 3))
    for k in range(3):
        a, b = corners[:, (k + 1) % 3] - corners[:, k], corners[:, (k + 2) % 3] - corners[:, k]
        lengths = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
        cosine = np.einsum("ij,ij->i", a, b) / np.maximum(lengths, 1e-30)
        np.add.at(normals, mesh.triangles[:, k], face * np.arccos(np.clip(cosine, -1.0, 1.0))[:, None])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(lengths > 1e-12, normals / np.maximum(lengths, 1e-12), (0.0, 1.0, 0.0))
    return replace(mesh, normals=np.ascontiguousarray(normals, np.float32))


def joined(meshes: list[Mesh]) -> Mesh:
    """Return several meshes as one; normals stay where all have them, and missing texture coordinates are 0."""
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    uvs = [np.zeros((len(mesh.vertices), 2), np.float32) if mesh.uvs is None else mesh.uvs for mesh in meshes]
    normals = [mesh.normals for mesh in meshes if mesh.normals is not None]
    colored = any(mesh.colors is not None for mesh in meshes)
    return Mesh(
        vertices=np.concatenate([mesh.vertices for mesh in meshes]),
        triangles=np.concatenate([m.triangles + np.int32(start) for m, start in zip(meshes, first, strict=False)]),
        material_ids=np.concatenate([mesh.material_ids for mesh in meshes]),
        normals=np.concatenate(normals) if len(normals) == len(meshes) else None,
        uvs=np.concatenate(uvs) if any(mesh.uvs is not None for mesh in meshes) else None,
        colors=np.concatenate([colors_of(mesh) for mesh in meshes]) if colored else None,
    )


def colors_of(mesh: Mesh) -> F32:
    """Return the colours of a mesh's vertices ``[n, 3]``; white where it has none."""
    return np.ones((len(mesh.vertices), 3), np.float32) if mesh.colors is None else mesh.colors
