"""How the 16-wide tree is built: the binary tree, its improvement, and what is gathered from it."""

from __future__ import annotations

import numpy as np
import pytest

from clsim.render.accel import bvh16
from clsim.render.accel.bvh16 import Bvh16
from clsim.render.accel.bvh16_build import TALLEST
from clsim.render.accel.bvh16_traverse import MAX_DEPTH
from tests.render.accel.test_bvh16 import arrays, directions, shoot


def slivers(surfaces, n=30):
    """Vertices of things of n small triangles each, and of as many long thin ones, which planes sort badly."""
    rng = np.random.default_rng(3)
    centres = rng.uniform(-1, 1, (surfaces, 1, 1, 3))
    small = centres + rng.normal(scale=0.03, size=(surfaces, n, 3, 3))
    ends = rng.uniform(-1, 1, (surfaces, 2, 3))
    long = np.concatenate([ends, ends[:, 1:] + 0.01 * rng.normal(size=(surfaces, 1, 3))], axis=1)
    return np.concatenate([small.reshape(-1, 3), long.reshape(-1, 3)])


def binary_tree(nodes):
    """First children, triangles of leaves, and boxes of a binary tree of 8 floats a node."""
    nodes = nodes.reshape(-1, 8)
    bits = nodes.view(np.int32)
    return bits[:, 3], np.where(bits[:, 3] == 0, bits[:, 7], -1), nodes[:, :3], nodes[:, 4:7]


def areas(lower, upper):
    x, y, z = (upper - lower).T
    return x * y + y * z + z * x


def test_reinsertion_keeps_a_tree_whole_and_its_boxes_smaller():
    """Each triangle is a leaf once, each node is its children's parent and its box theirs; areas sum up to less."""
    vertices = slivers(100)
    tree = Bvh16(*arrays(vertices, np.arange(len(vertices))))
    _, nodes, parents = tree._grow(arrays(vertices, [])[0])
    first, _, *boxes = binary_tree(nodes)
    before = areas(*boxes)[first > 0].sum()
    bvh16._improve(nodes, parents)
    first, triangles, lower, upper = binary_tree(nodes)
    inner = np.flatnonzero(first)
    children = np.stack([first[inner], first[inner] + 1], axis=1)
    assert sorted(children.ravel()) == list(range(1, len(first)))
    np.testing.assert_array_equal(parents[children], np.repeat(inner[:, None], 2, axis=1))
    assert sorted(triangles[first == 0]) == list(range(len(vertices) // 3))
    np.testing.assert_array_equal(lower[inner], lower[children].min(axis=1))
    np.testing.assert_array_equal(upper[inner], upper[children].max(axis=1))
    reached = 1
    below = [0]
    while below:
        node = below.pop()
        if first[node]:
            below += [first[node], first[node] + 1]
            reached += 2
    assert reached == len(first)
    assert areas(lower, upper)[inner].sum() < 0.95 * before


def chain(count):
    """A binary tree of so many triangles, as tall as can be: each inner node has a leaf for its second child."""
    nodes = np.zeros((2 * count - 1, 8), np.float32)
    bits = nodes.view(np.int32)
    for k in range(count - 1):
        at = 0 if k == 0 else 2 * k - 1
        bits[at, 3] = 2 * k + 1
        bits[2 * k + 2, 7] = k
    bits[-2, 7] = count - 1
    nodes[:, 4:7] = 1.0
    return nodes.ravel()


@pytest.mark.parametrize(("taller", "levels"), [(-1, MAX_DEPTH), (0, MAX_DEPTH), (1, 0)])
def test_a_tall_tree_becomes_one_of_few_levels_or_none(taller, levels):
    told, nodes, _ = bvh16._widen(chain(TALLEST + 1 + taller), TALLEST + 1 + taller)
    assert (len(nodes) > 0) == (told > 0) == (levels > 0)
    assert told <= levels


def test_what_improving_spoils_is_built_without(monkeypatch):
    """Rays find what they find in a tree that was improved."""
    vertices = slivers(7)
    mesh = arrays(vertices, np.arange(len(vertices)))
    toward = directions(np.random.default_rng(5), 500)
    expected = shoot(Bvh16(*mesh), np.zeros(3), toward)

    def spoil(nodes, parents):
        nodes[:] = chain(len(vertices) // 3)

    monkeypatch.setattr(bvh16, "_improve", spoil)
    tree = Bvh16(*mesh)
    assert 0 < tree.levels <= MAX_DEPTH
    for found, known in zip(shoot(tree, np.zeros(3), toward), expected, strict=True):
        np.testing.assert_array_equal(found, known)
