"""The 16-wide tree, built in native code: a binary tree, improved, gathered into wide nodes, and then given its boxes.

- ``grow`` splits triangles in two, down to single ones, each time at the best of 16 planes on each axis by the surface
  area heuristic (Wald, RT 2007), where a leaf costs as much as a test of eight triangles. Where there are few
  triangles, it makes no node, and ``fit`` the blocks of a list.
- ``reinsert`` takes nodes out and puts each where the sum of all areas becomes least (Bittner, Hapala, Havran, Computer
  Graphics Forum 32(1), 2013). The largest nodes alone gain nearly all that there is to gain.
- ``widen`` opens nodes, the largest first, until there are sixteen children. Nodes come before their children, and
  leaves behind all nodes.
- ``fit`` goes through the nodes backwards, copies the corners of each leaf's triangles and unites boxes. A mesh that
  deforms can repeat this step alone.
"""

import warp as wp

from clsim.render.accel.bvh16_list import BLOCK_FLOATS, LIST_TRIANGLES, ROWS
from clsim.render.accel.bvh16_traverse import (
    CHILDREN,
    CORNER_FLOATS,
    FIRST_NUMBER,
    LEAF_TRIANGLES,
    MAX_DEPTH,
    NODE_FLOATS,
)
from clsim.render.device.compiler import kernel_options
from clsim.render.native import native_code

wp.set_module_options(kernel_options())

FARTHEST = 1.0e12
"""Vertices farther from the origin belong to no triangle: the cubes of their coordinates must be finite."""
UNIT_FLOATS = 8
"""Memory of a tree is counted in units of so many floats."""
TALLEST = 4 * MAX_DEPTH
"""Most levels of a binary tree that surely become ``MAX_DEPTH`` wide ones."""
_TALLEST_GROWN = TALLEST - 16
"""Most levels that ``grow`` makes: what is improved may grow taller."""
_OPEN = 512
"""Most nodes in the queue of the search for a place; what is beyond is not visited."""

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
    "OPEN": _OPEN,
    "ROWS": ROWS,
    "TALLEST": TALLEST,
    "TALLEST_GROWN": _TALLEST_GROWN,
    "UNIT_FLOATS": UNIT_FLOATS,
}


@wp.func_native(native_code("construct/grow.h", _SIZES))
def _grow(
    vertices: wp.array[wp.vec3],
    indices: wp.array[int],
    scratch: wp.array[float],
    nodes_of_two: wp.array[float],
    parents: wp.array[int],
    counts: wp.array[int],
) -> None: ...


@wp.func_native(native_code("construct/reinsert.h", _SIZES))
def _reinsert(
    which: wp.array[int],
    nodes_of_two: wp.array[float],
    parents: wp.array[int],
) -> None: ...


@wp.func_native(native_code("construct/wide.h", _SIZES))
def _widen(
    nodes_of_two: wp.array[float],
    node_of_two_count: int,
    scratch: wp.array[int],
    nodes: wp.array[float],
    leaves: wp.array[float],
    counts: wp.array[int],
) -> None: ...


@wp.func_native(native_code("construct/fit.h", _SIZES))
def _fit(
    vertices: wp.array[wp.vec3],
    indices: wp.array[int],
    order: wp.array[int],
    count: int,
    middle: wp.vec3,
    memory: wp.array[float],
    out_extent: wp.array[float],
) -> None: ...


@wp.kernel(enable_backward=False)
def grow(
    vertices: wp.array[wp.vec3],
    indices: wp.array[int],
    scratch: wp.array[float],
    out_nodes_of_two: wp.array[float],
    out_parents: wp.array[int],
    out_counts: wp.array[int],
) -> None:
    """Make a binary tree of 8 floats a node; ``scratch`` holds 8 floats a triangle.

    ``out_counts`` are nodes and, where these are 0, the triangles of a list, which ``out_parents`` names.
    """
    _grow(vertices, indices, scratch, out_nodes_of_two, out_parents, out_counts)


@wp.kernel(enable_backward=False)
def reinsert(which: wp.array[int], out_nodes_of_two: wp.array[float], out_parents: wp.array[int]) -> None:
    """Find better places for the nodes ``which``, one after the other."""
    _reinsert(which, out_nodes_of_two, out_parents)


@wp.kernel(enable_backward=False)
def widen(
    nodes_of_two: wp.array[float],
    count: int,
    scratch: wp.array[int],
    out_nodes: wp.array[float],
    out_leaves: wp.array[float],
    out_counts: wp.array[int],
) -> None:
    """Write the topology of wide nodes, and in leaves the numbers of triangles; ``scratch`` holds 3 integers a node.

    ``out_counts`` are nodes (0: the binary tree is taller than ``TALLEST``), units of leaves, and levels.
    """
    _widen(nodes_of_two, count, scratch, out_nodes, out_leaves, out_counts)


@wp.kernel(enable_backward=False)
def fit(
    vertices: wp.array[wp.vec3],
    indices: wp.array[int],
    order: wp.array[int],
    nodes: int,
    middle: wp.vec3,
    out_memory: wp.array[float],
    out_extent: wp.array[float],
) -> None:
    """Write boxes and corners for a known topology; ``out_extent`` is the largest coordinate, sign aside.

    Where there are no ``nodes``, the blocks of a list of triangles in that ``order``, whose edges have their
    coordinates from ``middle``.
    """
    _fit(vertices, indices, order, nodes, middle, out_memory, out_extent)
