"""The 16-wide tree: its topology by binned SAH, its boxes bottom-up, in native code.

Two steps, so that a mesh that deforms repeats the second alone. ``grow`` splits the triangles of a node until it has
sixteen children: always the largest range by area, at the best of 16 planes on each axis by the surface area heuristic
(Wald, RT 2007), where a leaf costs as much as a test of eight triangles. It leaves the triangles in the order of the
leaves, and children behind their parents. ``fit`` goes through the nodes backwards, copies the corners of each leaf's
triangles and unites boxes. Where there are few triangles, ``grow`` makes no node, and ``fit`` the blocks of a list.
"""

import warp as wp

from clsim.render.bvh16_list import BLOCK_FLOATS, LIST_TRIANGLES, ROWS
from clsim.render.bvh16_traverse import (
    CHILDREN,
    CORNER_FLOATS,
    FIRST_NUMBER,
    LEAF_TRIANGLES,
    MAX_DEPTH,
    NODE_FLOATS,
)
from clsim.render.native import native_code

FARTHEST = 1.0e12
"""Vertices farther from the origin belong to no triangle: the cubes of their coordinates must be finite."""

_SIZES = {
    "BLOCK_FLOATS": BLOCK_FLOATS,
    "CHILDREN": CHILDREN,
    "CORNER_FLOATS": CORNER_FLOATS,
    "FARTHEST": FARTHEST,
    "FIRST_NUMBER": FIRST_NUMBER,
    "LEAF_TRIANGLES": LEAF_TRIANGLES,
    "LIST_TRIANGLES": LIST_TRIANGLES,
    "MAX_DEPTH": MAX_DEPTH,
    "NODE_FLOATS": NODE_FLOATS,
    "ROWS": ROWS,
}


@wp.func_native(native_code("build_grow.h", _SIZES))
def _grow(
    vertices: wp.array(dtype=wp.vec3),
    indices: wp.array(dtype=int),
    scratch: wp.array(dtype=float),
    nodes: wp.array(dtype=float),
    order: wp.array(dtype=int),
    counts: wp.array(dtype=int),
): ...


@wp.func_native(native_code("build_fit.h", _SIZES))
def _fit(
    vertices: wp.array(dtype=wp.vec3),
    indices: wp.array(dtype=int),
    order: wp.array(dtype=int),
    count: int,
    middle: wp.vec3,
    nodes: wp.array(dtype=float),
    corners: wp.array(dtype=float),
    out_extent: wp.array(dtype=float),
): ...


@wp.kernel(module="clsim_bvh16_build", enable_backward=False)
def grow(
    vertices: wp.array(dtype=wp.vec3),
    indices: wp.array(dtype=int),
    scratch: wp.array(dtype=float),
    out_nodes: wp.array(dtype=float),
    out_order: wp.array(dtype=int),
    out_counts: wp.array(dtype=int),
):
    """Find the topology; ``out_counts`` are nodes (0: a list), triangles, levels; ``scratch`` holds 8 floats each."""
    _grow(vertices, indices, scratch, out_nodes, out_order, out_counts)


@wp.kernel(module="clsim_bvh16_build", enable_backward=False)
def fit(
    vertices: wp.array(dtype=wp.vec3),
    indices: wp.array(dtype=int),
    order: wp.array(dtype=int),
    nodes: int,
    middle: wp.vec3,
    out_nodes: wp.array(dtype=float),
    out_corners: wp.array(dtype=float),
    out_extent: wp.array(dtype=float),
):
    """Write boxes and corners for a known topology; ``out_extent`` is the largest coordinate, sign aside.

    Edges of a list have their coordinates from ``middle``.
    """
    _fit(vertices, indices, order, nodes, middle, out_nodes, out_corners, out_extent)
