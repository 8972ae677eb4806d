"""The smallest width of anything in a world: what is seen wider than a pixel hides between no corners of one.

A sheet is as wide as its triangles, but not where it is seen on its edge.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from clsim.render.accel.placement import Placement
from clsim.render.motion.deform import deforms
from clsim.scene import Instance, Mesh, SphereLight

F64 = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

_MOST_TRIANGLES = 1 << 16
"""Triangles of a mesh from which on some are taken for tiny, unseen: it takes time to see, and they are."""
_SLIVER = 1e-6
"""Share of its longest side below which a triangle's height is taken for a rounding of none: nobody sees it."""
_MOST_MOVING = 64
"""Moving objects from which on the same holds."""
_TIMES = 33
"""Times of a motion at which an object's scale is sampled."""
_MOST_AT_ONCE = 1 << 14
"""Sheets times places that are evaluated together, so that memory does not grow."""
_FOLD = np.cos(np.radians(30.0))
"""Cosine of the angle between two triangles below which both are as good as one sheet."""
_TIP_RAD = np.radians(50.0)
"""Sum of the angles around a corner below which it is a tip, which is narrow far from its end too."""
_WIDE_PX = 2.0
"""Width that a sheet is seen to have, if it is not seen on its edge [pixels]."""


@dataclass(frozen=True)
class Smallest:
    """What is narrow in a world.

    Attributes:
        width_m: the lowest height of all triangles and the least diameter of all spheres [m]; 0 where that is unknown,
            or tells nothing, infinite where there is nothing at all.
        sheets: triangles that stand still and may be seen on their edge: corners ``[N, 3, 3]`` in the world [m].
    """

    width_m: float
    sheets: F64

    def seen_from(self, places: F64, pixel_angle: float) -> F64:
        """Return the width below which nothing lies as seen from each place ``[K, 3]``; a pixel is so wide [rad]."""
        if not len(self.sheets):
            return np.full(len(places), self.width_m)
        batches = range(0, len(places), max(1, _MOST_AT_ONCE // max(1, len(self.sheets))))
        step = batches.step
        wide = [self._all_wide(places[first : first + step], pixel_angle) for first in batches]
        return np.where(np.concatenate([np.zeros(0, np.bool_), *wide]), self.width_m, 0.0)

    def _all_wide(self, places: F64, pixel_angle: float) -> Mask:
        """Return from which places ``[K, 3]`` no sheet is seen on its edge."""
        ways = self.sheets - places[:, None, None]
        a, b, c = np.moveaxis(ways / np.maximum(np.linalg.norm(ways, axis=3, keepdims=True), 1e-30), 2, 0)
        # Seen from there, a corner is so far away from the great circle through the two others.
        off = np.abs((a * np.cross(b, c)).sum(axis=2))
        cosines = [(one * other).sum(axis=2) for one, other in ((a, b), (b, c), (c, a))]
        longest = np.sqrt(np.maximum(1.0 - np.square(cosines).min(axis=0), 0.0))
        return np.asarray((off >= np.sin(_WIDE_PX * pixel_angle) * longest).all(axis=1))


def smallest_of(placement: Placement, sphere_lights: Iterable[SphereLight]) -> Smallest:
    """Find what is narrow."""
    sheets = [np.zeros((0, 3, 3))]
    width_m = min((2.0 * sphere.radius_m for sphere in sphere_lights), default=np.inf)
    moving = sum(instance.motion.duration_s > 0 for instance in placement.instances)
    for instance in placement.instances:
        mesh = placement.meshes[instance.mesh]
        if moving > _MOST_MOVING or len(mesh.triangles) > _MOST_TRIANGLES or deforms(mesh):
            return Smallest(0.0, sheets[0])
        corners = _seen(mesh)
        heights, _ = _heights(corners)
        width_m = min(width_m, float(heights.min(initial=np.inf)) * _least_scale(instance))
        thin, tips = _edges_and_tips(corners)
        if tips or (thin.any() and instance.motion.duration_s > 0):
            return Smallest(0.0, sheets[0])
        pose = instance.motion.pose(0.0)
        sheets.append(corners[thin] @ pose[:3, :3].T + pose[:3, 3])
    return Smallest(width_m, np.concatenate(sheets))


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
