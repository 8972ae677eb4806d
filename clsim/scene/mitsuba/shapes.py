"""Mitsuba's shapes as meshes, with its texture coordinates turned round so that v points up."""

from __future__ import annotations

import struct
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.scene.meshes.geometry import smooth_normals, transformed, with_corner_uvs
from clsim.scene.meshes.trimesh_scene import load_triangles
from clsim.scene.mitsuba.values import file_of
from clsim.scene.mitsuba.xml import Plugin
from clsim.scene.motion import Matrix
from clsim.scene.rigid import across
from clsim.scene.world import Mesh

F64 = npt.NDArray[np.float64]
CORNER_UVS = ((0.0, 1.0), (1.0, 1.0), (0.0, 0.0))
"""Texture coordinates, v up, of the corners of a triangle that has none of its own."""
SEGMENTS = 64
"""How finely round shapes are divided around."""
MAX_UNPACKED = 1 << 30


def is_turned(shape: Plugin, linear: Matrix, legacy: bool) -> bool:
    """Tell whether a shape faces the other way: also a sphere that a 3×3 matrix mirrors does, since version 3."""
    mirrored = shape.type == "sphere" and not legacy and float(np.linalg.det(linear)) < 0
    return bool(shape.get("flip_normals", False)) != mirrored


def read_shape(shape: Plugin, root: Path, linear: Matrix, *, legacy: bool) -> Mesh | None:
    """Return a shape's mesh with a 3×3 matrix applied; None where clsim lacks the shape.

    A mirror leaves the order of a file's vertices as it is and so turns it inside out, as in Mitsuba, unless the file
    has normals that tell which side is out.

    Raises:
        InputError: with file and line.
    """
    faceted = bool(shape.get("face_normals", False))
    if shape.type in ("obj", "ply"):
        mesh = load_triangles(file_of(shape.place, shape.get("filename", ""), root))
        flip = not shape.get("flip_tex_coords", shape.type == "obj")
        if flip and mesh.uvs is not None:
            mesh = replace(mesh, uvs=_down(mesh.uvs))
    elif shape.type == "serialized":
        path = file_of(shape.place, shape.get("filename", ""), root)
        mesh, told = read_serialized(path, int(shape.get("shape_index", 0.0)))
        faceted = faceted or told
    elif shape.type == "rectangle":
        mesh = _rectangle()
    elif shape.type == "cube":
        mesh = _cube()
    elif shape.type == "sphere":
        mesh = _sphere(shape)
    elif shape.type == "disk":
        mesh = _disk()
    elif shape.type == "cylinder":
        mesh = _cylinder(shape)
    else:
        return None
    bare = shape.type in ("obj", "ply", "serialized") and mesh.normals is None
    mesh, mirrored = transformed(mesh, linear), float(np.linalg.det(linear)) < 0
    if bare and mirrored:
        mesh = replace(mesh, triangles=np.ascontiguousarray(mesh.triangles[:, ::-1]))
    if faceted:
        mesh = replace(mesh, normals=None)
    elif bare:
        mesh = smooth_normals(mesh)
    turned = is_turned(shape, linear, legacy)
    if turned:
        normals = None if mesh.normals is None else -mesh.normals
        mesh = replace(mesh, triangles=np.ascontiguousarray(mesh.triangles[:, ::-1]), normals=normals)
    if mesh.uvs is None and _has_texture(shape):
        backwards = turned != (mirrored and not bare)
        mesh = with_corner_uvs(mesh, CORNER_UVS[::-1] if backwards else CORNER_UVS)
    return mesh


def _has_texture(plugin: Plugin) -> bool:
    return any(child.kind == "texture" or _has_texture(child) for child in plugin.children)


def read_serialized(path: Path, index: int) -> tuple[Mesh, bool]:
    """Read one mesh of Mitsuba 0.6's serialized format: a zlib stream each, a table of offsets at the end.

    Returns:
        The mesh, and whether the file asks for face normals, as ``face_normals`` of a shape does.

    Raises:
        InputError: naming the file, if it is damaged.
    """
    data = path.read_bytes()
    wrong = f"{path}: is not a serialized mesh or ends early"
    try:
        (count,) = struct.unpack_from("<I", data, len(data) - 4)
        if not 0 <= index < count:
            raise InputError(f"{path}: has {count} meshes, expected one of index {index}")
        form, version = struct.unpack_from("<HH", data)
        width = 8 if version >= 4 else 4
        (start,) = struct.unpack_from("<Q" if width == 8 else "<I", data, len(data) - 4 - width * (count - index))
        form, version = struct.unpack_from("<HH", data, start)
        if form != 0x041C or version not in (3, 4):
            raise InputError(f"{wrong} (format {form:#x}, version {version})")
        body = zlib.decompressobj().decompress(data[start + 4 :], MAX_UNPACKED)
        (flags,) = struct.unpack_from("<I", body)
        at = 4
        if version == 4:
            at = body.index(b"\0", at) + 1
        vertices, triangles = struct.unpack_from("<QQ", body, at)
        at += 16
        real = np.dtype("<f8" if flags & 0x2000 else "<f4")

        def floats(width: int) -> F64:
            nonlocal at
            found = np.frombuffer(body, real, vertices * width, at).reshape(vertices, width)
            at += found.nbytes
            return found.astype(np.float64)

        if max(vertices, triangles) * 12 > len(body):
            raise InputError(f"{wrong} ({vertices} vertices and {triangles} triangles in {len(body)} bytes)")
        points = floats(3)
        normals = floats(3) if flags & 1 else None
        uvs = floats(2) if flags & 2 else None
        if flags & 8:
            floats(3)  # colours
        kind = np.dtype("<u8" if vertices > 0xFFFFFFFF else "<u4")
        faces = np.frombuffer(body, kind, triangles * 3, at).reshape(-1, 3)
    except (struct.error, zlib.error, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{wrong} ({error})") from None
    if len(faces) and faces.max() >= vertices:
        raise InputError(f"{path}: a triangle uses vertex {faces.max()}, expected 0 to {vertices - 1}")
    return _mesh(points, faces, normals, uvs), bool(flags & 0x10)


def _down(uvs: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    return np.ascontiguousarray(np.stack([uvs[:, 0], 1 - uvs[:, 1]], axis=1), np.float32)


def _mesh(vertices: npt.ArrayLike, triangles: npt.ArrayLike, normals: F64 | None, uvs: F64 | None) -> Mesh:
    """Return a mesh of material 0; ``uvs`` as Mitsuba has them, with v down."""
    faces = np.ascontiguousarray(triangles, np.int32).reshape(-1, 3)
    return Mesh(
        vertices=np.ascontiguousarray(vertices, np.float32),
        triangles=faces,
        material_ids=np.zeros(len(faces), np.int32),
        normals=None if normals is None else np.ascontiguousarray(normals, np.float32),
        uvs=None if uvs is None else _down(np.asarray(uvs, np.float32)),
    )


def _rectangle() -> Mesh:
    corners = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    points = np.column_stack([corners, np.zeros(4)])
    return _mesh(points, [(0, 1, 2), (0, 2, 3)], None, (corners + 1) / 2)


def _cube() -> Mesh:
    """Return the cube from −1 to 1; u and v run along the axes that Mitsuba gives each face."""
    faces = [  # normal, direction of u, direction of v; u × v is the normal or its opposite
        ((0, 0, 1), (0, 1, 0), (1, 0, 0)),
        ((1, 0, 0), (0, 1, 0), (0, 0, -1)),
        ((0, 1, 0), (-1, 0, 0), (0, 0, -1)),
        ((0, 0, -1), (0, -1, 0), (1, 0, 0)),
        ((-1, 0, 0), (0, 1, 0), (0, 0, 1)),
        ((0, -1, 0), (0, 0, 1), (1, 0, 0)),
    ]
    points: list[F64] = []
    triangles: list[list[int]] = []
    uvs: list[tuple[int, int]] = []
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    for normal, along_u, along_v in faces:
        first = len(points)
        n, u, v = (np.array(axis, np.float64) for axis in (normal, along_u, along_v))
        points += [n + (2 * a - 1) * u + (2 * b - 1) * v for a, b in square]
        uvs += square
        outwards = float(np.cross(u, v) @ n) > 0
        for triangle in ((0, 1, 2), (0, 2, 3)):
            order = triangle if outwards else triangle[::-1]
            triangles.append([first + k for k in order])
    return _mesh(np.array(points), triangles, None, np.array(uvs, np.float64))


def _grid(rows: int, columns: int) -> npt.NDArray[np.int64]:
    """Return the triangles of a grid of (rows + 1)·(columns + 1) points."""
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a = (i * (columns + 1) + j).ravel()
    b = a + columns + 1
    return np.concatenate([np.stack([a, b, b + 1], axis=1), np.stack([a, b + 1, a + 1], axis=1)])


def _sphere(shape: Plugin) -> Mesh:
    center, radius = shape.get("center", np.zeros(3)), shape.get("radius", 1.0)
    if radius <= 0:
        raise InputError(f"{shape.place}: the sphere's radius is {radius:g}, expected more than 0")
    rows = SEGMENTS // 2
    v, u = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, SEGMENTS + 1), indexing="ij")
    theta, phi = np.pi * v, 2 * np.pi * u
    normals = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1).reshape(-1, 3)
    mesh = _mesh(center + radius * normals, _grid(rows, SEGMENTS), normals, np.stack([u.ravel(), v.ravel()], axis=1))
    return _without_slivers(mesh)


def _disk() -> Mesh:
    r, u = np.meshgrid([0.0, 1.0], np.linspace(0, 1, SEGMENTS + 1), indexing="ij")
    points = np.stack([r * np.cos(2 * np.pi * u), r * np.sin(2 * np.pi * u), 0 * r], axis=-1).reshape(-1, 3)
    return _without_slivers(_mesh(points, _grid(1, SEGMENTS), None, np.stack([r.ravel(), u.ravel()], axis=1)))


def _cylinder(shape: Plugin) -> Mesh:
    start, end = shape.get("p0", np.zeros(3)), shape.get("p1", np.array((0.0, 0.0, 1.0)))
    if np.allclose(start, end):
        raise InputError(f"{shape.place}: the cylinder's ends p0 and p1 coincide")
    axis = (end - start) / np.linalg.norm(end - start)
    frame: Matrix = np.column_stack([across(axis), np.cross(axis, across(axis)), axis])
    v, u = np.meshgrid([0.0, 1.0], np.linspace(0, 1, SEGMENTS + 1), indexing="ij")
    normals = np.stack([np.cos(2 * np.pi * u), np.sin(2 * np.pi * u), 0 * u], axis=-1).reshape(-1, 3) @ frame.T
    points = start + shape.get("radius", 1.0) * normals + v.reshape(-1, 1) * (end - start)
    triangles = _grid(1, SEGMENTS)[:, ::-1]
    return _mesh(points, triangles, normals, np.stack([u.ravel(), v.ravel()], axis=1))


def _without_slivers(mesh: Mesh) -> Mesh:
    """Leave out the triangles that the poles and the centre squeeze to nothing."""
    corners = mesh.vertices.astype(np.float64)[mesh.triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    kept = area > 1e-6 * area.max()
    return replace(mesh, triangles=mesh.triangles[kept], material_ids=mesh.material_ids[kept])
