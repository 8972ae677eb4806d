"""Meshes whose vertices move: skins and morph targets, evaluated for each frame.

A deforming mesh is searched by a tree of its own, which is rebuilt for each frame: that costs half a microsecond a
triangle, and a tree that is only refitted serves rays badly after large motion.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.scene import Mesh

F32 = npt.NDArray[np.float32]


def deforms(mesh: Mesh) -> bool:
    """Whether the mesh changes its shape with time."""
    return mesh.deformation is not None and mesh.deformation.duration_s > 0


def shaped(mesh: Mesh, time_s: float) -> Mesh:
    """Return the mesh as its deformation leaves it at a time."""
    if mesh.deformation is None:
        return mesh
    vertices, normals = mesh.deformation.vertices_at(time_s)
    return replace(mesh, vertices=vertices, normals=normals)


def box(mesh: Mesh) -> npt.NDArray[np.float64]:
    """Return the least and the greatest coordinates of the vertices, ``[2, 3]``."""
    return np.array((mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)), np.float64)


def flat_or_smooth(mesh: Mesh) -> F32:
    """Return normals ``[n, 3]``; 0 means flat shading."""
    return np.zeros_like(mesh.vertices) if mesh.normals is None else mesh.normals


class DeformingMesh:
    """The part of the device's arrays that holds a deforming mesh.

    Attributes:
        tree: what rays search.
    """

    def __init__(self, mesh: Mesh, search: Any, vertices: Any, indices: Any, normals: Any | None, tree: Any) -> None:
        """Keep the arrays, which are views, and the first tree; ``search(vertices, indices)`` builds others."""
        self._mesh, self._search = mesh, search
        self._vertices, self._indices, self._normals = vertices, indices, normals
        self.tree = tree

    def update(self, time_s: float) -> npt.NDArray[np.float64]:
        """Give the arrays the shape at that time, rebuild the tree and return the mesh's box."""
        mesh = shaped(self._mesh, time_s)
        self._vertices.assign(mesh.vertices)
        if self._normals is not None:
            self._normals.assign(flat_or_smooth(mesh))
        self.tree = self._search(self._vertices, self._indices)
        return box(mesh)
