"""A 16-wide bounding volume hierarchy of triangles for rays on a CPU.

``bvh16_build`` makes it, ``bvh16_traverse`` searches it; here is its memory.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.render.bvh16_build import FARTHEST, fit, grow
from clsim.render.bvh16_list import BLOCK_FLOATS
from clsim.render.bvh16_traverse import CORNER_FLOATS, NODE_FLOATS
from clsim.render.large_pages import spread

_FAR_OFF = 4.0
"""A list farther from the origin than so many times its size has coordinates from its middle."""


class Bvh16:
    """The tree over the triangles of a mesh.

    Triangles with a vertex that is not finite or farther than 1e12 from the origin, and those without area, are never
    hit.

    Attributes:
        id: what ``closest_in_tree`` and ``any_in_tree`` take; valid as long as this object lives.
        levels: the most nodes on a way from the root to a leaf; 0 where the triangles are so few that they are a list.
        nbytes: memory of nodes and triangles.
    """

    def __init__(
        self, vertices: Any, indices: Any, may_pass: npt.NDArray[np.bool_] | None = None, rows: Any = None
    ) -> None:
        """Build the tree of triangles ``indices`` (int32, [3n]) over ``vertices`` (vec3), both on the CPU.

        The arrays are read, and ``indices`` is kept for ``refit``. ``may_pass`` ``[n]`` says which triangles may let
        rays pass, for ``any_opaque_in_tree``; without it, none. Of ``rows`` ``[n]``, an array of Warp's, the one of a
        triangle that is hit is on its way from memory while the search goes on.
        """
        triangles = len(indices) // 3
        self._indices = indices
        # Untouched pages cost nothing: the arrays are made for the worst case and then cut.
        scratch = spread(8 * triangles, np.float32)
        nodes = spread(NODE_FLOATS * (triangles // 2 + 1), np.float32)
        order = np.empty(triangles + 8, np.int32)
        counts = np.zeros(3, np.int32)
        arrays = [_wrap(a) for a in (scratch, nodes, order, counts)]
        wp.launch(grow, dim=1, inputs=[vertices, indices, arrays[0]], outputs=arrays[1:], device="cpu")
        node_count, triangle_count, self.levels = (int(n) for n in counts)
        del scratch, arrays
        self._nodes = spread(NODE_FLOATS * node_count, np.float32)
        self._nodes[:] = nodes[: NODE_FLOATS * node_count]
        del nodes
        self._order = order[:triangle_count].copy()
        del order
        blocks = 0 if node_count else triangle_count // 8
        if blocks:
            self._corners = spread(BLOCK_FLOATS * blocks, np.float32)
        else:
            # Behind the last triangle there is one without extent, and a leaf is read eight wide, however many it has.
            self._corners = spread(CORNER_FLOATS * (triangle_count + 1) + 8, np.float32)
            self._corners[CORNER_FLOATS * triangle_count :] = 0.0
        self._extent = np.zeros(1, np.float32)
        # Nodes, corners, extent, blocks, three floats: from where the coordinates of a list's edges count, what may let
        # rays pass, rows and the bytes of one.
        self._header = np.zeros(9, np.uint64)
        self._header[[0, 1, 3]] = self._nodes.ctypes.data, self._corners.ctypes.data, blocks
        if may_pass is not None and may_pass.any():
            self._may_pass = may_pass.copy()
            self._header[6] = self._may_pass.ctypes.data
        if rows is not None:
            self._rows = rows
            self._header[7:9] = rows.ptr, rows.strides[0]
        self._blocks = blocks
        self.id = int(self._header.ctypes.data)
        self.refit(vertices)

    @property
    def nbytes(self) -> int:
        """Bytes of nodes, corners and triangle numbers."""
        return sum(int(array.nbytes) for array in (self._nodes, self._corners, self._order))

    def refit(self, vertices: Any) -> None:
        """Take new positions of the same vertices; the topology stays, so that large deformations make rays slow."""
        middle = _middle(vertices.numpy()[self._indices.numpy()]) if self._blocks else np.zeros(3, np.float32)
        self._header[4:6].view(np.float32)[:3] = middle
        wp.launch(
            fit,
            dim=1,
            inputs=[vertices, self._indices, _wrap(self._order), len(self._nodes) // NODE_FLOATS, wp.vec3(*middle)],
            outputs=[_wrap(a) for a in (self._nodes, self._corners, self._extent)],
            device="cpu",
        )
        self._header[2:3].view(np.float32)[0] = self._extent[0]


def _middle(corners: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return the middle of what is far from the origin beside its own size, else the origin."""
    usable = corners[(np.abs(corners) <= FARTHEST).all(axis=1)].astype(np.float64)
    if not len(usable):
        return np.zeros(3, np.float32)
    low, high = usable.min(axis=0), usable.max(axis=0)
    far = np.abs(low + high).max() > 2 * _FAR_OFF * (high - low).max()
    return ((low + high) / 2 if far else np.zeros(3)).astype(np.float32)


def _wrap(values: npt.NDArray[np.float32] | npt.NDArray[np.int32]) -> Any:
    """Return the same memory as a Warp array."""
    dtype = wp.int32 if values.dtype == np.int32 else wp.float32
    return wp.array(ptr=values.ctypes.data, shape=values.shape, dtype=dtype, device="cpu")
