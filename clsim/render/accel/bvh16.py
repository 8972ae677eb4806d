"""A 16-wide bounding volume hierarchy of triangles for rays on a CPU.

``bvh16_build`` makes it, ``bvh16_traverse`` searches it; here is its memory.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.errors import InputError
from clsim.render.accel.bvh16_build import FARTHEST, UNIT_FLOATS, fit, grow, reinsert, widen
from clsim.render.accel.bvh16_list import BLOCK_FLOATS, LIST_TRIANGLES
from clsim.render.accel.bvh16_traverse import CORNER_FLOATS, NODE_FLOATS
from clsim.render.device.large_pages import spread

_ROUNDS = 4
"""How many times the largest nodes of the binary tree are taken out and put where they are best …"""
_LARGEST = 50
"""… which are one in so many. All of them would take fifty times as long, and rays gain no more."""
_BEHIND = 32
"""Floats behind the last leaf: one without extent, and room, for a leaf is read eight wide, however many it has."""
_MOST_UNITS = 1 << 28
"""What 32 bits of a child can tell."""
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
        self,
        vertices: Any,
        indices: Any,
        may_pass: npt.NDArray[np.bool_] | None = None,
        rows: Any = None,
        *,
        lasts: bool = True,
    ) -> None:
        """Build the tree of triangles ``indices`` (int32, [3n]) over ``vertices`` (vec3), both on the CPU.

        The arrays are read, and ``indices`` is kept for ``refit``. ``may_pass`` ``[n]`` says which triangles may let
        rays pass, for ``any_opaque_in_tree``; without it, none. Of ``rows`` ``[n]``, an array of Warp's, the one of a
        triangle that is hit is on its way from memory while the search goes on. One that does not last is built faster,
        and searched more slowly.
        """
        self._indices = indices
        self._extent = np.zeros(1, np.float32)
        self._order, nodes_of_two, parents = self._grow(vertices)
        self._blocks, self._count, self.levels = len(self._order) // 8, 0, 0
        if self._blocks:
            self._memory = spread(BLOCK_FLOATS * self._blocks, np.float32)
        else:
            triangles = len(indices) // 3
            if lasts:
                _improve(nodes_of_two, parents)
            self.levels, nodes, leaves = _widen(nodes_of_two, triangles)
            if not self.levels:  # improved too far, which takes a mesh made for it
                self.levels, nodes, leaves = _widen(self._grow(vertices)[1], triangles)
            del nodes_of_two, parents
            self._count, self._memory = len(nodes) // NODE_FLOATS, _join(nodes, leaves)
        # Memory, extent, blocks, three floats: from where the coordinates of a list's edges count, what may let rays
        # pass, rows and the bytes of one.
        self._header = np.zeros(8, np.uint64)
        self._header[[0, 2]] = self._memory.ctypes.data, self._blocks
        if may_pass is not None and may_pass.any():
            self._may_pass = may_pass.copy()
            self._header[5] = self._may_pass.ctypes.data
        if rows is not None:
            self._rows = rows
            self._header[6:8] = rows.ptr, rows.strides[0]
        self.id = int(self._header.ctypes.data)
        self.refit(vertices)

    def _grow(self, vertices: Any) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float32], npt.NDArray[np.int32]]:
        """Return the order of a list (without entries: a tree), and the nodes of a binary tree and their parents."""
        triangles = len(self._indices) // 3
        # Untouched pages cost nothing: the arrays are made for the worst case.
        scratch = spread(8 * triangles, np.float32)
        nodes_of_two = spread(8 * (2 * triangles + 1), np.float32)
        parents = np.empty(2 * triangles + LIST_TRIANGLES, np.int32)
        counts = np.zeros(2, np.int32)
        outputs = [_wrap(a) for a in (nodes_of_two, parents, counts)]
        wp.launch(grow, dim=1, inputs=[vertices, self._indices, _wrap(scratch)], outputs=outputs, device="cpu")
        nodes, listed = (int(n) for n in counts)
        return parents[: 0 if nodes else listed].copy(), nodes_of_two[: 8 * nodes], parents[:nodes]

    @property
    def nbytes(self) -> int:
        """Bytes of nodes, corners and triangle numbers."""
        return int(self._memory.nbytes + self._order.nbytes)

    def refit(self, vertices: Any) -> None:
        """Take new positions of the same vertices; the topology stays, so that large deformations make rays slow."""
        middle = _middle(vertices.numpy()[self._indices.numpy()]) if self._blocks else np.zeros(3, np.float32)
        self._header[3:5].view(np.float32)[:3] = middle
        wp.launch(
            fit,
            dim=1,
            inputs=[vertices, self._indices, _wrap(self._order), self._count, wp.vec3(*middle)],
            outputs=[_wrap(self._memory), _wrap(self._extent)],
            device="cpu",
        )
        self._header[1:2].view(np.float32)[0] = self._extent[0]


def _improve(nodes_of_two: npt.NDArray[np.float32], parents: npt.NDArray[np.int32]) -> None:
    """Put the largest nodes of a binary tree where they are best."""
    boxes = nodes_of_two.reshape(-1, 8)
    for _ in range(_ROUNDS):
        x, y, z = (boxes[:, 4 + k] - boxes[:, k] for k in range(3))
        areas = x * y + y * z + z * x
        most = -(-len(areas) // _LARGEST)
        large = np.flatnonzero(areas >= np.partition(areas, -most)[-most])
        which = large[np.argsort(-areas[large], kind="stable")].astype(np.int32)
        outputs = [_wrap(nodes_of_two), _wrap(parents)]
        wp.launch(reinsert, dim=1, inputs=[_wrap(which)], outputs=outputs, device="cpu")


def _widen(
    nodes_of_two: npt.NDArray[np.float32], triangles: int
) -> tuple[int, npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Return the levels of the wide tree that a binary one becomes, its nodes without boxes, leaves without corners.

    There are no levels where the binary tree is too tall.
    """
    nodes = spread(NODE_FLOATS * (triangles // 2 + 1), np.float32)
    leaves = spread((CORNER_FLOATS + UNIT_FLOATS) * triangles, np.float32)
    scratch = np.empty(3 * (len(nodes_of_two) // 8), np.int32)
    counts = np.zeros(3, np.int32)
    inputs = [_wrap(nodes_of_two), len(nodes_of_two) // 8, _wrap(scratch)]
    wp.launch(widen, dim=1, inputs=inputs, outputs=[_wrap(a) for a in (nodes, leaves, counts)], device="cpu")
    count, units, levels = (int(n) for n in counts)
    if NODE_FLOATS // UNIT_FLOATS * count + units + _BEHIND >= _MOST_UNITS:
        raise InputError(f"a mesh of {triangles:,} triangles is too large: its tree must take less than 8 GiB; part it")
    return levels if count else 0, nodes[: NODE_FLOATS * count], leaves[: UNIT_FLOATS * units]


def _join(nodes: npt.NDArray[np.float32], leaves: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return the memory of a tree, in which leaves come behind the nodes."""
    memory = spread(len(nodes) + len(leaves) + _BEHIND, np.float32)
    memory[: len(nodes)] = nodes
    memory[len(nodes) : -_BEHIND] = leaves
    memory[-_BEHIND:] = 0.0
    return memory


def _middle(corners: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return the middle of what is far from the origin relative to its own size, else the origin."""
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
