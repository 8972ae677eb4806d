"""Meshes of few triangles: no tree, but a list whose triangles are all tested, eight at once, without a branch.

The edge functions are the products of the Plücker coordinates of the ray and of the edges (Jones, Ray Tracing News
13(1), 2000), the latter made beforehand. Those of an edge that two triangles share differ in sign alone, to the last
bit, and so do their products, and 0 counts for both: no ray slips between the two. Where more than two triangles meet,
roundings may disagree: of rays aimed right at a vertex, some in ten thousand pass.

A block is eight triangles: a row of eight for each of the numbers below.
"""

LIST_TRIANGLES = 64
"""The most triangles of a list. In boxes within a box, rays that bounce are as fast in a tree from 100 on, and those of
the camera from 50 on."""
ROWS = 36
"""Three vertices (9), the triangle's number, edge and moment of the edges opposite to the vertices (18), the normal
times twice the area (3) and its product with a vertex, the unit normal (3), and the largest coordinate."""
BLOCK_FLOATS = 8 * ROWS
