"""Shapes and transforms; trimesh and closed formulas are the oracles."""

import math

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from clsim.errors import InputError
from clsim.scene import shapes
from clsim.scene.meshes import geometry
from clsim.scene.meshes.geometry import is_similarity, placed_rigidly, smooth_normals, transformed
from clsim.scene.motion import compose, euler_quaternion, rotation_matrix
from clsim.scene.world import Mesh

number = st.floats(-3, 3)
linear = st.lists(number, min_size=9, max_size=9).map(lambda x: np.reshape(x, (3, 3)))


def as_trimesh(mesh):
    return trimesh.Trimesh(mesh.vertices, mesh.triangles, process=True)  # welds the corners


def face_normals(mesh):
    corners = mesh.vertices[mesh.triangles].astype(float)
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def test_a_box_is_closed_and_faces_outwards():
    box = as_trimesh(shapes.box((1, 2, 3)))
    assert box.is_watertight
    assert box.volume == pytest.approx(6)
    np.testing.assert_allclose(box.bounds, [(-0.5, -1, -1.5), (0.5, 1, 1.5)])


@pytest.mark.parametrize("segments", [3, 4, 48])
def test_a_sphere_is_closed_and_its_normals_point_outwards(segments):
    mesh = shapes.sphere(2.0, segments)
    ball = as_trimesh(mesh)
    assert ball.is_watertight
    assert 0 < ball.volume <= 4 / 3 * math.pi * 8
    np.testing.assert_allclose(mesh.normals * 2, mesh.vertices, atol=1e-6)
    assert (np.linalg.norm(face_normals(mesh), axis=1) > 0).all()
    if segments == 48:
        assert ball.volume == pytest.approx(4 / 3 * math.pi * 8, rel=0.01)


def test_a_quad_faces_up():
    mesh = shapes.quad((2, 3))
    np.testing.assert_allclose(face_normals(mesh), [(0, 6, 0)] * 2)
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), (2, 0, 3))


@pytest.mark.parametrize("mesh", [shapes.box((1, 2, 3)), shapes.quad((2, 3))])
def test_u_and_v_run_in_metres_and_not_mirrored(mesh):
    for triangle in mesh.triangles:
        p, uv = mesh.vertices[triangle].astype(float), mesh.uvs[triangle].astype(float)
        for a, b in ((0, 1), (1, 2), (2, 0)):
            assert np.linalg.norm(p[a] - p[b]) == pytest.approx(np.linalg.norm(uv[a] - uv[b]))
        assert np.linalg.det([uv[1] - uv[0], uv[2] - uv[0]]) > 0


@pytest.mark.parametrize("radius_m", [0.5, 2.0])
def test_u_and_v_of_a_sphere_run_in_metres_along_equator_and_meridians(radius_m):
    """From outside a picture is not mirrored, and is upright: v grows from the south pole to the north."""
    mesh = shapes.sphere(radius_m, 64)
    places, (u, v) = mesh.vertices.astype(float), mesh.uvs.astype(float).T
    np.testing.assert_allclose(
        v, radius_m * (math.pi / 2 + np.arcsin(np.clip(places[:, 1] / radius_m, -1, 1))), atol=1e-3
    )
    assert (u.min(), u.max()) == pytest.approx((0.0, 2 * math.pi * radius_m), rel=1e-6)
    for triangle in mesh.triangles:
        corners = mesh.uvs[triangle].astype(float)
        assert np.linalg.det([corners[1] - corners[0], corners[2] - corners[0]]) > 0


@given(linear)
def test_transformed_normals_stay_perpendicular_to_their_triangles(matrix):
    """The normals of a box are those of its faces, before and after any transform that leaves it some volume."""
    if abs(np.linalg.det(matrix)) < 0.1:
        return
    box = shapes.box((1, 1, 1))
    normals = np.zeros_like(box.vertices)
    flat = face_normals(box)
    for triangle, normal in zip(box.triangles, flat, strict=True):
        normals[triangle] = normal
    moved = transformed(geometry.replace(box, normals=normals), matrix)
    flat = face_normals(moved)
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    for triangle, normal in zip(moved.triangles, flat, strict=True):
        np.testing.assert_allclose(moved.normals[triangle], np.tile(normal, (3, 1)), atol=1e-4)
    assert as_trimesh(moved).volume == pytest.approx(abs(np.linalg.det(matrix)), rel=1e-4)


def test_similarities_are_told_apart():
    turn = rotation_matrix(euler_quaternion((10, 20, 30)))
    assert is_similarity(turn)
    assert is_similarity(100 * turn)
    assert not is_similarity(turn @ np.diag((1, 1, -1)))
    assert not is_similarity(turn @ np.diag((1, 1, 1.01)))
    assert not is_similarity(np.zeros((3, 3)))
    assert not is_similarity(np.full((3, 3), np.nan))


@given(linear, st.tuples(number, number, number))
def test_placed_rigidly_keeps_every_vertex_in_place(matrix, position):
    meshes = [shapes.box((1, 2, 3))]
    index, pose = placed_rigidly(meshes, 0, compose(position, matrix))
    expected = meshes[0].vertices @ matrix.T + position
    np.testing.assert_allclose(meshes[index].vertices @ pose[:3, :3].T + pose[:3, 3], expected, atol=1e-4)
    assert is_similarity(pose[:3, :3])


def test_copies_without_end_are_refused(monkeypatch):
    monkeypatch.setattr(geometry, "MAX_BAKED_TRIANGLES", 30)
    meshes = [shapes.box((1, 1, 1))]
    placed_rigidly(meshes, 0, np.diag((1.0, 2.0, 1.0, 1.0)))
    with pytest.raises(InputError, match="30 triangles"):
        placed_rigidly(meshes, 0, np.diag((1.0, 2.0, 1.0, 1.0)))


def test_smooth_normals_weigh_faces_by_their_angles():
    """A corner of a box whose one face is split in two there: still all faces count alike."""
    vertices = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0)], np.float32)
    # Both triangles of z = 0 meet at the origin, at 45° each; x = 0 and y = 0 have one of 90° each.
    triangles = np.array([(0, 4, 1), (0, 2, 4), (0, 3, 2), (0, 1, 3)], np.int32)
    mesh = smooth_normals(Mesh(vertices, triangles, np.zeros(4, np.int32)))
    np.testing.assert_allclose(mesh.normals[0], -np.ones(3) / np.sqrt(3), atol=1e-6)


def test_a_stretch_that_keeps_the_volume_is_baked():
    mesh = shapes.box((1, 1, 1))
    meshes = [mesh]
    index, pose = placed_rigidly(meshes, 0, np.diag((2.0, 0.5, 1.0, 1.0)))
    np.testing.assert_allclose(meshes[index].vertices.max(axis=0), (1, 0.25, 0.5))
    np.testing.assert_array_equal(pose, np.eye(4))
