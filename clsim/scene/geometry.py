"""Linear algebra on meshes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from clsim.scene.motion import Matrix
from clsim.scene.world import Mesh


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
