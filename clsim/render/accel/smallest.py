"""How far nothing is narrow: what is seen wider than a pixel hides between no corners of one.

A sheet is as wide as its triangles, but not where it is seen on its edge.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from clsim.render.accel.placement import Placement
from clsim.render.motion.deform import box, deforms
from clsim.scene import Instance, Mesh, Motion, SphereLight, Static

F64 = npt.NDArray[np.float64]
PoseAt = Callable[[Motion, float], F64]
Mask = npt.NDArray[np.bool_]

_MOST_TRIANGLES = 1 << 16
"""Triangles of a mesh from which on some are taken for tiny, unseen: it takes time to see, and they are."""
_SLIVER = 1e-6
"""Share of its longest side below which a triangle's height is taken for a rounding of none: nobody sees it."""
_MOST_MOVING = 64
"""Moving objects from which on the same holds; from so many lamps on, all are as near as the nearest of them."""
_TIMES = 33
"""Times of a motion at which an object's scale is sampled."""
_CUBE = np.full(3, 1.0 / np.sqrt(3.0))
"""Half the box within a sphere, whose corners are a radius away from its middle."""
_MOST_AT_ONCE = 1 << 14
"""Sheets times places that are evaluated together, so that memory does not grow."""
_FOLD = np.cos(np.radians(30.0))
"""Cosine of the angle between two triangles below which both are as good as one sheet."""
_TIP_RAD = np.radians(50.0)
"""Sum of the angles around a corner below which it is a tip, which is narrow far from its end too."""


@dataclass(frozen=True)
class Extent:
    """Where something is, and how narrow it is.

    Attributes:
        width_m: the lowest height of its triangles, or the diameter of a sphere [m]; 0 where that is unknown or tells
            nothing, infinite where there is nothing.
        motion: how it moves.
        box: the least and the greatest of its own coordinates ``[2, 3]``; None where it may be anywhere.
    """

    width_m: float
    motion: Motion
    box: F64 | None

    def nearest_m(self, places: F64, poses: F64) -> F64:
        """Return how near it may be to each place in the world ``[K, 3]``, if it stands so ``[K, 4, 4]``."""
        if self.box is None:
            return np.zeros(len(places))
        turned, (low, high) = poses[:, :3, :3], self.box
        ways = turned @ (low + high) / 2 + poses[:, :3, 3] - places
        sizes = np.abs(turned) @ (high - low) / 2
        return np.asarray(np.maximum(np.linalg.norm(ways, axis=1) - np.linalg.norm(sizes, axis=1), 0.0))


@dataclass(frozen=True)
class Smallest:
    """What is narrow in a world.

    Attributes:
        extents: all that there is.
        sheets: triangles that stand still and may be seen on their edge: corners ``[N, 3, 3]`` in the world [m].
        sides_m: the longest side of each ``[N]``.
    """

    extents: tuple[Extent, ...]
    sheets: F64
    sides_m: F64

    def clear_m(self, places: F64, times_s: F64, narrow: tuple[float, float], pose_at: PoseAt) -> F64:
        """Return how far from each place nothing that is seen is narrow [m].

        Args:
            places: from where one looks, ``[K, 3]``.
            times_s: when, ``[K]``.
            narrow: what is narrow as seen from a place [rad], or 0 where that is a width [m] at all distances.
            pose_at: the pose of a motion at a time.
        """
        clear = np.full(len(places), np.inf)
        for extent in sorted(self.extents, key=lambda extent: extent.width_m):
            wide_m = _wide_to(extent.width_m, narrow)
            if (clear <= wide_m).all():
                break
            # Parallel rays have no place from which something is far off.
            poses = np.array([pose_at(extent.motion, time_s) for time_s in times_s.tolist()]) if narrow[0] else None
            near_m = 0.0 if poses is None else extent.nearest_m(places, poses)
            clear = np.minimum(clear, np.maximum(near_m, wide_m))
        if not len(self.sheets):
            return clear
        if not narrow[0]:
            return np.zeros(len(places))
        step = max(1, _MOST_AT_ONCE // len(self.sheets))
        batches = [self._edges_m(places[first : first + step], narrow[0]) for first in range(0, len(places), step)]
        return np.asarray(np.minimum(clear, np.concatenate([np.zeros(0), *batches])))

    def _edges_m(self, places: F64, narrow_rad: float) -> F64:
        """Return how far from each place ``[K, 3]`` the nearest sheet is that is seen on its edge."""
        ways = self.sheets - places[:, None, None]
        lengths = np.maximum(np.linalg.norm(ways, axis=3), 1e-30)
        a, b, c = np.moveaxis(ways / lengths[..., None], 2, 0)
        # Seen from there, a corner is so far away from the great circle through the two others.
        off = np.abs((a * np.cross(b, c)).sum(axis=2))
        cosines = [(one * other).sum(axis=2) for one, other in ((a, b), (b, c), (c, a))]
        longest = np.sqrt(np.maximum(1.0 - np.square(cosines).min(axis=0), 0.0))
        on_edge = off < np.sin(narrow_rad) * longest
        # No point of a triangle is nearer than its farthest corner less its longest side.
        near = np.maximum(lengths.max(axis=2) - self.sides_m, 0.0)
        return np.asarray(np.where(on_edge, near, np.inf).min(axis=1))


def smallest_of(placement: Placement, sphere_lights: Iterable[SphereLight]) -> Smallest:
    """Find what is narrow."""
    sheets, spheres = [np.zeros((0, 3, 3))], list(sphere_lights)
    extents = [Extent(2.0 * s.radius_m, s.motion, s.radius_m * np.array([[-1.0], [1.0]]) * _CUBE) for s in spheres]
    if len(spheres) > _MOST_MOVING:
        extents = [Extent(min(extent.width_m for extent in extents), Static(np.eye(4)), None)]
    moving = sum(instance.motion.duration_s > 0 for instance in placement.instances)
    for instance in placement.instances:
        mesh = placement.meshes[instance.mesh]
        if moving > _MOST_MOVING or deforms(mesh):
            return Smallest((Extent(0.0, instance.motion, None),), sheets[0], np.zeros(0))
        if len(mesh.triangles) > _MOST_TRIANGLES:
            extents.append(Extent(0.0, instance.motion, box(mesh)))
            continue
        corners = _seen(mesh)
        heights, _ = _heights(corners)
        width_m = float(heights.min(initial=np.inf)) * _least_scale(instance)
        thin, tips = _edges_and_tips(corners)
        if tips or (thin.any() and instance.motion.duration_s > 0):
            width_m = 0.0
        pose = instance.motion.pose(0.0)
        extents.append(Extent(width_m, instance.motion, box(mesh)))
        if width_m > 0.0:
            sheets.append(corners[thin] @ pose[:3, :3].T + pose[:3, 3])
    found = np.concatenate(sheets)
    return Smallest(tuple(extents), found, _heights(found)[1])


def _wide_to(width_m: float, narrow: tuple[float, float]) -> float:
    """Return how far something of that width is not seen narrow [m]."""
    if narrow[0]:
        return width_m / narrow[0]
    return np.inf if width_m > narrow[1] else 0.0


def _seen(mesh: Mesh) -> F64:
    """Return the corners of a mesh's triangles, ``[N, 3, 3]``, but of slivers."""
    # Zero has one sign, so that places can be compared by their bits.
    corners = mesh.vertices.astype(np.float64)[mesh.triangles] + 0.0
    heights, longest = _heights(corners)
    return np.asarray(corners[heights > _SLIVER * longest])


def _heights(corners: F64) -> tuple[F64, F64]:
    """Return the lowest height of each triangle, and its longest side."""
    sides = np.roll(corners, -1, axis=1) - corners
    doubled = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    longest = np.linalg.norm(sides, axis=2).max(axis=1)
    return doubled / np.maximum(longest, 1e-300), longest


def _edges_and_tips(corners: F64) -> tuple[Mask, bool]:
    """Return which triangles have an edge with none, or with a sharp fold, behind it, and whether there are tips."""
    if not len(corners):
        return np.zeros(0, np.bool_), False
    places, at = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    at = at.reshape(-1, 3)
    before, after = (np.roll(corners, by, axis=1) - corners for by in (1, -1))
    before, after = (way / np.linalg.norm(way, axis=2, keepdims=True) for way in (before, after))
    angles = np.arccos(np.clip((before * after).sum(axis=2), -1.0, 1.0))
    tips = np.bincount(at.ravel(), angles.ravel(), len(places)) < _TIP_RAD
    # The edge from each corner to the next, and the way from it into the triangle.
    inwards = before - (before * after).sum(axis=2, keepdims=True) * after
    inwards = (inwards / np.linalg.norm(inwards, axis=2, keepdims=True)).reshape(-1, 3)
    other = np.roll(at, -1, axis=1)
    edges = (np.minimum(at, other) * len(places) + np.maximum(at, other)).ravel()
    _, edge, counts = np.unique(edges, return_inverse=True, return_counts=True)
    sharp = counts != 2
    order = np.argsort(edge, kind="stable")
    pairs = order[np.repeat(counts == 2, counts)].reshape(-1, 2)
    folded = (inwards[pairs[:, 0]] * inwards[pairs[:, 1]]).sum(axis=1) > _FOLD
    sharp[np.flatnonzero(counts == 2)] = folded
    return np.asarray(sharp[edge.reshape(-1, 3)].any(axis=1), np.bool_), bool(tips.any())


def _least_scale(instance: Instance) -> float:
    """Return the least factor by which an instance's motion shrinks its mesh."""
    count = _TIMES if instance.motion.duration_s > 0 else 1
    poses = [instance.motion.pose(time_s) for time_s in np.linspace(0.0, instance.motion.duration_s, count)]
    return float(np.linalg.svd(np.array(poses)[:, :3, :3], compute_uv=False).min())
