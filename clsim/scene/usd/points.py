"""Points of a USD file, as small spheres."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from pxr import UsdGeom

from clsim.scene import shapes
from clsim.scene.usd.materials import MaterialReader
from clsim.scene.usd.stage import Stage
from clsim.scene.world import Mesh

MOST_POINTS = 100_000
_SEGMENTS = 8
"""Round each point: most are a few pixels wide."""
_WIDTH_SHARE = 0.3
"""Width of points that tell none, as a share of how far apart they would be if spread evenly over their box."""


def read_points(stage: Stage, prim: Any, materials: MaterialReader, warn: Callable[[str], None]) -> Mesh | None:
    """Return the spheres of a ``UsdGeomPoints`` as one mesh, with their own widths and colours; None where it has none.

    They stand as at the start, and keep smooth normals.
    """
    source, name = UsdGeom.Points(prim), prim.GetName()
    points = np.array(stage.value(source.GetPointsAttr()) or [], np.float64).reshape(-1, 3)
    there = np.isfinite(points).all(axis=1)
    told, points = len(points), points[there]
    if not len(points):
        return None
    if len(points) > MOST_POINTS:
        warn(f"of the points of {name} one in {-(-len(points) // MOST_POINTS)} is shown: they are {len(points)}")
    if stage.times(source.GetPointsAttr()):
        warn(f"points that move stand as at the start (first {name})")
    widths = np.array(stage.still(source.GetWidthsAttr()) or [], np.float64).ravel()
    widths = widths[there] if len(widths) == told else widths
    if len(widths) not in (1, len(points)) or not np.isfinite(widths).all():
        widths = np.array([_WIDTH_SHARE * float(np.ptp(points, axis=0).max() or 1.0) / len(points) ** (1 / 3)])
        warn(f"points of {name} tell no widths: they are {widths[0]:.3g} wide")
    colors = np.array(stage.still(source.GetDisplayColorAttr()) or [], np.float64).reshape(-1, 3)
    colors = colors[there] if len(colors) == told else colors
    one = tuple(np.clip(colors[0], 0.0, 1.0).tolist()) if len(colors) == 1 else None
    several = materials.color_name(prim) == "displayColor" and len(colors) == len(points) > 1
    material = materials.index(prim, (1.0, 1.0, 1.0) if several else one)
    kept = slice(None, None, -(-len(points) // MOST_POINTS))
    centres, radii = points[kept], np.abs(np.broadcast_to(widths, len(points))[kept]) / 2
    ball = shapes.sphere(1.0, _SEGMENTS)
    count, corners = len(centres), len(ball.vertices)
    vertices = centres[:, None] + radii[:, None, None] * ball.vertices
    triangles = ball.triangles + corners * np.arange(count, dtype=np.int32)[:, None, None]
    normals = None if ball.normals is None else np.tile(ball.normals, (count, 1))
    return Mesh(
        np.ascontiguousarray(vertices.reshape(-1, 3), np.float32),
        np.ascontiguousarray(triangles.reshape(-1, 3), np.int32),
        np.full(count * len(ball.triangles), material, np.int32),
        normals=normals,
        colors=np.repeat(np.clip(colors[kept], 0.0, 1.0), corners, axis=0).astype(np.float32) if several else None,
    )
