"""Mesh files (OBJ, PLY) through trimesh, with the colours and textures of their materials."""

from __future__ import annotations

import contextlib
import io
import re
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.scene.defaults.framing import ENVIRONMENT, ORBIT_S, bounds, lamp, orbiting_camera
from clsim.scene.defaults.indoors import stand_inside
from clsim.scene.meshes.beside import MAX_FILE_BYTES, FolderResolver, as_utf8
from clsim.scene.meshes.geometry import joined
from clsim.scene.meshes.obj_lines import checked_lines, left_out, plain_lines
from clsim.scene.meshes.obj_plain import read_plain_obj, unit_normals
from clsim.scene.motion import Static, compose
from clsim.scene.parts import Parts
from clsim.scene.pictures.images import PixelBudget, decode_srgb, unpack_rgba
from clsim.scene.world import IDENTITY, ImageTexture, Instance, Material, Mesh, Texture, Vec3, World
from clsim.values import unzipped

F64 = npt.NDArray[np.float64]
_LEFT_OUT = {
    **dict.fromkeys(("d", "map_d"), ("opacity", 1.0)),
    **dict.fromkeys(("tr", "map_tr"), ("opacity", 0.0)),
    **dict.fromkeys(("pr", "map_pr"), ("gloss", 1.0)),
    **dict.fromkeys(("ks", "map_ks", "pm", "map_pm", "pc", "ps", "aniso", "refl"), ("gloss", 0.0)),
    **dict.fromkeys(("bump", "map_bump", "norm", "disp", "map_kn"), ("relief", 0.0)),
    "map_ke": ("glow by an image", 0.0),
}
"""What materials may ask for, by key, and the number that does not ask for it."""
_ROUNDING = 1e-5
"""By how much of a file's size 32 bits may round its vertices: some hundredths of a pixel."""


def load_bare(path: Path) -> World:
    """Load a mesh file as a whole scene: a lamp and a dim environment light it, and the camera orbits around it.

    Both are framed on the bounding box, whatever the file's units.

    Raises:
        InputError: if the file cannot be used.
    """
    parts = load_parts(path)
    center, size = bounds(path, parts.meshes, parts.instances)
    camera, light, notes = orbiting_camera(center, size), lamp(center, size), []
    if inside := stand_inside(parts.meshes, parts.instances, center, size, ORBIT_S):
        camera, light, why = inside
        notes = [f"{path.name}: {why}"]
    return World(
        name=path.stem,
        camera=camera,
        meshes=tuple(parts.meshes),
        instances=tuple(parts.instances),
        materials=tuple(parts.materials),
        textures=tuple(parts.textures),
        sphere_lights=(light,),
        environment=ENVIRONMENT,
        duration_s=camera.motion.duration_s,
        warnings=tuple(parts.warnings),
        notes=tuple(notes),
    )


def load_parts(path: Path) -> Parts:
    """Load the meshes of a file and their materials; units are kept.

    Raises:
        InputError: one sentence that names the file and what is wrong with it.
    """
    notes: list[str] = []
    reader = _Materials(path, notes)
    meshes: list[Mesh] = []
    instances: list[Instance] = []
    geometries = _geometries(path, notes, materials=True)
    origin = _origin(geometries)
    place = Static(compose(origin, np.eye(3))) if origin.any() else IDENTITY
    for name, geometry in geometries.items():
        instances.append(Instance(len(meshes), place, name))
        meshes.append(_mesh(path, name, geometry, len(reader.materials), origin))
        reader.materials.append(reader.read(name, geometry))
    return Parts(meshes, reader.materials, reader.textures, instances, warnings=notes)


def load_triangles(path: Path) -> Mesh:
    """Load a file as one mesh, all of material 0; its materials are not read.

    Raises:
        InputError: as `load_parts`.
    """
    if path.suffix.lower() == ".obj" and (plain := read_plain_obj(_data(path))):
        return plain
    geometries = _geometries(path, [], materials=False)
    meshes = [replace(_mesh(path, name, geometry, 0), colors=None) for name, geometry in geometries.items()]
    return meshes[0] if len(meshes) == 1 else joined(meshes)


def _data(path: Path) -> bytes:
    try:
        zipped = path.suffix == ".gz"
        data = unzipped(path, MAX_FILE_BYTES) if zipped else b""
        if max(len(data), path.stat().st_size) > MAX_FILE_BYTES:
            raise InputError(f"{path}: is larger than {MAX_FILE_BYTES >> 30} GiB, expected a smaller mesh file")
        return data if zipped else path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None


def _geometries(path: Path, notes: list[str], *, materials: bool) -> dict[str, Any]:
    """Return trimesh's meshes of a file by name."""
    data = _data(path)
    suffix = Path(path.name.removesuffix(".gz")).suffix.lower()
    libraries: list[str] = []
    declared: dict[str, int] = {}
    if suffix == ".ply":
        from clsim.scene.meshes.ply import check_ply, even_faces, usual_names
        from clsim.scene.meshes.ply_text import without_concave

        check_ply(path, data)
        data = without_concave(even_faces(usual_names(data)))
        declared = check_ply(path, data)
    elif suffix == ".obj":
        data = plain_lines(path, as_utf8(data))
        libraries = [name.decode().strip() for name in re.findall(rb"(?m)^\s*mtllib[ \t]+(.+)$", data)]
    else:
        raise InputError(f"{path}: its name ends in {suffix or 'nothing'}, expected .obj or .ply")
    resolver = FolderResolver(path.parent, libraries)
    found = {}
    for name, geometry in _read(path, data, suffix, resolver, materials=materials).geometry.items():
        if not hasattr(geometry, "faces"):
            notes.append(f"{path.name}: {name} has points or lines only and is left out")
            continue
        if np.shape(geometry.vertices)[1:] != (3,):
            checked_lines(path, data)
            raise InputError(f"{path}: not all of its vertices have as many numbers, expected three of each")
        if len(geometry.vertices) < declared.get("vertex", 0) or len(geometry.faces) < declared.get("face", 0):
            raise InputError(f"{path}: ends before its {declared['vertex']} vertices and all faces: it is truncated")
        if len(geometry.faces):
            found[str(name)] = geometry
        else:
            notes.append(f"{path.name}: {name} has no triangles and is left out")
    if not found:
        if suffix == ".obj":
            checked_lines(path, data)
        raise InputError(f"{path}: has no triangles, expected a mesh")
    if materials:
        asked = left_out(data) if suffix == ".obj" else []
        notes += [f"{path.name}: {sentence}" for sentence in (*resolver.lacking, *resolver.left_out, *asked)]
        if suffix == ".obj" and not resolver.lacking:
            wanted = {
                name.decode("utf-8", "replace").strip() for name in re.findall(rb"(?m)^\s*usemtl[ \t]+(.+)$", data)
            }
            notes += [
                f"{path.name}: there is no material {name}; grey stands in" for name in sorted(wanted - resolver.known)
            ]
    return found


def _read(path: Path, data: bytes, suffix: str, resolver: FolderResolver, *, materials: bool) -> Any:
    import trimesh

    files: Any = resolver  # trimesh needs no more of a resolver than get and []
    log = trimesh.util.log  # it prints errors that are told here as warnings
    silent, log.disabled = log.disabled, True
    options: dict[str, Any] = {"skip_materials": True} if suffix == ".obj" and not materials else {}
    try:
        with warnings.catch_warnings():
            # Older numpy only warns about text that is no number, and stops there: the rest of the file would be lost.
            warnings.filterwarnings("error", message="string or file could not be read")
            scene = trimesh.load_scene(io.BytesIO(data), file_type=suffix[1:], resolver=files, process=False, **options)
    except Exception as error:  # trimesh raises whatever its parsers stumble over
        if resolver.refused:
            raise InputError(f"{path}: {resolver.refused[0]}") from None
        if suffix == ".obj":
            checked_lines(path, data)
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise InputError(f"{path}: cannot be read as {suffix[1:].upper()} ({reason})") from None
    finally:
        log.disabled = silent
    if resolver.refused:
        raise InputError(f"{path}: {resolver.refused[0]}")
    return scene


def _origin(geometries: dict[str, Any]) -> F64:
    """Return the point that vertices are told from: the middle of all, where 32 bits could not tell them from 0 on.

    Surveyed places are in coordinates of millions of metres.
    """
    all_vertices = [np.asarray(each.vertices, np.float64) for each in geometries.values() if len(each.vertices)]
    if not all_vertices:
        return np.zeros(3)
    low = np.min([vertices.min(axis=0) for vertices in all_vertices], axis=0)
    high = np.max([vertices.max(axis=0) for vertices in all_vertices], axis=0)
    far = np.maximum(abs(low), abs(high)).max()
    if not np.isfinite(far) or np.finfo(np.float32).eps * far < _ROUNDING * (high - low).max():
        return np.zeros(3)
    return np.asarray((low + high) / 2)


def _mesh(path: Path, name: str, geometry: Any, material: int, origin: F64 | float = 0.0) -> Mesh:
    try:
        return mesh_of(name, geometry, material, origin)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def mesh_of(name: str, geometry: Any, material: int = 0, origin: F64 | float = 0.0) -> Mesh:
    """Return a mesh of trimesh as one of ours, from an origin on, with the normals that came with its file, if any.

    Raises:
        InputError: a vertex is not finite, or a triangle names none; the message says in which mesh.
    """
    vertices = np.asarray(geometry.vertices, np.float64)
    faces = np.asarray(geometry.faces)
    if len(faces) and not (faces.min() >= 0 and faces.max() < len(vertices)):
        wrong = faces[(faces < 0) | (faces >= len(vertices))][0]
        raise InputError(f"mesh {name}: a triangle uses vertex {wrong}, expected 0 to {len(vertices) - 1}")
    if len(faces) and not np.isfinite(vertices).all():
        bad = int(np.flatnonzero(~np.isfinite(vertices).all(axis=1))[0])
        value = ", ".join(f"{x:g}" for x in vertices[bad])
        raise InputError(f"mesh {name}: vertex {bad} is ({value}), expected finite numbers")
    # Only normals that came with the file stand in the cache here; asking for others would invent smooth ones.
    normals = np.array(geometry.vertex_normals, np.float64) if "vertex_normals" in geometry._cache else None
    uvs = _uvs(geometry)
    return Mesh(
        vertices=np.ascontiguousarray(vertices - origin, np.float32),
        triangles=np.ascontiguousarray(faces, np.int32),
        material_ids=np.full(len(faces), material, np.int32),
        normals=None if normals is None else unit_normals(normals),
        uvs=None if uvs is None else np.ascontiguousarray(uvs, np.float32),
        colors=_colors(geometry),
    )


def _colors(geometry: Any) -> npt.NDArray[np.float32] | None:
    """Return the colours of vertices, which files hold in sRGB; None where all are one, which is the material's."""
    if geometry.visual.kind != "vertex" or _has_material(geometry.visual):
        return None
    colors = np.asarray(geometry.visual.vertex_colors)[:, :3]
    if len(colors) != len(geometry.vertices) or not len(colors) or (colors == colors[0]).all():
        return None
    return np.ascontiguousarray(decode_srgb(colors / 255.0), np.float32)


def _has_material(visual: Any) -> bool:
    source = getattr(visual, "material", None)
    return source is not None and not _is_placeholder(source)


def _uvs(geometry: Any) -> F64 | None:
    uvs = getattr(geometry.visual, "uv", None)
    if uvs is None or np.shape(uvs) != (len(geometry.vertices), 2):
        return None
    return np.nan_to_num(np.asarray(uvs, np.float64), nan=0.0, posinf=0.0, neginf=0.0)


class _Materials:
    """Reads materials, and each image once.

    Attributes:
        materials: one per mesh.
        textures: what they use.
    """

    def __init__(self, path: Path, notes: list[str]) -> None:
        self.materials: list[Material] = []
        self.textures: list[Texture] = []
        self._path, self._notes = path, notes
        self._images: dict[str, int] = {}
        self._told: set[str] = set()
        self._budget = PixelBudget()

    def read(self, name: str, geometry: Any) -> Material:
        """Return the diffuse part of a mesh's material, and what it emits."""
        visual = geometry.visual
        if not _has_material(visual):
            if visual.kind not in ("vertex", "face"):
                return Material()
            if _colors(geometry) is not None:
                return Material(color=(1.0, 1.0, 1.0))
            colors = np.asarray(visual.vertex_colors if visual.kind == "vertex" else visual.face_colors)[:, :3]
            if len(colors) and (colors != colors[0]).any():
                self._notes.append(f"{self._path.name}: the colours of {name}'s faces are averaged")
            return Material(color=_vec3(decode_srgb(colors / 255.0).mean(axis=0)))
        source = visual.material
        written = source.kwargs  # trimesh rounds its own copies to 8 bits
        self._tell(getattr(source, "name", None) or name, written)
        image = getattr(source, "image", None)
        texture = -1 if image is None else self._texture(name, image, str(written.get("map_kd")))
        if image is not None and _uvs(geometry) is None and "uv" not in self._told:
            self._told.add("uv")
            self._notes.append(f"{self._path.name}: the image of {name} shows one colour: its mesh has no coordinates")
        color = np.clip(_rgb(written.get("kd"), 0.5 if image is None else 1.0), 0.0, 1.0)
        if image is not None and not color.any():
            color = np.ones(3)  # exporters write black beside a texture, and viewers show the texture
        emission = np.maximum(_rgb(written.get("ke"), 0.0), 0.0)
        return Material(color=_vec3(color), texture=texture, emission=_vec3(emission), name=name)

    def _tell(self, name: str, written: dict[str, Any]) -> None:
        """Tell what the material asks for and does not get, once for all materials."""
        for key, (feature, nothing) in _LEFT_OUT.items():
            if feature not in self._told and _asks(written.get(key), nothing):
                self._told.add(feature)
                self._notes.append(f"{self._path.name}: the {feature} of materials is left out (the first is {name})")

    def _texture(self, name: str, image: Any, file: str) -> int:
        if file not in self._images:
            pixels = unpack_rgba(f"{self._path}: the texture of {name}", image, self._budget)
            self._images[file] = len(self.textures)
            self.textures.append(ImageTexture(pixels))
        return self._images[file]


def _asks(value: Any, nothing: float) -> bool:
    """Tell whether a value of a material is the name of an image, or numbers other than those that mean nothing."""
    values = value if isinstance(value, list) else [] if value is None else [value]
    try:
        return any(float(each) != nothing for each in values)
    except ValueError:
        return True


def _is_placeholder(source: Any) -> bool:
    """Tell whether trimesh made this material up because the file has only u and v: its image is from no file."""
    image = getattr(source, "image", None)
    return image is not None and image.format is None and not source.kwargs


def _rgb(value: Any, default: float) -> F64:
    """Return a colour; grey where it is not three numbers."""
    if isinstance(value, list) and len(value) == 3:
        with contextlib.suppress(ValueError):  # a spectrum's file
            return np.nan_to_num(np.asarray(value, np.float64), posinf=0.0)
    return np.full(3, default)


def _vec3(values: F64) -> Vec3:
    return float(values[0]), float(values[1]), float(values[2])
