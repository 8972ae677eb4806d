"""Meshes and simple bodies of a USD file as triangles, in the space of their prim."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import UsdGeom, UsdShade

from clsim.scene import shapes
from clsim.scene.meshes.geometry import smooth_normals, transformed
from clsim.scene.meshes.polygons import triangulated
from clsim.scene.usd.motion import Shapes
from clsim.scene.usd.stage import Stage
from clsim.scene.usd.surfaces import material_of as bound_material
from clsim.scene.world import F32, Mesh

I64 = npt.NDArray[np.int64]
MAX_CORNERS = 1 << 28
SEGMENTS = 64
"""Round a body: as many as make a sphere of 100 px round to a tenth of a pixel."""
MaterialOf = Callable[[Any, tuple[float, float, float] | None], int]
"""From a prim and its own colour, where it has one for all, to a material's index."""


@dataclass(frozen=True)
class _Faces:
    """A mesh as its file has it.

    Attributes:
        indices: the point of each corner ``[c]``.
        corners: of each triangle, places in ``indices``, ``[m, 3]``.
        faces: the polygon of each triangle ``[m]``.
        count: number of polygons.
        points: number of points.
    """

    indices: I64
    corners: I64
    faces: I64
    count: int
    points: int


@dataclass(frozen=True)
class _Values:
    """What a file tells of a mesh: ``values`` for each of its corners, points or polygons, or for all of it."""

    values: F32
    interpolation: str

    @property
    def by_corner(self) -> bool:
        """Whether points have several."""
        return self.interpolation in ("faceVarying", "uniform")

    def of_corners(self, faces: _Faces) -> F32:
        """Return the value at each triangle's corners ``[3·m, …]``."""
        if self.interpolation == "faceVarying":
            return self.values[faces.corners.ravel()]
        if self.interpolation == "uniform":
            return np.repeat(self.values[faces.faces], 3, axis=0)
        return self.values[faces.indices[faces.corners.ravel()]]


def read_mesh(
    stage: Stage,
    prim: Any,
    uv_name: str,
    color_name: str | None,
    material_of: MaterialOf,
    warn: Callable[[str], None],
    *,
    repeat: bool,
) -> Mesh | None:
    """Return a mesh as triangles, with its materials and, where its points move, its shapes; None where it has none.

    Args:
        stage: the file.
        prim: a ``UsdGeomMesh``.
        uv_name: name of the primvar that its material takes for texture coordinates.
        color_name: name of the primvar that gives it colours; None for none.
        material_of: tells the material of a prim or of a subset of its faces.
        warn: takes what is left out.
        repeat: whether what moves starts anew at the end.
    """
    source = UsdGeom.Mesh(prim)
    points = _array(stage.value(source.GetPointsAttr()), np.float32, 3)
    faces = _faces(stage, source, points, warn)
    if faces is None:
        return None
    normals, uvs = _normals(stage, source, faces), _primvar(stage, prim, uv_name, 2, faces)
    colors = None if color_name is None else _primvar(stage, prim, color_name, 3, faces)
    one_color = None
    bound = bound_material(prim)
    if bound and color_name and colors is None:
        warn(f"{color_name} that a material asks for is missing: white stands for it (first {prim.GetName()})")
    if not bound and colors is not None and (colors.values == colors.values[0]).all():
        r, g, b = np.clip(colors.values[0], 0.0, 1.0).tolist()
        one_color, colors = (r, g, b), None
    ids = _material_ids(stage, prim, faces, lambda each: material_of(each, (1.0, 1.0, 1.0) if colors else one_color))
    told = [each for each in (normals, uvs, colors) if each is not None]
    split = any(each.by_corner for each in told)
    at = faces.indices[faces.corners.ravel()] if split else np.arange(faces.points)
    triangles = np.arange(3 * len(faces.corners)).reshape(-1, 3) if split else faces.indices[faces.corners]
    if stage.value(source.GetOrientationAttr()) == UsdGeom.Tokens.leftHanded:
        triangles = triangles[:, ::-1]

    def spread(told: _Values | None) -> F32 | None:
        if told is None:
            return None
        return np.ascontiguousarray(told.of_corners(faces) if split else told.values)

    mesh = Mesh(
        vertices=np.ascontiguousarray(points[at]),
        triangles=np.ascontiguousarray(triangles, np.int32),
        material_ids=ids,
        normals=_unit(spread(normals)),
        uvs=spread(uvs),
        colors=None if colors is None else np.clip(_filled(spread(colors)), 0.0, 1.0),
    )
    smooth = normals is None and stage.value(source.GetSubdivisionSchemeAttr()) in ("catmullClark", "loop")
    if smooth:
        warn(
            "surfaces that shall be subdivided are rendered as they are, with smooth normals "
            f"(first {prim.GetName()}): subdivide them in the program that made them to see them round"
        )
        # Corners of one point share its normal, whatever else they have.
        whole = replace(mesh, vertices=points, triangles=_oriented(faces, mesh.triangles, split))
        smoothed = smooth_normals(whole).normals
        mesh = replace(mesh, normals=None if smoothed is None else np.ascontiguousarray(smoothed[at]))
    moved = _shapes(stage, source, faces, at, mesh, split=split, smooth=smooth, warn=warn, repeat=repeat)
    return mesh if moved is None else replace(mesh, deformation=moved)


def read_body(stage: Stage, prim: Any, material_of: MaterialOf) -> Mesh | None:
    """Return a sphere, cube, cylinder, cone or capsule as triangles; None where a prim is none of these."""
    kind, mesh = prim.GetTypeName(), None

    def size(name: str) -> float:
        found = abs(float(stage.still(prim.GetAttribute(name)) or 0.0))
        if not math.isfinite(found):
            raise ValueError(f"a {name} of {found}")
        return found

    if kind == "Cube":
        mesh = shapes.box((size("size"),) * 3)
    elif kind == "Sphere":
        mesh = shapes.sphere(size("radius"), SEGMENTS)
    elif kind == "Plane":
        mesh = shapes.quad((size("width"), size("length")))
    elif kind in ("Cylinder", "Cone", "Capsule"):
        mesh = _turned_body(kind, size("radius"), size("height"))
    if mesh is None:
        return None
    axis = str(stage.value(prim.GetAttribute("axis"))) if kind in ("Plane", "Cylinder", "Cone", "Capsule") else "Z"
    color = stage.still(UsdGeom.Gprim(prim).GetDisplayColorAttr())
    r, g, b = np.clip(np.array(color[0]), 0.0, 1.0).tolist() if color else (0.5, 0.5, 0.5)
    material = material_of(prim, (r, g, b) if color else None)
    mesh = replace(mesh, material_ids=np.full(len(mesh.triangles), material, np.int32))
    return transformed(mesh, (_Y_TO if kind == "Plane" else _Z_TO).get(axis, np.eye(3)))


_Z_TO = {"X": np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]), "Y": np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])}
_Y_TO = {"X": _Z_TO["Y"], "Z": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])}
"""Of planes: their width is along x about y and z, and along z about x."""


def _turned_body(kind: str, radius: float, height: float) -> Mesh:
    """Return a body about +z whose middle is the origin, with flat ends and round sides."""
    import trimesh

    if kind == "Cylinder":
        made = trimesh.creation.cylinder(radius=radius, height=height, sections=SEGMENTS)
    elif kind == "Cone":
        made = trimesh.creation.cone(radius=radius, height=height, sections=SEGMENTS)
        made.apply_translation((0.0, 0.0, -height / 2))
    else:
        made = trimesh.creation.capsule(radius=radius, height=height, count=(SEGMENTS // 2, SEGMENTS))
    faces = np.ascontiguousarray(made.faces, np.int32)
    return Mesh(np.ascontiguousarray(made.vertices, np.float32), faces, np.zeros(len(faces), np.int32))


def _faces(stage: Stage, source: Any, points: F32, warn: Callable[[str], None]) -> _Faces | None:
    name = source.GetPath().name
    counts = _whole(stage.value(source.GetFaceVertexCountsAttr()))
    indices = _whole(stage.value(source.GetFaceVertexIndicesAttr()))
    if not (len(points) and len(counts) and len(indices)):
        return None
    if counts.min() < 0 or counts.sum() != len(indices) or len(indices) > MAX_CORNERS:
        warn(f"{name} is left out: its polygons have {counts.sum()} corners, and {len(indices)} are told")
        return None
    if indices.min() < 0 or indices.max() >= len(points):
        wrong = indices.min() if indices.min() < 0 else indices.max()
        warn(f"{name} is left out: a polygon names point {wrong}, of {len(points)}")
        return None
    if not np.isfinite(points).all():
        warn(f"{name} is left out: it has a point that is not finite")
        return None
    holes = _whole(stage.value(source.GetHoleIndicesAttr()))
    corners, of_face = triangulated(points.astype(np.float64), counts, indices)
    kept = ~np.isin(of_face, holes)
    return _Faces(indices, corners[kept], of_face[kept], len(counts), len(points)) if kept.any() else None


def _material_ids(stage: Stage, prim: Any, faces: _Faces, material_of: Callable[[Any], int]) -> npt.NDArray[np.int32]:
    """Return the material of each triangle: that of the mesh, or of the subset that its polygon is in."""
    of_faces = np.full(faces.count, material_of(prim), np.int32)
    for subset in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets():
        chosen = _whole(stage.value(subset.GetIndicesAttr()))
        chosen = chosen[(chosen >= 0) & (chosen < faces.count)]
        of_faces[chosen] = material_of(subset.GetPrim())
    return of_faces[faces.faces]


def _normals(stage: Stage, source: Any, faces: _Faces) -> _Values | None:
    """Return the normals that a file tells; those of surfaces that are to be subdivided do not count (USD)."""
    if stage.value(source.GetSubdivisionSchemeAttr()) in ("catmullClark", "loop"):
        return None
    found = _primvar(stage, source.GetPrim(), "normals", 3, faces)
    if found is None and source.GetNormalsAttr().HasAuthoredValue():
        values = _array(stage.value(source.GetNormalsAttr()), np.float32, 3)
        found = _checked(values, str(source.GetNormalsInterpolation()), faces)
    return found


def _primvar(stage: Stage, prim: Any, name: str, width: int, faces: _Faces) -> _Values | None:
    """Return a primvar, also one that a prim inherits; None where there is none that fits the mesh."""
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
    if not primvar or not primvar.HasValue():
        return None
    if name != "normals":
        stage.still(primvar.GetAttr())
    values = np.array(primvar.ComputeFlattened(stage.start), np.float32)
    values = _array(values[:, :width] if values.ndim == 2 else values, np.float32, width)
    found = _checked(values, str(primvar.GetInterpolation()), faces)
    if found is None:
        stage.warn(f"{name} does not fit its mesh and is left out (first {prim.GetName()})")
    return found


def _checked(values: F32, interpolation: str, faces: _Faces) -> _Values | None:
    if interpolation == "constant" and len(values):
        values, interpolation = np.repeat(values[:1], faces.points, axis=0), "vertex"
    expected = {"faceVarying": len(faces.indices), "uniform": faces.count}.get(interpolation, faces.points)
    if len(values) != expected or not np.isfinite(values).all():
        return None
    return _Values(values, interpolation)


def _shapes(
    stage: Stage,
    source: Any,
    faces: _Faces,
    at: I64,
    mesh: Mesh,
    *,
    split: bool,
    smooth: bool,
    warn: Callable[[str], None],
    repeat: bool,
) -> Shapes | None:
    """Return the shapes of a mesh whose points move; None where it keeps its shape."""
    codes = stage.times(source.GetPointsAttr())
    name = source.GetPath().name
    if stage.times(source.GetFaceVertexCountsAttr()) or stage.times(source.GetFaceVertexIndicesAttr()):
        warn(f"meshes whose polygons change with time keep their first shape (first {name})")
        return None
    if not codes:
        return None
    if not stage.claim(len(codes) * (mesh.vertices.nbytes + (0 if mesh.normals is None else mesh.normals.nbytes))):
        warn(f"{name} keeps its first shape: shapes that change take too much memory")
        return None
    vertices, normals = [], []
    triangles = _oriented(faces, mesh.triangles, split)
    for code in codes:
        points = _array(stage.value(source.GetPointsAttr(), code), np.float32, 3)
        if len(points) != faces.points or not np.isfinite(points).all():
            warn(f"{name} keeps its first shape: it has {len(points)} points at time {code:g}, not {faces.points}")
            return None
        vertices.append(points[at])
        if mesh.normals is None:
            continue
        smoothed = smooth_normals(Mesh(points, triangles, mesh.material_ids)).normals if smooth else None
        if smoothed is None:
            told = _normals_at(stage, source, faces, code)
            smoothed_at = mesh.normals if told is None else (told.of_corners(faces) if split else told.values)
        else:
            smoothed_at = smoothed[at]
        normals.append(smoothed_at)
    times_s = tuple(stage.seconds(code) for code in codes)
    return Shapes(times_s, np.array(vertices), np.array(normals) if normals else None, repeat)


def _normals_at(stage: Stage, source: Any, faces: _Faces, code: float) -> _Values | None:
    primvar = UsdGeom.PrimvarsAPI(source.GetPrim()).GetPrimvar("normals")
    if primvar and primvar.HasValue():
        values = _array(primvar.ComputeFlattened(code), np.float32, 3)
        return _checked(values, str(primvar.GetInterpolation()), faces)
    values = _array(stage.value(source.GetNormalsAttr(), code), np.float32, 3)
    return _checked(values, str(source.GetNormalsInterpolation()), faces)


def _oriented(faces: _Faces, triangles: npt.NDArray[np.int32], split: bool) -> npt.NDArray[np.int32]:
    """Return triangles of points, where those of a mesh may be of corners."""
    return faces.indices[faces.corners.ravel()][triangles].astype(np.int32) if split else triangles


def _array(value: Any, dtype: Any, width: int) -> npt.NDArray[Any]:
    """Return an array of USD as ``[n, width]``; what has another width has no rows."""
    found = np.array(value if value is not None else [], dtype)
    return np.ascontiguousarray(
        found.reshape(-1, width) if found.ndim == 2 and found.shape[1] == width else found[:0].reshape(0, width)
    )


def _whole(value: Any) -> I64:
    return np.array(value if value is not None else [], np.int64).ravel()


def _unit(normals: F32 | None) -> F32 | None:
    if normals is None:
        return None
    lengths = np.linalg.norm(normals.astype(np.float64), axis=1, keepdims=True)
    return np.where(lengths > 1e-12, normals / np.maximum(lengths, 1e-12), (0.0, 1.0, 0.0)).astype(np.float32)


def _filled(values: F32 | None) -> F32:
    return np.zeros((0, 3), np.float32) if values is None else values
