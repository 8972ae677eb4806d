"""Polygons as triangles."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

I64 = npt.NDArray[np.int64]
F64 = npt.NDArray[np.float64]
_MOST_CORNERS = 4096
"""Of a concave polygon that is cut within its outline: that takes a second for so many, and four for twice as many."""
_TRIES = 16
"""Corners that are tried for each that there is: simple outlines need some two."""


def triangulated(points: F64, counts: I64, indices: I64) -> tuple[I64, I64]:
    """Cut polygons into triangles of the same turn; concave ones are cut within their outline, unless they are huge.

    Args:
        points: ``[n, 3]``.
        counts: corners of each polygon, ``[f]``; those of fewer than three have no triangle.
        indices: the point of each corner, ``[sum(counts)]``.

    Returns:
        The corners of each triangle ``[m, 3]``, as places in ``indices``, and which polygon it is of, ``[m]``, in their
        order.
    """
    first = np.cumsum(counts) - counts
    fans = np.maximum(counts - 2, 0)
    faces = np.repeat(np.arange(len(counts)), fans)
    fan = np.cumsum(fans) - fans
    step = np.arange(len(faces)) - np.repeat(fan, fans)
    triangles = first[faces][:, None] + np.stack([np.zeros_like(step), step + 1, step + 2], axis=1)
    concave = _concave(points[indices[triangles]], faces, len(counts))
    for face in concave[counts[concave] <= _MOST_CORNERS]:
        corners = first[face] + np.arange(counts[face])
        triangles[fan[face] : fan[face] + fans[face]] = corners[_ears(points[indices[corners]])]
    return triangles, faces


def _concave(corners: F64, faces: I64, count: int) -> I64:
    """Return which polygons have triangles of a fan that turn the other way than the polygon as a whole."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    whole = np.zeros((count, 3))
    np.add.at(whole, faces, normals)
    return np.unique(faces[np.einsum("ij,ij->i", normals, whole[faces]) < 0])


def _ears(points: F64) -> I64:
    """Cut one polygon by its ears: corners that turn with it and have no other one inside (Meisters, 1975).

    An outline that crosses itself may have none. What is left of it then, or after a great many corners were tried, is
    a fan.
    """
    normal = np.cross(points - points[0], np.roll(points, -1, axis=0) - points[0]).sum(axis=0)
    axis = int(np.argmax(np.abs(normal)))
    flat = np.delete(points, axis, axis=1) * (1.0 if normal[axis] >= 0 else -1.0, 1.0)
    if axis == 1:
        flat[:, 0] *= -1.0
    left = list(range(len(points)))
    found, k, tries = [], 0, _TRIES * len(points)
    while len(left) > 3:
        # Where one ear was, the next one often is.
        steps = range(min(len(left), tries))
        step = next((step for step in steps if _is_ear(flat, left, (k - 1 + step) % len(left))), None)
        if step is None:
            break
        k, tries = (k - 1 + step) % len(left), tries - step - 1
        found.append((left[k - 1], left[k], left[(k + 1) % len(left)]))
        del left[k]
    found += [(left[0], left[each], left[each + 1]) for each in range(1, len(left) - 1)]
    return np.array(found, np.int64)


def _is_ear(flat: F64, left: list[int], k: int) -> bool:
    before, at, after = left[k - 1], left[k], left[(k + 1) % len(left)]
    a, b, c = flat[before], flat[at], flat[after]
    if _turn(a, b, c) <= 0:
        return False
    others = flat[[i for i in left if i not in (before, at, after)]]
    inside = (_turn(a, b, others) >= 0) & (_turn(b, c, others) >= 0) & (_turn(c, a, others) >= 0)
    return not bool(np.any(inside))


def _turn(a: F64, b: F64, c: F64) -> F64:
    """Return twice the area of triangles in the plane, positive where they turn to the left."""
    turn: F64 = (b[0] - a[0]) * (c[..., 1] - a[1]) - (b[1] - a[1]) * (c[..., 0] - a[0])
    return turn


def cut_anew(triangles: I64, faces: I64, counts: I64) -> Iterator[tuple[int, list[list[int]]]]:
    """Yield which polygons have other triangles than a fan from their first corner, and the corners of each of these.

    ``triangles`` and ``faces`` are as `triangulated` returns them.
    """
    first = np.cumsum(counts) - counts
    for face in np.unique(faces[triangles[:, 0] != first[faces]]).tolist():
        begin, end = np.searchsorted(faces, (face, face + 1))
        yield face, (triangles[begin:end] - first[face]).tolist()
