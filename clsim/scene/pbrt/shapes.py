"""pbrt-v4's shapes as meshes, and its environment images as latitude-longitude ones."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.scene.meshes.geometry import facing_as_normals, joined, smooth_normals
from clsim.scene.meshes.trimesh_scene import load_triangles
from clsim.scene.motion import Matrix
from clsim.scene.pbrt.tokens import Parameters, file_of
from clsim.scene.shapes import sphere
from clsim.scene.world import F32, Mesh

F64 = npt.NDArray[np.float64]
SEGMENTS = 64
DEFAULT_UVS = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
"""Texture coordinates of the corners of a triangle that has none of its own."""
CURVED = 8
"""How finely a patch is divided that is not flat, along each side, where there are few of them."""
MAX_CELLS = 1 << 20
"""Into how many parts all curved patches of a mesh are divided."""


def read_shape(kind: str, parameters: Parameters, folder: Path, warn: Callable[[str], None]) -> Mesh | None:
    """Return a shape's mesh in its own space, of material 0; None, with a warning, where clsim lacks the shape.

    Raises:
        InputError: with file and line.
    """
    if "displacement" in parameters.found:
        warn(f"the displacement of a {kind} is left out")
    if kind == "plymesh":
        mesh = load_triangles(file_of(parameters.place, parameters.word("filename", ""), folder))
        return facing_as_normals(mesh)
    if kind == "trianglemesh":
        return facing_as_normals(_mesh(*_told(kind, parameters, 3)))
    if kind == "bilinearmesh":
        return facing_as_normals(_patches(*_told(kind, parameters, 4)))
    if kind == "loopsubdiv":
        warn("a loopsubdiv is not subdivided: it gets smooth normals instead")
        return smooth_normals(_mesh(*_told(kind, parameters, 3)))
    if kind in ("sphere", "disk", "cylinder"):
        return _round(kind, parameters)
    warn(f"shapes of type {kind} are left out")
    return None


def _round(kind: str, parameters: Parameters) -> Mesh:
    radius, phi_max = parameters.number("radius", 1.0), parameters.number("phimax", 360.0)
    for name, value in (("radius", radius), ("phimax", phi_max)):
        if not value > 0:
            raise InputError(f"{parameters.place}: {name} is {value:g}, expected more than 0")
    phi_max = math.radians(min(phi_max, 360.0))
    if kind == "disk":
        inner, height = parameters.number("innerradius", 0.0), parameters.number("height", 0.0)
        if inner == 0 and phi_max == 2 * math.pi:
            return _disk(radius, height)
        return _turned(np.array([(radius, height), (inner, height)]), np.array([(0.0, 1.0)] * 2), phi_max)
    end = radius if kind == "sphere" else 1.0
    low, high = sorted(parameters.number(name, z) for name, z in (("zmin", -end), ("zmax", end)))
    if kind == "cylinder":
        return _turned(np.array([(radius, low), (radius, high)]), np.array([(1.0, 0.0)] * 2), phi_max)
    if low <= -radius and high >= radius and phi_max == 2 * math.pi:
        return _sphere(radius)
    bottom, top = (math.acos(min(max(z / radius, -1.0), 1.0)) for z in (low, high))
    theta = np.linspace(bottom, top, SEGMENTS // 2 + 1)
    away = np.stack([np.sin(theta), np.cos(theta)], axis=1)
    return _turned(radius * away, away, phi_max)


def _turned(profile: F64, normals: F64, phi_max: float) -> Mesh:
    """Return what a line sweeps as it turns about z; u runs around from 0 to 1, v along the line.

    Args:
        profile: distance from the axis and z of the line's points ``[n, 2]``.
        normals: likewise, their normals.
        phi_max: how far it turns [radians].
    """
    rows = len(profile)
    u, v = np.meshgrid(np.linspace(0, 1, SEGMENTS + 1), np.linspace(0, 1, rows))
    around = np.stack([np.cos(phi_max * u), np.sin(phi_max * u), np.ones_like(u)], axis=-1)
    points, away = ((around * line[:, None, [0, 0, 1]]).reshape(-1, 3) for line in (profile, normals))
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(SEGMENTS), indexing="ij")
    first = (i * (SEGMENTS + 1) + j).ravel()
    above = first + SEGMENTS + 1
    lower = np.stack([first, first + 1, above + 1], axis=1)[np.repeat(profile[:-1, 0] > 1e-9, SEGMENTS)]
    upper = np.stack([first, above + 1, above], axis=1)[np.repeat(profile[1:, 0] > 1e-9, SEGMENTS)]
    return _mesh(points, np.concatenate([lower, upper]), away, np.stack([u.ravel(), v.ravel()], axis=1))


def _told(kind: str, parameters: Parameters, corners: int) -> tuple[F64, F64, F64 | None, F64 | None]:
    """Return points, faces of so many corners, normals and texture coordinates."""
    points = parameters.rows(3, "P")
    if points is None or not len(points):
        raise InputError(f"{parameters.place}: the {kind} has no P")
    faces = parameters.rows(corners, "indices")
    if faces is None:
        if len(points) != corners:
            raise InputError(f"{parameters.place}: the {kind} has no indices for its {len(points)} points")
        faces = np.arange(corners, dtype=np.float64)[None]
    if len(faces) and not (faces.min() >= 0 and faces.max() < len(points)):
        wrong = faces[(faces < 0) | (faces >= len(points))][0]
        raise InputError(f"{parameters.place}: indices has {wrong:g}, expected 0 to {len(points) - 1}")
    normals, uvs = parameters.rows(3, "N"), parameters.rows(2, "uv", "st")
    for name, rows in (("N", normals), ("uv", uvs)):
        if rows is not None and len(rows) != len(points):
            raise InputError(f"{parameters.place}: {name} has {len(rows)} rows for {len(points)} points")
    return points, faces, None if normals is None else _unit(normals), uvs


def _patches(points: F64, faces: F64, normals: F64 | None, uvs: F64 | None) -> Mesh:
    """Return bilinear patches, whose corners run row by row: two triangles each, or a grid where one is curved."""
    rows = faces.astype(np.int64)
    a, b, c, d = np.moveaxis(points[rows], 1, 0)
    across = np.cross(b - a, c - a)
    side = np.maximum(np.linalg.norm(b - a, axis=1), np.linalg.norm(c - a, axis=1))
    curved = np.abs(np.sum((d - a) * across, axis=1)) > 0.01 * side * np.linalg.norm(across, axis=1)
    steps = max(min(CURVED, math.isqrt(MAX_CELLS // max(int(curved.sum()), 1))), 1)
    parts = [(rows[~curved], 1), (rows[curved], steps)]
    return joined([_grids(points, part, normals, uvs, count) for part, count in parts if len(part)])


def _grids(points: F64, rows: npt.NDArray[np.int64], normals: F64 | None, uvs: F64 | None, steps: int) -> Mesh:
    """Return patches in so many steps along each side; u and v are their parameters unless told."""
    v, u = (each.ravel() for each in np.meshgrid(*[np.linspace(0, 1, steps + 1)] * 2, indexing="ij"))
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v], axis=1)

    def between(values: F64) -> F64:
        return np.asarray((weights @ values[rows]).reshape(-1, values.shape[1]))

    if normals is None:
        a, b, c, d = np.moveaxis(points[rows], 1, 0)[:, :, None]
        along_u, along_v = ((1 - s) * p + s * q for s, p, q in ((v[:, None], b - a, d - c), (u[:, None], c - a, d - b)))
        facing = np.cross(along_u, along_v).reshape(-1, 3)
    else:
        facing = between(normals)
    told = np.tile(np.stack([u, v], axis=1), (len(rows), 1)) if uvs is None else between(uvs)
    j, i = np.meshgrid(np.arange(steps), np.arange(steps))
    first = (i * (steps + 1) + j).ravel()
    cells = np.stack([first, first + 1, first + steps + 2, first, first + steps + 2, first + steps + 1], axis=1)
    starts = np.arange(len(rows))[:, None, None] * len(u)
    return _mesh(between(points), (starts + cells).reshape(-1, 3), _unit(facing), told)


def _unit(normals: F64) -> F64:
    """Return normals of length 1; those without a direction point up."""
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(lengths > 1e-12, normals / np.maximum(lengths, 1e-12), (0.0, 1.0, 0.0))


def _mesh(points: F64, faces: npt.ArrayLike, normals: F64 | None, uvs: F64 | None) -> Mesh:
    triangles = np.ascontiguousarray(faces, np.int32)
    return Mesh(
        vertices=np.ascontiguousarray(points, np.float32),
        triangles=triangles,
        material_ids=np.zeros(len(triangles), np.int32),
        normals=None if normals is None else np.ascontiguousarray(normals, np.float32),
        uvs=None if uvs is None else np.ascontiguousarray(uvs, np.float32),
    )


def _sphere(radius: float) -> Mesh:
    """Return a sphere whose poles lie on z; u runs around, v up from 0 to 1."""
    ball = sphere(radius, SEGMENTS)  # its poles lie on y, and its u and v run in metres
    assert ball.normals is not None and ball.uvs is not None
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # z to x, x to y, y to z
    scale = np.float32(1 / (np.pi * radius))
    return replace(
        ball,
        vertices=np.ascontiguousarray(ball.vertices @ turn.T, np.float32),
        normals=np.ascontiguousarray(ball.normals @ turn.T, np.float32),
        uvs=np.ascontiguousarray(ball.uvs * (scale / 2, scale), np.float32),
    )


def _disk(radius: float, height: float) -> Mesh:
    u = np.linspace(0, 1, SEGMENTS + 1)
    rim = np.stack([radius * np.cos(2 * np.pi * u), radius * np.sin(2 * np.pi * u), height + 0 * u], axis=1)
    middle = np.tile((0.0, 0.0, height), (SEGMENTS, 1))
    k = np.arange(SEGMENTS)
    uvs = np.concatenate([np.stack([u, 0 * u], axis=1), np.stack([(u[:-1] + u[1:]) / 2, 0 * k + 1], axis=1)])
    faces = np.stack([k, k + 1, SEGMENTS + 1 + k], axis=1)
    return _mesh(np.concatenate([rim, middle]), faces, None, uvs)


def latitude_longitude(image: F32, from_world: Matrix) -> F32:
    """Resample pbrt's environment image to `EnvironmentMap`'s layout, in the world's own axes.

    Square images are equal-area octahedral (Clarberg, JGT 2008), others latitude-longitude about +z as in pbrt-v3.

    Args:
        image: float32 ``[h, w, 3]``.
        from_world: 3×3 matrix from our world to the light's space.
    """
    h, w = image.shape[:2]
    height = min(max(h // (1 if h != w else 2), 1), 2048)
    v, u = np.meshgrid((np.arange(height) + 0.5) / height, (np.arange(2 * height) + 0.5) / (2 * height), indexing="ij")
    theta, phi = np.pi * v, 2 * np.pi * u
    ours = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)], axis=-1)
    d = ours @ from_world.T
    d /= np.linalg.norm(d, axis=-1, keepdims=True)
    if h == w:
        s, t = _equal_area_square(d)
    else:
        s, t = (np.arctan2(d[..., 1], d[..., 0]) / (2 * np.pi)) % 1, np.arccos(np.clip(d[..., 2], -1, 1)) / np.pi
    rows, columns = np.minimum((t * h).astype(np.int64), h - 1), np.minimum((s * w).astype(np.int64), w - 1)
    return np.ascontiguousarray(image[rows, columns])


def _equal_area_square(d: F64) -> tuple[F64, F64]:
    x, y, z = np.abs(d[..., 0]), np.abs(d[..., 1]), np.abs(d[..., 2])
    r = np.sqrt(np.maximum(1 - z, 0.0))
    larger = np.maximum(x, y)
    angle = np.arctan(np.minimum(x, y) / np.maximum(larger, 1e-30)) * (2 / np.pi)
    angle = np.where(x < y, 1 - angle, angle)
    v = angle * r
    u = r - v
    below = d[..., 2] < 0
    u, v = np.where(below, 1 - v, u), np.where(below, 1 - u, v)
    return (np.copysign(u, d[..., 0]) + 1) / 2, (np.copysign(v, d[..., 1]) + 1) / 2
