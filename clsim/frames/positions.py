"""Depth from first-hit positions, as pbrt-v4's GBufferFilm writes them.

Its positions are in camera or world space (``coordinatesystem``), and nothing in the file says which. A perspective
camera does: seen from the right origin, x/z and y/z of a position are linear in the pixel.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from clsim.frames.frame import FloatArray

Space = Literal["camera", "world"]
_TOLERANCE_PX = 1.5
"""How far positions (means over a pixel's samples) may lie from their pixel under the right hypothesis."""
_MIN_HITS = 16


def camera_matrix(header: object) -> npt.NDArray[np.float64] | None:
    """Return a file header's ``worldToCamera`` as a matrix for column vectors ``[4, 4]``, or None."""
    matrix = header.get("worldToCamera") if isinstance(header, dict) else None
    if matrix is None:
        return None
    values = np.asarray(matrix, dtype=np.float64).reshape(4, 4)
    affine_rows = np.allclose(values[3], [0, 0, 0, 1])
    return values if affine_rows else values.T


def position_space(position: FloatArray, world_to_camera: npt.NDArray[np.float64] | None) -> Space | None:
    """Tell in which space positions ``[3, H, W]`` are; None if a perspective camera explains neither."""
    misfit: dict[Space, float] = {"camera": _misfit_px(position.astype(np.float64))}
    if world_to_camera is not None:
        misfit["world"] = _misfit_px(_to_camera(position, world_to_camera))
    best = min(misfit, key=lambda space: misfit[space])
    return best if misfit[best] < _TOLERANCE_PX else None


def depth_of(
    position: FloatArray, space: Space, world_to_camera: npt.NDArray[np.float64] | None
) -> npt.NDArray[np.float64]:
    """Return the distance ``[H, W]`` of positions ``[3, H, W]`` from the camera; without meaning for misses."""
    seen = position.astype(np.float64)
    if space == "world":
        if world_to_camera is None:
            raise ValueError("positions in world space need the camera's matrix")
        seen = _to_camera(position, world_to_camera)
    return np.asarray(np.sqrt((seen * seen).sum(axis=0)))


def _to_camera(position: FloatArray, world_to_camera: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    moved = np.tensordot(world_to_camera[:3, :3], position.astype(np.float64), axes=1)
    return np.asarray(moved + world_to_camera[:3, 3][:, None, None])


def _misfit_px(seen: npt.NDArray[np.float64]) -> float:
    """Median distance [px] between each pixel and the pixel a linear map of its view direction says."""
    x, y, z = seen
    hit = np.isfinite(seen).all(axis=0) & (seen != 0).any(axis=0) & (z != 0)
    if hit.sum() < _MIN_HITS:
        return np.inf
    pixel = np.stack(np.nonzero(hit), axis=1).astype(np.float64)
    direction = np.column_stack([x[hit] / z[hit], y[hit] / z[hit], np.ones(int(hit.sum()))])
    fit = np.linalg.lstsq(direction, pixel, rcond=None)[0]
    return float(np.median(np.abs(direction @ fit - pixel).max(axis=1)))
