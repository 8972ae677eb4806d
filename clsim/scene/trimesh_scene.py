"""Mesh files (OBJ, PLY, glTF) through trimesh: base colours, no animation; bare files get a lamp and a camera."""

from __future__ import annotations

import io
import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.scene.files import inside_folder
from clsim.scene.geometry import placed_rigidly
from clsim.scene.motion import Matrix, Orbit, Static, compose
from clsim.scene.world import Camera, Instance, Material, Mesh, SphereLight, Vec3, World

MAX_FILE_BYTES = 1 << 30
MAX_PIXELS = 1 << 26
"""Largest texture that is decoded; its packed size tells nothing about its memory."""
MAX_COORDINATE = 1e15
"""Farther out, squares of distances overflow in 32 bits."""
F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Placement:
    """Where a mesh of a file stands: any affine matrix, also one that stretches or mirrors."""

    mesh: int
    matrix: Matrix
    name: str


@dataclass(frozen=True)
class Parts:
    """What a mesh file holds; material ids count from the file's own first material."""

    meshes: list[Mesh]
    materials: list[Material]
    placements: list[Placement]
    warnings: list[str]


def load_bare(path: Path) -> World:
    """Load a mesh file as a whole scene: a lamp and a dim environment light it, and the camera orbits around it.

    Both are framed on the bounding box, whatever the file's units.

    Raises:
        InputError: if the file cannot be used.
    """
    parts = load_parts(path)
    meshes = list(parts.meshes)
    instances = []
    for placement in parts.placements:
        index, matrix = placed_rigidly(meshes, placement.mesh, placement.matrix)
        instances.append(Instance(index, Static(matrix), placement.name))
    center, size = _bounds(path, meshes, instances)
    (x, y, z), radius = center, float(np.linalg.norm(size)) / 2
    lamp = SphereLight(
        radius_m=0.5 * radius,
        radiance=(30.0, 28.8, 27.0),
        motion=Static(compose((x + 1.5 * radius, y + 2.5 * radius, z + 1.5 * radius), np.eye(3))),
    )
    camera = _orbiting_camera(center, size)
    return World(
        name=path.stem,
        camera=camera,
        meshes=tuple(meshes),
        instances=tuple(instances),
        materials=tuple(parts.materials),
        sphere_lights=(lamp,),
        environment=(0.5, 0.5, 0.5),
        duration_s=camera.motion.duration_s,
        warnings=tuple(parts.warnings),
    )


def load_parts(path: Path) -> Parts:
    """Load the meshes of a file, their colours and places; units are kept.

    Raises:
        InputError: one sentence that names the file and what is wrong with it.
    """
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise InputError(f"{path}: is larger than {MAX_FILE_BYTES >> 30} GiB, expected a smaller mesh file")
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    suffix = path.suffix.lower()
    notes: list[str] = []
    declared: dict[str, int] = {}
    if suffix in (".gltf", ".glb"):
        from clsim.scene.gltf import check_gltf

        notes = check_gltf(path, data)
    elif suffix == ".ply":
        from clsim.scene.ply import check_ply

        declared = check_ply(path, data)
    elif suffix != ".obj":
        raise InputError(f"{path}: its name ends in {suffix or 'nothing'}, expected .obj, .ply, .gltf or .glb")
    scene = _read(path, data, suffix)
    meshes: list[Mesh] = []
    materials: list[Material] = []
    indices: dict[str, int] = {}
    for name, geometry in scene.geometry.items():
        if not hasattr(geometry, "faces"):
            notes.append(f"{path.name}: {name} has points or lines only and is left out")
            continue
        if len(geometry.vertices) < declared.get("vertex", 0) or len(geometry.faces) < declared.get("face", 0):
            raise InputError(f"{path}: ends before its {declared['vertex']} vertices and all faces: it is truncated")
        indices[name] = len(meshes)
        meshes.append(_mesh(path, name, geometry, len(materials)))
        materials.append(_material(path, name, geometry, notes))
    placements = []
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        if name in indices:
            placements.append(Placement(indices[name], np.asarray(matrix, np.float64), str(name)))
    # trimesh draws the names of some nodes at random, and with them their order.
    placements.sort(key=lambda placement: (placement.mesh, placement.matrix.tobytes()))
    if not placements:
        raise InputError(f"{path}: has no triangles, expected a mesh")
    return Parts(meshes, materials, placements, notes)


def _read(path: Path, data: bytes, suffix: str) -> Any:
    import trimesh

    resolver = _FolderResolver(path.parent)
    files: Any = resolver  # trimesh needs no more of a resolver than get and []
    try:
        with warnings.catch_warnings():
            # Older numpy only warns about text that is no number, and stops there: the rest of the file would be lost.
            warnings.filterwarnings("error", message="string or file could not be read")
            scene = trimesh.load_scene(io.BytesIO(data), file_type=suffix[1:], resolver=files, process=False)
    except Exception as error:  # trimesh raises whatever its parsers stumble over
        if resolver.refused:
            raise InputError(f"{path}: {resolver.refused[0]}") from None
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise InputError(f"{path}: cannot be read as {suffix[1:].upper()} ({reason})") from None
    if resolver.refused:
        raise InputError(f"{path}: {resolver.refused[0]}")
    return scene


class _FolderResolver:
    """Gives trimesh the files beside the mesh and no others; trimesh swallows errors here, so they are kept."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.refused: list[str] = []

    def get(self, name: str) -> bytes:
        try:
            file = self.folder / inside_folder(name, self.folder)
            if file.is_file() and file.stat().st_size > MAX_FILE_BYTES:
                raise InputError(f"{name!r} is larger than {MAX_FILE_BYTES >> 30} GiB")
        except InputError as error:
            self.refused.append(str(error))
            raise
        return file.read_bytes()

    def __getitem__(self, name: str) -> bytes:
        return self.get(name)


def _mesh(path: Path, name: str, geometry: Any, material: int) -> Mesh:
    vertices = np.asarray(geometry.vertices, np.float64)
    faces = np.asarray(geometry.faces)
    if len(faces) and not (faces.min() >= 0 and faces.max() < len(vertices)):
        wrong = faces[(faces < 0) | (faces >= len(vertices))][0]
        raise InputError(f"{path}: mesh {name}: a triangle uses vertex {wrong}, expected 0 to {len(vertices) - 1}")
    if len(faces) and not np.isfinite(vertices).all():
        bad = int(np.flatnonzero(~np.isfinite(vertices).all(axis=1))[0])
        value = ", ".join(f"{x:g}" for x in vertices[bad])
        raise InputError(f"{path}: mesh {name}: vertex {bad} is ({value}), expected finite numbers")
    # Only normals that came with the file stand in the cache here; asking for others would invent smooth ones.
    normals = np.array(geometry.vertex_normals, np.float64) if "vertex_normals" in geometry._cache else None
    if normals is not None:
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = np.where(lengths > 1e-12, normals / np.maximum(lengths, 1e-12), (0.0, 1.0, 0.0))
    uvs = _uvs(geometry)
    return Mesh(
        vertices=np.ascontiguousarray(vertices, np.float32),
        triangles=np.ascontiguousarray(faces, np.int32),
        material_ids=np.full(len(faces), material, np.int32),
        normals=None if normals is None else np.ascontiguousarray(normals, np.float32),
        uvs=None if uvs is None else np.ascontiguousarray(uvs, np.float32),
    )


def _uvs(geometry: Any) -> F64 | None:
    uvs = getattr(geometry.visual, "uv", None)
    if uvs is None or np.shape(uvs) != (len(geometry.vertices), 2):
        return None
    return np.nan_to_num(np.asarray(uvs, np.float64), nan=0.0, posinf=0.0, neginf=0.0)


def _material(path: Path, name: str, geometry: Any, notes: list[str]) -> Material:
    """Return the diffuse part of a material; textures are averaged over the surface they cover."""
    visual = geometry.visual
    source = getattr(visual, "material", None)
    if source is None or _is_placeholder(source):
        if visual.kind not in ("vertex", "face"):
            return Material()
        colors = np.asarray(visual.vertex_colors if visual.kind == "vertex" else visual.face_colors)[:, :3]
        return Material(color=_vec3(_linear(colors / 255.0).mean(axis=0)))
    color = np.ones(3)
    image = getattr(source, "baseColorTexture", None) or getattr(source, "image", None)
    factor = getattr(source, "baseColorFactor", None)
    kd = getattr(source, "kwargs", {}).get("kd")  # trimesh rounds its own copy to 8 bits
    if factor is not None:
        factor_array = np.asarray(factor)
        color = factor_array[:3] / (255.0 if factor_array.dtype.kind in "iu" else 1.0)
    elif isinstance(kd, list) and len(kd) == 3:
        color = np.asarray(kd, np.float64)
    elif image is None and not hasattr(source, "baseColorFactor"):
        color = np.full(3, 0.5)
    if image is not None:
        color = color * _average(path, name, image, geometry, notes)
    emission: Vec3 = (0.0, 0.0, 0.0)
    if getattr(source, "emissiveFactor", None) is not None:
        if getattr(source, "emissiveTexture", None) is None:
            emission = _vec3(np.asarray(source.emissiveFactor, np.float64))
        else:
            notes.append(f"{path.name}: the emissive texture of {name} is left out")
    return Material(color=_vec3(np.clip(np.nan_to_num(color), 0.0, 1.0)), emission=emission)


def _is_placeholder(source: Any) -> bool:
    """Tell whether trimesh made this material up because the file has only u and v: its image is from no file."""
    image = getattr(source, "image", None)
    return image is not None and image.format is None and not source.kwargs


def _average(path: Path, name: str, image: Any, geometry: Any, notes: list[str]) -> F64:
    """Return the mean linear colour of a texture over the triangles, weighted by their areas."""
    width, height = image.size
    if width * height > MAX_PIXELS:
        raise InputError(f"{path}: the texture of {name} is {width}×{height}, expected at most {MAX_PIXELS} pixels")
    try:
        texels = np.asarray(image.convert("RGB"))
    except Exception as error:  # Pillow raises whatever its decoders stumble over
        notes.append(f"{path.name}: the texture of {name} cannot be decoded ({error}); white stands in")
        return np.ones(3)
    uvs = _uvs(geometry)
    corners = np.asarray(geometry.vertices)[geometry.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    if uvs is None or not areas.sum() > 0:
        mean: F64 = _linear(texels[:: max(1, height // 512), :: max(1, width // 512)] / 255.0).mean(axis=(0, 1))
        return mean
    center = uvs[geometry.faces].mean(axis=1) % 1.0
    column = np.minimum((center[:, 0] * width).astype(np.int64), width - 1)
    row = np.minimum(((1.0 - center[:, 1]) * height).astype(np.int64), height - 1)
    weighted: F64 = areas @ _linear(texels[row, column] / 255.0) / areas.sum()
    return weighted


def _linear(srgb: F64) -> F64:
    """Decode sRGB (IEC 61966-2-1)."""
    decoded: F64 = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return decoded


def _vec3(values: F64) -> Vec3:
    return float(values[0]), float(values[1]), float(values[2])


def _bounds(path: Path, meshes: list[Mesh], instances: list[Instance]) -> tuple[Vec3, F64]:
    """Return the centre and the size of the bounding box."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for instance in instances:
        mesh, matrix = meshes[instance.mesh], instance.motion.pose(0.0)
        used = mesh.vertices[np.unique(mesh.triangles)].astype(np.float64)
        if len(used):
            points = used @ matrix[:3, :3].T + matrix[:3, 3]
            low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
    farthest = float(np.maximum(np.abs(low), np.abs(high)).max())
    if not ((low < high).any() and farthest < MAX_COORDINATE):
        raise InputError(f"{path}: has no extent, expected triangles that span a finite space")
    return _vec3((low + high) / 2), high - low


def _orbiting_camera(center: Vec3, size: F64) -> Camera:
    """Return a camera that turns around a bounding box in 6 s, 20° above its middle, and just sees all of it."""
    width, height, fov_deg = 346, 260, 45.0
    right_limit = math.tan(math.radians(fov_deg / 2))
    up_limit = right_limit * height / width
    elevation = math.radians(20.0)
    corners = size / 2 * np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3), axis=-1).reshape(-1, 3)
    angle = np.linspace(0, 2 * np.pi, 72, endpoint=False)[:, None]
    right = corners[:, 0] * np.cos(angle) - corners[:, 2] * np.sin(angle)
    ahead = corners[:, 0] * np.sin(angle) + corners[:, 2] * np.cos(angle)
    up = corners[:, 1] * math.cos(elevation) - ahead * math.sin(elevation)
    near = corners[:, 1] * math.sin(elevation) + ahead * math.cos(elevation)
    # A corner is in view where |right| and |up| are at most its distance times the limit.
    distance = 1.05 * float((near + np.maximum(np.abs(right) / right_limit, np.abs(up) / up_limit)).max())
    orbit = Orbit(
        center=center,
        radius_m=distance * math.cos(elevation),
        period_s=6.0,
        height_m=distance * math.sin(elevation),
        target=center,
    )
    return Camera(width, height, fov_deg, orbit)
