"""glTF animation: channels, the tree of nodes at a time, and the motions and deformations that follow from it.

glTF 2.0, sections 3.5, 3.7.3 and 3.11, and its appendix C for the interpolations.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from clsim.scene.motion import Matrix, slerp_rows
from clsim.scene.world import F32, I32

F64 = npt.NDArray[np.float64]
Property = Literal[
    "translation",
    "rotation",
    "scale",
    "weights",
    "lamp color",
    "lamp intensity",
    "emissive factor",
    "emissive strength",
]


@dataclass(frozen=True)
class Channel:
    """Keyframes of one property of one node, lamp or material.

    Attributes:
        node: the number of that whose property it is.
        path: which property.
        times_s: float64 ``[k]``, increasing [s].
        values: float64 ``[k, n]``; for CUBICSPLINE ``[k, 3, n]``: in-tangent, value, out-tangent.
        interpolation: as in the file.
    """

    node: int
    path: Property
    times_s: F64
    values: F64
    interpolation: Literal["LINEAR", "STEP", "CUBICSPLINE"]

    def at(self, time_s: float) -> F64:
        """Return the value ``[n]`` at a time, or those ``[m, n]`` of m nodes; the first and the last are held."""
        cubic = self.interpolation == "CUBICSPLINE"
        keys = self.values[:, 1] if cubic else self.values
        j = int(np.searchsorted(self.times_s, time_s, side="right"))
        held: F64 = keys[max(j - 1, 0)]
        if j == 0 or j == len(self.times_s) or self.interpolation == "STEP":
            return held
        gap = float(self.times_s[j] - self.times_s[j - 1])
        s = (time_s - float(self.times_s[j - 1])) / gap
        if cubic:
            s2, s3 = s * s, s * s * s
            value: F64 = (
                (2 * s3 - 3 * s2 + 1) * keys[j - 1]
                + (s3 - 2 * s2 + s) * gap * self.values[j - 1, 2]
                + (3 * s2 - 2 * s3) * keys[j]
                + (s3 - s2) * gap * self.values[j, 0]
            )
            return value
        if self.path == "rotation":
            return slerp_rows(keys[j - 1], keys[j], s)
        straight: F64 = (1 - s) * keys[j - 1] + s * keys[j]
        return straight


class NodeTree:
    """The matrices of all nodes at a time; only those that move are computed anew.

    ``duration_s`` is the time of the last keyframe; with ``repeat``, time starts over there.
    """

    def __init__(
        self,
        parents: Sequence[int],
        trs: tuple[F64, F64, F64],
        fixed: dict[int, Matrix],
        channels: Sequence[Channel],
        *,
        repeat: bool = False,
    ) -> None:
        """Sort the nodes by depth.

        Args:
            parents: each node's parent, -1 for roots.
            trs: translations ``[n, 3]``, rotations ``[n, 4]`` (x, y, z, w) and scales ``[n, 3]`` at rest.
            fixed: the matrices of nodes that have one in place of those.
            channels: what moves.
            repeat: whether the animation starts over when it has ended.
        """
        self.duration_s = max((float(c.times_s[-1]) for c in channels), default=0.0)
        self._repeat = repeat
        self._channels = [c for c in channels if c.path in ("translation", "rotation", "scale")]
        self._weights = {c.node: c for c in channels if c.path == "weights"}
        self._trs = trs
        n = len(parents)
        self._animated = np.array(sorted({c.node for c in self._channels}), np.int64)
        # Files mostly have the same times for all joints.
        self._alike = [
            (np.searchsorted(self._animated, [c.node for c in alike]), _stacked(alike))
            for alike in _by_times(self._channels)
        ]
        self._parents = np.asarray(parents, np.int64)
        depth = _depths(self._parents)
        local = _compose_all(*trs)
        for node, matrix in fixed.items():
            local[node] = matrix
        moving = np.zeros(n, bool)
        moving[self._animated] = True
        self._rest = np.tile(np.eye(4), (n, 1, 1))
        self._levels: list[npt.NDArray[np.int64]] = []
        for level in range(int(depth.max(initial=-1)) + 1):
            nodes = np.flatnonzero(depth == level)
            up = self._parents[nodes]
            if level:
                moving[nodes] |= moving[up]
            above = np.where((up >= 0)[:, None, None], self._rest[up], np.eye(4))
            self._rest[nodes] = above @ local[nodes]
            self._levels.append(nodes[moving[nodes]])
        self._local = local
        self.moving = moving
        self._cache: tuple[float, Matrix] = (np.nan, self._rest)

    def rest_local(self, node: int) -> Matrix:
        """Return a node's own matrix at rest."""
        matrix: Matrix = self._local[node]
        return matrix

    def chain(self, node: int) -> list[int]:
        """Return the node and its ancestors, root first."""
        found = []
        while node >= 0:
            found.append(node)
            node = int(self._parents[node])
        return found[::-1]

    def scales(self, node: int) -> F64:
        """Return all scales ``[k, 3]`` that a node has at rest or in keyframes, which are not those of splines."""
        keyed = [c.values for c in self._channels_of(node, "scale")]
        return np.concatenate(keyed or [self._trs[2][node : node + 1]])

    def spline_scaled(self, node: int) -> bool:
        """Tell whether a node's scale runs along splines, between whose keyframes it may do anything."""
        return any(c.interpolation == "CUBICSPLINE" for c in self._channels_of(node, "scale"))

    def weights(self, node: int) -> Channel | None:
        """Return the channel of a node's morph weights."""
        return self._weights.get(node)

    def local_time(self, time_s: float) -> float:
        """Return the time within the animation."""
        return time_s % self.duration_s if self._repeat and self.duration_s > 0 else time_s

    def matrices(self, time_s: float) -> Matrix:
        """Return all nodes' matrices to the world ``[n, 4, 4]``; not to be written to."""
        time_s = self.local_time(time_s)
        cached_time, cached = self._cache
        if cached_time == time_s or not len(self._animated):
            return cached
        translations, rotations, scales = (part[self._animated].copy() for part in self._trs)
        rows = {"translation": translations, "rotation": rotations, "scale": scales}
        for which, channels in self._alike:
            rows[channels.path][which] = channels.at(time_s)
        local = self._local.copy()
        local[self._animated] = _compose_all(translations, rotations, scales)
        world: Matrix = self._rest.copy()
        for nodes in self._levels:
            up = self._parents[nodes]
            above = np.where((up >= 0)[:, None, None], world[up], np.eye(4))
            world[nodes] = above @ local[nodes]
        self._cache = (time_s, world)  # one assignment: another thread sees the old pair or the new one
        return world

    def _channels_of(self, node: int, path: str) -> list[Channel]:
        return [c for c in self._channels if c.node == node and c.path == path]


@dataclass(frozen=True)
class NodeMotion:
    """A node's pose, with a fixed placement inside it."""

    tree: NodeTree
    node: int
    offset: Matrix

    @property
    def duration_s(self) -> float:
        """Length of the animation [s]; 0 where the node stands still."""
        return self.tree.duration_s if self.tree.moving[self.node] else 0.0

    def pose(self, time_s: float) -> Matrix:
        """Return the pose at that time."""
        matrix: Matrix = self.tree.matrices(time_s)[self.node] @ self.offset
        return matrix


@dataclass(frozen=True)
class MeshDeformation:
    """Morph targets, then a skin or a node's matrix, applied to the vertices of a mesh.

    Attributes:
        tree: where the matrices come from.
        vertices: float32 ``[n, 3]`` at rest.
        normals: float32 ``[n, 3]`` at rest, or None.
        targets: differences of the vertices per morph target, float32 ``[m, n, 3]``.
        normal_targets: likewise of the normals, or None where normals are.
        weights: the morph weights: a channel, or what they are at all times.
        joints: nodes whose matrices pull the vertices.
        bind: matrices from the mesh to each joint at rest ``[j, 4, 4]``.
        vertex_joints: int32 ``[n, k]``, indices into ``joints``.
        vertex_weights: float32 ``[n, k]``, of sum 1.
    """

    tree: NodeTree
    vertices: F32
    normals: F32 | None
    targets: F32
    normal_targets: F32 | None
    weights: Channel | F64
    joints: npt.NDArray[np.int64]
    bind: Matrix
    vertex_joints: I32
    vertex_weights: F32

    @property
    def duration_s(self) -> float:
        """Length of the animation [s]; 0 where nothing of it moves."""
        moves = isinstance(self.weights, Channel) or bool(self.tree.moving[self.joints].any())
        return self.tree.duration_s if moves else 0.0

    def vertices_at(self, time_s: float) -> tuple[F32, F32 | None]:
        """Return vertices and normals at a time, in the space that the joints' matrices lead to."""
        vertices, normals = self.vertices, self.normals
        if len(self.targets):
            local = self.tree.local_time(time_s)
            weights = self.weights.at(local) if isinstance(self.weights, Channel) else self.weights
            share = weights.astype(np.float32)
            vertices = vertices + np.tensordot(share, self.targets, 1)
            if normals is not None and self.normal_targets is not None:
                normals = normals + np.tensordot(share, self.normal_targets, 1)
        if len(self.joints):
            matrices = (self.tree.matrices(time_s)[self.joints] @ self.bind)[:, :3].astype(np.float32)
            if self.vertex_joints.shape[1]:
                blended = np.zeros((len(vertices), 3, 4), np.float32)
                for k in range(self.vertex_joints.shape[1]):
                    blended += self.vertex_weights[:, k, None, None] * matrices[self.vertex_joints[:, k]]
            else:
                blended = matrices[:1]
            vertices = (blended[:, :, :3] @ vertices[:, :, None])[:, :, 0] + blended[:, :, 3]
            if normals is not None:
                normals = (_cofactors(blended[:, :, :3]) @ normals[:, :, None])[:, :, 0]
        if normals is not None:
            lengths = np.linalg.norm(normals, axis=1, keepdims=True)
            upright = np.where(lengths > 1e-12, normals / np.maximum(lengths, 1e-12), (0.0, 1.0, 0.0))
            normals = np.ascontiguousarray(upright, np.float32)
        return np.ascontiguousarray(vertices, np.float32), normals


def _by_times(channels: Sequence[Channel]) -> Iterable[list[Channel]]:
    """Return channels of one property that are joined in one way, and have keyframes at the same times, together."""
    found: dict[tuple[str, str, bytes], list[Channel]] = {}
    for channel in channels:
        found.setdefault((channel.path, channel.interpolation, channel.times_s.tobytes()), []).append(channel)
    return found.values()


def _stacked(channels: Sequence[Channel]) -> Channel:
    """Return one channel for the values of several of `_by_times`, ``[k, m, n]`` or ``[k, 3, m, n]``."""
    return replace(channels[0], values=np.stack([channel.values for channel in channels], axis=-2))


def _cofactors(linear: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return what turns normals: the cofactors ``[…, 3, 3]``, which exist where the inverse does not.

    A mirrored matrix turns them inside out, and with them goes the order of the triangles' vertices: both stay true.
    """
    a, b, c = linear[..., 0], linear[..., 1], linear[..., 2]
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-1)


def _depths(parents: npt.NDArray[np.int64]) -> npt.NDArray[Any]:
    """Return how deep each node of a tree lies; roots at 0."""
    depth = np.where(parents < 0, 0, -1)
    while (depth < 0).any():
        known = (depth < 0) & (depth[parents] >= 0)
        depth[known] = depth[parents[known]] + 1
    return depth


def _compose_all(translations: F64, rotations: F64, scales: F64) -> Matrix:
    matrices = np.tile(np.eye(4), (len(translations), 1, 1))
    lengths = np.linalg.norm(rotations, axis=1, keepdims=True)
    x, y, z, w = (rotations / np.maximum(lengths, 1e-30)).T
    matrices[:, 0, :3] = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], axis=1)
    matrices[:, 1, :3] = np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], axis=1)
    matrices[:, 2, :3] = np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], axis=1)
    matrices[:, :3, :3] *= scales[:, None, :]
    matrices[:, :3, 3] = translations
    return matrices
