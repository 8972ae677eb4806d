"""Triangles and normals of meshes that are turned, stretched and mirrored."""

from __future__ import annotations

import numpy as np
import pytest

from clsim.scene.meshes.geometry import facing_as_normals, transformed
from clsim.scene.shapes import sphere
from clsim.scene.world import Mesh


@pytest.mark.parametrize("mirrored", [-1.0, 1.0])
@pytest.mark.parametrize("sheared", [False, True])
def test_a_ball_is_seen_from_outside_however_it_is_stretched_and_mirrored(mirrored: float, sheared: bool) -> None:
    """Its normals, and those of its triangles, lead away from its middle, at right angles to the surface."""
    linear = np.diag([2.0 * mirrored, 0.5, 1.0])
    linear[0, 1] = 0.7 if sheared else 0.0
    ball = transformed(sphere(1.0, 24), linear)
    assert ball.normals is not None
    a, b, c = np.moveaxis(ball.vertices.astype(float)[ball.triangles], 1, 0)
    faces = np.cross(b - a, c - a)
    wide = np.linalg.norm(faces, axis=1) > 1e-6
    assert ((faces * (a + b + c)).sum(axis=1)[wide] > 0).all()
    # An ellipsoid |M⁻¹ x| = 1 has the normal M⁻ᵀ M⁻¹ x.
    back = np.linalg.inv(linear)
    expected = ball.vertices @ (back.T @ back).T
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(ball.normals, expected, atol=1e-5)


def test_a_triangle_faces_where_its_three_normals_lead_in_all() -> None:
    """One of them leads behind it, as at a sharp edge that is smoothed: it stays; where all do, it is turned round."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    normals = np.array([[0, 0.6, -0.8], [0, 0, 1], [0, 0, 1]], np.float32)
    mesh = Mesh(corners, np.array([[0, 1, 2]], np.int32), np.zeros(1, np.int32), normals)
    assert facing_as_normals(mesh).triangles.tolist() == [[0, 1, 2]]
    behind = Mesh(corners, mesh.triangles, mesh.material_ids, -normals)
    assert facing_as_normals(behind).triangles.tolist() == [[2, 1, 0]]
