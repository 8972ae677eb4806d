"""The width below which no thing in a world lies: what looks wider than a pixel hides between no corners of one."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from clsim.render.deform import deforms
from clsim.render.placement import Placement
from clsim.scene import Instance, Mesh, SphereLight

_MOST_TRIANGLES = 1 << 16
"""Triangles of a mesh from which on some are taken for tiny, unseen: it takes time to see, and they are."""
_SLIVER = 1e-6
"""Share of its longest side below which a triangle's height is taken for a rounding of none: nobody sees it."""
_MOST_MOVING = 64
"""Moving things from which on the same holds."""
_TIMES = 33
"""Times of a motion at which a thing's scale is looked at."""


def smallest_width(placement: Placement, sphere_lights: Iterable[SphereLight]) -> float:
    """Return the lowest height of all triangles and the least diameter of all spheres [m]; 0 where that is unknown.

    Infinite where there is nothing at all.
    """
    moving = [instance for instance in placement.instances if instance.motion.duration_s > 0]
    if len(moving) > _MOST_MOVING:
        return 0.0
    heights = [_lowest_height(mesh) for mesh in placement.meshes]
    widths = [heights[each.mesh] * _least_scale(each) for each in placement.instances]
    return min([*widths, *(2.0 * sphere.radius_m for sphere in sphere_lights)], default=float("inf"))


def _lowest_height(mesh: Mesh) -> float:
    """Return the lowest height of a mesh's triangles, in its own units; slivers are not seen."""
    if len(mesh.triangles) > _MOST_TRIANGLES or deforms(mesh):
        return 0.0
    corners = mesh.vertices.astype(np.float64)[mesh.triangles]
    sides = np.roll(corners, -1, axis=1) - corners
    doubled = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    longest = np.linalg.norm(sides, axis=2).max(axis=1)
    seen = doubled > _SLIVER * longest * longest
    return float(np.min(doubled[seen] / longest[seen], initial=np.inf))


def _least_scale(instance: Instance) -> float:
    """Return the least factor by which an instance's motion shrinks its mesh."""
    count = _TIMES if instance.motion.duration_s > 0 else 1
    poses = [instance.motion.pose(time_s) for time_s in np.linspace(0.0, instance.motion.duration_s, count)]
    return float(np.linalg.svd(np.array(poses)[:, :3, :3], compute_uv=False).min())
