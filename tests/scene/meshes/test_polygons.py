"""Polygons as triangles."""

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clsim.scene.meshes.polygons import cut_anew, triangulated


def areas(points, indices, corners):
    a, b, c = (points[indices[corners[:, k]]] for k in range(3))
    return np.cross(b - a, c - a) / 2


def test_convex_polygons_are_fans_and_points_and_lines_vanish():
    points = np.zeros((8, 3))
    points[:4, :2] = [(0, 0), (1, 0), (1, 1), (0, 1)]
    corners, faces = triangulated(points, np.array([2, 4, 1, 3]), np.array([0, 1, 0, 1, 2, 3, 0, 0, 1, 2]))
    assert corners.tolist() == [[2, 3, 4], [2, 4, 5], [7, 8, 9]]
    assert faces.tolist() == [1, 1, 3]


def test_concave_polygons_among_others_are_cut_by_themselves():
    points = np.zeros((4, 3))
    points[:, :2] = [(2, 0), (0.5, 0.5), (0, 2), (0, 0)]  # a dart of area 1, concave at its second corner
    dart, counts = [2, 3, 0, 1], np.array([3, 4, 2, 4, 3, 4])
    indices = np.array([0, 2, 3, *dart, 0, 1, *dart, 0, 2, 3, *dart])
    corners, faces = triangulated(points, counts, indices)
    found = areas(points, indices, corners)[:, 2]
    assert faces.tolist() == [0, 1, 1, 3, 3, 4, 5, 5]
    assert (found > 0).all()
    assert [found[faces == face].sum() for face in (0, 1, 3, 4, 5)] == pytest.approx([2, 1, 1, 2, 1])


@given(
    st.lists(st.floats(0.2, 3.0), min_size=4, max_size=12),
    st.sampled_from([(0, 1, 2), (1, 2, 0), (2, 0, 1), (1, 0, 2)]),
)
def test_stars_of_any_form_keep_their_area_and_their_turn(radii, axes):
    angles = 2 * np.pi * np.arange(len(radii)) / len(radii)
    flat = np.stack([radii * np.cos(angles), radii * np.sin(angles), np.full(len(radii), 0.3)], axis=1)
    points = flat[:, axes]
    corners, _ = triangulated(points, np.array([len(radii)]), np.arange(len(radii)))
    found = areas(points, np.arange(len(radii)), corners)
    whole = areas(
        points - 0.0,
        np.arange(len(radii)),
        np.stack([np.zeros(len(radii), int), np.arange(len(radii)), np.roll(np.arange(len(radii)), -1)], 1),
    ).sum(axis=0)
    normal = whole / np.linalg.norm(whole)
    # No triangle is turned the other way: then the areas that add up to the polygon's do not overlap.
    assert (found @ normal >= -1e-9).all()
    assert np.isclose((found @ normal).sum(), np.linalg.norm(whole))
    assert len(corners) == len(radii) - 2


def test_an_outline_that_crosses_itself_is_cut_within_a_moment():
    """It has as many triangles as any other; by all ears that there may be it would take minutes."""
    points = np.random.default_rng(0).uniform(0, 1, (2000, 3))
    begun_s = time.process_time()
    corners, _ = triangulated(points, np.array([2000]), np.arange(2000))
    assert time.process_time() - begun_s < 20
    assert len(corners) == 1998 and np.unique(corners).tolist() == list(range(2000))


@pytest.mark.parametrize("size", [6, 30, 1024])
def test_a_star_is_cut_within_its_outline_and_told_as_no_fan(size):
    angles = 2 * np.pi * np.arange(size) / size
    radii = np.where(np.arange(size) % 2, 0.3, 1.0)
    star = np.stack([radii * np.cos(angles), radii * np.sin(angles), np.zeros(size)], axis=1)
    points, counts = np.concatenate([star, [(0, 0, 1), (1, 0, 1), (1, 1, 1)]]), np.array([3, size, 3])
    indices = np.array([size, size + 1, size + 2, *range(size), size, size + 1, size + 2])
    triangles, faces = triangulated(points, counts, indices)
    found = areas(points, indices, triangles[faces == 1])[:, 2]
    assert (found >= 0).all()
    assert found.sum() == pytest.approx(0.5 * size * 0.3 * np.sin(2 * np.pi / size), rel=1e-9)
    [(face, cut)] = list(cut_anew(triangles, faces, counts))
    assert face == 1 and (np.array(cut) + 3 == triangles[faces == 1]).all()
