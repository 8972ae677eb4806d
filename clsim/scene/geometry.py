"""Linear algebra on meshes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from clsim.errors import InputError
from clsim.scene.motion import Matrix, compose
from clsim.scene.world import Mesh

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
        a, b, c = linear[:, 0], linear[:, 1], linear[:, 2]
        cofactor = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
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
