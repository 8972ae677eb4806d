"""USD scenes: what stands in a stage, from the file to the world; read by usd-core, which is optional.

As in glTF, a file without a camera is an asset: the camera orbits around it, and what moves in it repeats.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from clsim.errors import InputError
from clsim.scene.defaults.framing import (
    ENVIRONMENT,
    ORBIT_S,
    bounds,
    glow_lights,
    lamp,
    orbiting_camera,
)
from clsim.scene.defaults.indoors import stand_inside
from clsim.scene.meshes.geometry import placed_rigidly, transformed
from clsim.scene.modulation import Modulation
from clsim.scene.motion import Matrix, Motion, Static
from clsim.scene.parts import Parts
from clsim.scene.rigid import facing, stretch_of
from clsim.scene.usd.cameras import read_camera
from clsim.scene.usd.instancing import Copies, copies
from clsim.scene.usd.lights import LightReader, suns
from clsim.scene.usd.materials import MaterialReader
from clsim.scene.usd.meshes import read_body, read_mesh
from clsim.scene.usd.motion import Shapes, are_similar, motion_of, moving_codes
from clsim.scene.usd.points import read_points
from clsim.scene.usd.stage import PrimError, Stage
from clsim.scene.world import Camera, Instance, Mesh, World

MAX_INSTANCES = 100_000
MAX_PRIMS = 2_000_000
MAX_NESTED = 4
"""How deep copies within copies are looked into; the deeper ones may be without end."""
_LOOKS = 33
"""Times at which the place of what moves is looked at for stretching."""


def load_usd(path: Path) -> World:
    """Load a ``.usd``, ``.usda``, ``.usdc`` or ``.usdz`` as a whole scene.

    Raises:
        InputError: one sentence that names the file and what is wrong with it.
    """
    reader = _Reader(path, repeat=None)
    reader.read()
    lights, warnings, notes = reader.lamps.lights, list(reader.warnings), list(reader.notes)
    reader.check_instances()
    center, size = bounds(path, reader.meshes, reader.instances)
    spheres = [*lights.spheres, *suns(lights, center, float(np.linalg.norm(size)) / 2)]
    sky, sky_map, lamps = lights.sky, lights.sky_map, (lamp(center, size),)
    lit = bool(spheres or lights.points or lights.surfaces or any(sky) or sky_map is not None)
    lit = lit or glow_lights(reader.meshes, reader.instances, reader.materials.materials, size)
    if not lit:
        notes.append(f"{path.name}: has no lights: a lamp is added")
    duration_s = reader.stage.duration_s if reader.moves else 0.0
    if reader.cameras:
        camera = reader.cameras[0]
        if len(reader.cameras) > 1:
            notes.append(f"{path.name}: has {len(reader.cameras)} cameras, the first is used")
    else:
        period_s = duration_s * max(1, round(ORBIT_S / duration_s)) if duration_s else ORBIT_S
        camera, duration_s = orbiting_camera(center, size, period_s), period_s
        if inside := stand_inside(reader.meshes, reader.instances, center, size, period_s):
            camera, lamps = inside[0], (inside[1],)
            notes.append(f"{path.name}: {inside[2]}")
    return World(
        name=path.stem,
        camera=camera,
        meshes=tuple(reader.meshes),
        instances=tuple(reader.instances),
        materials=tuple(reader.materials.materials),
        textures=tuple(reader.materials.textures),
        sphere_lights=tuple(spheres) if lit else lamps,
        punctual_lights=tuple(lights.points),
        environment=sky if lit else ENVIRONMENT,
        environment_map=sky_map,
        environment_modulation=lights.sky_change,
        duration_s=duration_s or 1.0,
        warnings=tuple(warnings),
        notes=tuple(notes),
    )


def read_usd(path: Path) -> Parts:
    """Read a USD file as part of another scene; its animation repeats, and light from afar is left out.

    Raises:
        InputError: as `load_usd`.
    """
    reader = _Reader(path, repeat=True)
    reader.read()
    reader.check_instances()
    lights = reader.lamps.lights
    if lights.suns or any(lights.sky) or lights.sky_map is not None:
        reader.warn("its distant lights and domes are left out: a scene's own environment stands for them")
    return Parts(
        reader.meshes,
        reader.materials.materials,
        reader.materials.textures,
        reader.instances,
        lights.points,
        reader.cameras,
        reader.stage.duration_s if reader.moves else 0.0,
        reader.warnings,
        reader.notes,
        lights.spheres,
    )


def read_usd_camera(path: Path) -> Camera:
    """Return the first camera of a USD file, which plays its animation once; raises InputError."""
    reader = _Reader(path, repeat=False)
    reader.read()
    if not reader.cameras:
        raise InputError(f"{path}: has no camera")
    return reader.cameras[0]


class _Reader:
    """Collects what stands in a stage as its prims are visited."""

    def __init__(self, path: Path, *, repeat: bool | None) -> None:
        self.warnings: list[str] = []
        self._told: set[str] = set()
        self.notes: list[str] = []
        self._single_sided = False
        self.meshes: list[Mesh] = []
        self.instances: list[Instance] = []
        self.cameras: list[Camera] = []
        self.moves = False
        self._unseen: list[str] = []
        self._name = path.name
        self.stage = Stage(path, self.warn)
        if repeat is None:
            repeat = not any(prim.IsA(UsdGeom.Camera) for prim in self.stage.usd.Traverse())
        self._repeat = repeat
        self.materials = MaterialReader(self.stage, self.warn, repeat=repeat)
        self.lamps = LightReader(self.stage, self._rigid, self.warn, repeat=repeat)
        self._shared: dict[tuple[str, ...], int | None] = {}

    def warn(self, sentence: str) -> None:
        """Note once what the file asks for and clsim lacks, with the first that it is about."""
        about = re.sub(r"\(first [^)]*\)", "", sentence)
        if about not in self._told:
            self._told.add(about)
            self.warnings.append(f"{self._name}: {sentence}")

    def check_instances(self) -> None:
        """Raise InputError where nothing is to be seen, with what was left out."""
        if not self.instances:
            reasons = [text.removeprefix(f"{self._name}: ") for text in self.warnings] + self._unseen
            why = "; ".join(reasons[:3])
            raise InputError(f"{self.stage.path}: has no triangles, expected a mesh" + (f" ({why})" if why else ""))

    def read(self) -> None:
        """Visit all prims, and let go of the file."""
        with self.stage.hearing():
            self._read()
        self.stage.release()

    def _read(self) -> None:
        for prim in self._prims(self.stage.usd.GetPseudoRoot()):
            with self._leaving_out(prim):
                self._add(prim)
        for mesh, material, prim in self.lamps.lights.surfaces:
            ids = np.full(len(mesh.triangles), self.materials.add(material), np.int32)
            self._place(prim, self._mesh(replace(mesh, material_ids=ids)), _own(prim), moving_codes(self.stage, prim))
        changes = [change.duration_s > 0 for change in self._changes() if change is not None]
        motions = [each.motion for each in self.instances] + [each.motion for each in self.cameras]
        self.moves = self.moves or any(changes) or any(motion.duration_s > 0 for motion in motions)

    @contextmanager
    def _leaving_out(self, prim: Any) -> Iterator[None]:
        """Leave a prim out, with a warning, where something is wrong with it alone."""
        try:
            with self.stage.naming(prim):
                yield
        except PrimError as error:
            self.warn(f"a prim is left out: {str(error).removeprefix(f'{self.stage.path}: ')}")

    def _add(self, prim: Any) -> None:
        if prim.IsA(UsdGeom.PointInstancer):
            self._add_copies(prim)
        elif prim.IsA(UsdGeom.Camera):
            self._add_camera(prim)
        elif not self.lamps.read(prim) and prim.IsA(UsdGeom.Gprim):
            self._add_body(prim)

    def _changes(self) -> list[Modulation | None]:
        lights = self.lamps.lights
        lamps = [each.modulation for each in lights.spheres] + [each.modulation for each in lights.points]
        suns = [change for *_, change in lights.suns]
        return [*lamps, *suns, *(each.modulation for each in self.materials.materials), lights.sky_change]

    def _prims(self, root: Any) -> Iterator[Any]:
        """Yield what is seen below a prim, instances' parts included, but not what instancers copy."""
        visited = Usd.PrimRange(root, Usd.TraverseInstanceProxies())
        count = 0
        iterator = iter(visited)
        for prim in iterator:
            count += 1
            if count > MAX_PRIMS:
                raise InputError(f"{self.stage.path}: has more than {MAX_PRIMS} prims")
            if not self._is_seen(prim):
                self._unseen.append(f"{prim.GetName()} is hidden, or a guide or a proxy")
                iterator.PruneChildren()
                continue
            if prim.IsA(UsdGeom.PointInstancer):
                iterator.PruneChildren()
            yield prim

    def _is_seen(self, prim: Any) -> bool:
        shape = UsdGeom.Imageable(prim)
        if not shape:
            return True
        if shape.ComputePurpose() in (UsdGeom.Tokens.proxy, UsdGeom.Tokens.guide):
            return False
        attribute = shape.GetVisibilityAttr()
        if self.stage.times(attribute):
            self.warn(f"what appears or vanishes is as at the start (first {prim.GetName()})")
        return bool(self.stage.value(attribute) != UsdGeom.Tokens.invisible)

    def _add_body(self, prim: Any) -> None:
        index = self._body(prim)
        if index is not None:
            self._place(prim, index, _own(prim), moving_codes(self.stage, prim))

    def _body(self, prim: Any) -> int | None:
        """Return the mesh of a prim, which instances of one prototype share; None where it has none."""
        prototype = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
        key = (str(prototype.GetPath()), *self._bound(prim))
        if key not in self._shared:
            if prim.IsA(UsdGeom.Mesh):
                sides = UsdGeom.Mesh(prim).GetDoubleSidedAttr()
                if sides.HasAuthoredValue() and not sides.Get() and not self._single_sided:
                    self._single_sided = True
                    self.notes.append(f"{self._name}: doubleSided is false of {prim.GetName()}, but both sides show")
                uv_name = self.materials.uv_name(prim)
                color_name = self.materials.color_name(prim)
                mesh = read_mesh(
                    self.stage, prim, uv_name, color_name, self.materials.index, self.warn, repeat=self._repeat
                )
            elif prim.IsA(UsdGeom.Points):
                mesh = read_points(self.stage, prim, self.materials, self.warn)
            else:
                mesh = read_body(self.stage, prim, self.materials.index)
                if mesh is None:
                    self.warn(f"{prim.GetTypeName()} is left out (first {prim.GetName()})")
            if mesh is None:
                self._unseen.append(f"{prim.GetName()} has no faces that can be shown")
            self._shared[key] = None if mesh is None else self._mesh(mesh)
        return self._shared[key]

    def _bound(self, prim: Any) -> tuple[str, ...]:
        """Return which material an instance gives to a part of it from outside."""
        if not prim.IsInstanceProxy():
            return ()
        return (self.materials.path(prim),)

    def _mesh(self, mesh: Mesh) -> int:
        self.moves = self.moves or mesh.deformation is not None
        self.meshes.append(mesh)
        return len(self.meshes) - 1

    def _place(self, prim: Any, mesh: int, name: str, codes: list[float]) -> None:
        self._place_at(mesh, name, codes, lambda code: self.stage.to_world(prim, code))

    def _place_at(self, mesh: int, name: str, codes: list[float], matrix_at: Callable[[float], Matrix]) -> None:
        """Place a mesh at matrices; what they stretch goes into its points, for all time or anew at each time."""
        if len(self.instances) >= MAX_INSTANCES:
            raise InputError(f"{self.stage.path}: places more than {MAX_INSTANCES} meshes")
        deformation = self.meshes[mesh].deformation
        if not codes and deformation is None:
            placed, pose = placed_rigidly(self.meshes, mesh, matrix_at(self.stage.start))
            self.instances.append(Instance(placed, Static(pose), name))
            return
        looks = [self.stage.start]
        if codes:
            looks = sorted({*codes, *np.linspace(codes[0], codes[-1], _LOOKS).tolist()})
        matrices = [matrix_at(code) for code in looks]
        if not are_similar(matrices) and deformation is None:
            stretch = stretch_of(matrices[0])
            unstretched = np.eye(4) if stretch is None else np.linalg.inv(stretch)
            if stretch is not None and are_similar([matrix @ unstretched for matrix in matrices]):
                mesh = self._mesh(transformed(self.meshes[mesh], stretch[:3, :3]))
                motion = motion_of(self.stage, codes, lambda code: matrix_at(code) @ unstretched, repeat=self._repeat)
                self.instances.append(Instance(mesh, motion, name))
                return
        if are_similar(matrices):
            motion = motion_of(self.stage, codes, matrix_at, repeat=self._repeat)
            self.instances.append(Instance(mesh, motion, name))
            return
        self.instances.append(Instance(self._stretching(mesh, name, looks, matrices), Static(np.eye(4)), name))

    def _stretching(self, mesh: int, name: str, codes: list[float], matrices: list[Matrix]) -> int:
        """Return a mesh whose vertices go where matrices lead them that no pose can be."""
        source = self.meshes[mesh]
        if isinstance(source.deformation, Shapes) and len(codes) == 1:
            codes = [self.stage.start + time_s * self.stage.codes_per_s for time_s in source.deformation.times_s]
            matrices = matrices * len(codes)
        bytes_each = source.vertices.nbytes + (0 if source.normals is None else source.normals.nbytes)
        if not self.stage.claim(len(codes) * bytes_each):
            raise InputError(f"{self.stage.path}: {name} stretches, and its shapes take too much memory")
        times_s = tuple(self.stage.seconds(code) for code in codes)
        shapes = []
        for time_s, matrix in zip(times_s, matrices, strict=True):
            now = source
            if source.deformation is not None:
                vertices, normals = source.deformation.vertices_at(time_s)
                now = replace(source, vertices=vertices, normals=normals)
            moved = transformed(now, matrix[:3, :3])
            shapes.append(replace(moved, vertices=moved.vertices + matrix[:3, 3].astype(np.float32)))
        normals = None if source.normals is None else np.array([shape.normals for shape in shapes])
        deformation = Shapes(times_s, np.array([shape.vertices for shape in shapes]), normals, self._repeat)
        return self._mesh(replace(shapes[0], deformation=deformation))

    def _add_copies(self, prim: Any) -> None:
        found: Copies | None = copies(self.stage, prim, self.warn, MAX_INSTANCES - len(self.instances))
        if found is None:
            return
        for number, root in enumerate(found.prototypes):
            chosen = np.flatnonzero(found.which == number)
            for part, inside in self._contents(root, 0) if len(chosen) else ():
                with self._leaving_out(part):
                    index = self._body(part)
                    for k in chosen.tolist() if index is not None else ():
                        name = f"{_own(prim)}/{k}/{part.GetName()}"
                        self._place_at(index or 0, name, found.codes, found.place(k, inside))

    def _contents(self, root: Any, depth: int) -> Iterator[tuple[Any, Matrix]]:
        """Yield the bodies of a prototype, those of instancers within it too, each with its 4×4 matrix there."""
        for part in self._prims(root):
            if moving_codes(self.stage, part, root.GetParent()):
                self.warn(f"parts that move within copies stand as at the start (first {part.GetName()})")
            inside = self.stage.to_ancestor(part, root.GetParent())
            if not part.IsA(UsdGeom.PointInstancer):
                if part.IsA(UsdGeom.Gprim):
                    yield part, inside
                continue
            if depth == MAX_NESTED:
                self.warn(f"copies more than {MAX_NESTED} levels deep in copies are left out (first {part.GetName()})")
                continue
            found = copies(self.stage, part, self.warn, MAX_INSTANCES)
            if found is None:
                continue
            if found.moves_within(root):
                self.warn(f"copies that move within copies stand as at the start (first {part.GetName()})")
            for number, inner in enumerate(found.prototypes):
                for k in np.flatnonzero(found.which == number).tolist():
                    for body, matrix in self._contents(inner, depth + 1):
                        yield body, inside @ found.at(self.stage.start)[k] @ matrix

    def _add_camera(self, prim: Any) -> None:
        self.cameras.append(read_camera(self.stage, prim, self._rigid(prim)))

    def _rigid(self, prim: Any) -> Motion:
        """Return how a lamp or a camera moves, which no scale of its place makes larger."""
        codes = moving_codes(self.stage, prim)
        return motion_of(self.stage, codes, lambda code: facing(self.stage.to_world(prim, code)), repeat=self._repeat)


def _own(prim: Any) -> str:
    return str(prim.GetPath()).lstrip("/")
