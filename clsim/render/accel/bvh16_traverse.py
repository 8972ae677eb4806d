"""Rays against a 16-wide tree on a CPU: the nearest hit and any hit, as Warp functions in native code.

A node's sixteen boxes are tested at once with the compiler's vector types, and so are the triangles of a leaf, up to
eight. ``clsim.render.accel.bvh16`` has the tree, and ``bvh16_list`` what is searched in place of a small one.

No ray slips between triangles that share an edge. The edge functions are those of Woop, Benthin, Wald (JCGT 2(1),
2013): equal vertices are translated and sheared to equal numbers, the two products of an edge function are rounded on
their own (no fused multiply-add), so that the two sides of an edge get values that differ in sign alone, and 0 counts
for both. Boxes are tested with a slack that is a bound on all roundings, of the box test and of the triangle test: each
is at most 2^-24 of the largest coordinate, and there are fewer than 16 of them (the bound takes the place of the factor
1 + 2γ of Ize, JCGT 2(2), 2013, and allows the fused form of the slab test). Close to where a
ray begins, roundings may put a thin triangle on the wrong side of its origin; there planes in double precision decide.

Results are bits in integers: the code around is compiled as if there were no NaN, and an index may look like one.
"""

import warp as wp

from clsim.render.accel.bvh16_list import BLOCK_FLOATS
from clsim.render.native import native_code

MAX_DEPTH = 20
"""Most nodes on a way from the root to a leaf, both ends included; the builder keeps to it (see ``bvh16``)."""
CHILDREN = 16
"""Of a node. With sixteen instead of eight, rays in rooms visit a quarter to a third fewer nodes."""
NODE_FLOATS = 7 * CHILDREN
"""A node: lower x, y, z and upper x, y, z of its children's boxes, then its children."""
LEAF_TRIANGLES = 8
CORNER_FLOATS = 10
"""A triangle in its leaf: three corners and its number. A leaf has a row of each for all its triangles."""
FIRST_NUMBER = 0x3F000000
"""Added to a triangle's number, so that as a float, which reading a row too wide makes it, it is an ordinary one."""

_SIZES = {
    "CHILDREN": CHILDREN,
    "NODE_FLOATS": NODE_FLOATS,
    "STACK": (CHILDREN - 1) * MAX_DEPTH + 1,
    "BLOCK_FLOATS": BLOCK_FLOATS,
    "CORNER_FLOATS": CORNER_FLOATS,
    "FIRST_NUMBER": FIRST_NUMBER,
}

TreeHit = wp.types.vector(length=17, dtype=wp.int32)


@wp.func_native(native_code("search/tree_closest.h", _SIZES))
def closest_in_tree(handle: wp.uint64, origin: wp.vec3, direction: wp.vec3, t_min: float, far: float) -> TreeHit:
    """Return triangle (−1: none) and bits: of t, the weights of vertices 0 and 1, the vertices, the unit
    normal and the largest coordinate of the vertices.

    t is in [t_min, far), and t_min is not negative. The vertices are at hand here, and far away in memory for whoever
    needs them next.
    """
    ...


@wp.func_native(native_code("search/tree_any.h", _SIZES | {"MAY_PASS": 0}))
def any_in_tree(  # type: ignore[empty-body]
    handle: wp.uint64, origin: wp.vec3, direction: wp.vec3, t_min: float, far: float
) -> bool:
    """Return whether the ray meets a triangle at a t in [t_min, far]."""
    ...


@wp.func_native(native_code("search/tree_any.h", _SIZES | {"MAY_PASS": 1}))
def any_opaque_in_tree(  # type: ignore[empty-body]
    handle: wp.uint64, origin: wp.vec3, direction: wp.vec3, t_min: float, far: float
) -> int:
    """Return 1 where the ray meets a triangle that stops it, 2 where all that it meets may let it pass, else 0."""
    ...
