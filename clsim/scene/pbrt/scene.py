"""pbrt-v4 scenes: from the file to the world.

pbrt's world is left-handed: everything is mirrored in z on the way, unless the camera's transform mirrors already
(``Scale -1 1 1`` before LookAt, as exporters from right-handed programs write).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from clsim.errors import InputError
from clsim.scene.defaults.framing import ENVIRONMENT, bounds, lamp, orbiting_camera
from clsim.scene.meshes.geometry import with_corner_uvs
from clsim.scene.mitsuba.blends import is_textured
from clsim.scene.motion import Matrix, compose, look_at
from clsim.scene.pbrt.lights import InMirror, light_color, read_environment, read_punctual
from clsim.scene.pbrt.materials import MaterialReader
from clsim.scene.pbrt.places import FLIP_Z, Film, Pair, Placed, read_camera, read_film, read_instance
from clsim.scene.pbrt.shapes import DEFAULT_UVS, read_shape
from clsim.scene.pbrt.tokens import Parameters, Tokens, fail, is_old
from clsim.scene.rigid import rotation_about
from clsim.scene.world import EnvironmentMap, Material, Mesh, Vec3, World

MAX_STACK = 10_000
MAX_INSTANCES = 1_000_000
IGNORED = (
    "Accelerator",
    "Integrator",
    "MakeNamedMedium",
    "PixelFilter",
    "Sampler",
)


@dataclass(frozen=True)
class State:
    """What AttributeBegin saves."""

    transform: Pair = (np.eye(4), np.eye(4))
    active: tuple[bool, bool] = (True, True)
    material: Material = field(default_factory=Material)
    emission: Vec3 | None = None
    emission_two_sided: bool = False
    reversed: bool = False


def load_pbrt(path: Path) -> World:
    """Load a pbrt-v4 scene.

    Raises:
        InputError: one sentence with the file, the line, and what is wrong there.
    """
    reader = _Reader(path)
    try:
        reader.read()
    except InputError as error:
        if is_old(path):
            raise InputError(
                f"{path}: is a scene of pbrt's version 3 or before, as its WorldEnd shows; expected version 4, to "
                "which pbrt-v4 turns it with --upgrade"
            ) from error
        raise
    return reader.world()


class _Reader:
    """Follows the directives and collects what they make."""

    def __init__(self, path: Path) -> None:
        self.path, self.folder = path, path.parent
        self.tokens = Tokens(path)
        self.warnings: list[str] = []
        self.materials = MaterialReader(self.folder, self._warn)
        self.state = State()
        self.stack: list[State] = []
        self.meshes: list[Mesh] = []
        self.placed: list[Placed] = []
        self.lights: list[InMirror] = []
        self.coordinate_systems: dict[str, Pair] = {}
        self.objects: dict[str, list[Placed]] = {}
        self.object: list[Placed] | None = None
        self.times = (0.0, 1.0)
        self.film = Film()
        self.camera: tuple[Pair, Parameters, bool] | None = None
        self.environment: Vec3 = (0.0, 0.0, 0.0)
        self.environment_image: Callable[[Matrix], EnvironmentMap] | None = None

    def _warn(self, sentence: str) -> None:
        text = f"{self.path.name}: {sentence}"
        if text not in self.warnings:
            self.warnings.append(text)

    def read(self) -> None:
        """Follow all directives."""
        self._follow(0)
        if self.stack or self.object is not None:
            raise InputError(f"{self.tokens.last}: the file ends within a block that something has begun")

    def _follow(self, depth: int) -> None:
        """Follow the directives of files that are included deeper than that."""
        while self.tokens.peek() is not None and self.tokens.depth > depth:
            token = self.tokens.take()
            if token.quoted or token.numbers is not None:
                fail(token, "a directive such as Shape")
            directive = getattr(self, f"_do_{token.text}", None)
            if directive is not None:
                directive()
            elif token.text in IGNORED:
                self.tokens.string()
                self.tokens.parameters()
            else:
                fail(token, "a directive such as Shape")

    # Transforms

    def _apply(self, matrix: Matrix, *, instead: bool = False) -> None:
        start, end = (
            (matrix if instead else old @ matrix) if active else old
            for old, active in zip(self.state.transform, self.state.active, strict=True)
        )
        if not (np.isfinite(start).all() and np.isfinite(end).all()):
            raise InputError(f"{self.tokens.last}: the transform has a number that is not finite")
        self.state = replace(self.state, transform=(start, end))

    def _do_Identity(self) -> None:  # noqa: N802 (named after the directives, here and below)
        self._apply(np.eye(4), instead=True)

    def _do_Translate(self) -> None:  # noqa: N802
        self._apply(compose(self.tokens.floats(3), np.eye(3)))

    def _do_Scale(self) -> None:  # noqa: N802
        self._apply(np.diag([*self.tokens.floats(3), 1.0]))

    def _do_Rotate(self) -> None:  # noqa: N802
        angle, *axis = self.tokens.floats(4)
        if not np.linalg.norm(axis) > 0:
            raise InputError(f"{self.tokens.last}: rotates about no axis")
        self._apply(compose((0.0, 0.0, 0.0), rotation_about(np.array(axis), math.radians(angle))))

    def _do_LookAt(self) -> None:  # noqa: N802
        numbers = self.tokens.floats(9)
        eye, target, up = numbers[:3], numbers[3:6], numbers[6:]
        if np.allclose(eye, target):
            raise InputError(f"{self.tokens.last}: looks at its own eye")
        # In pbrt's left-handed space x is to the right where +z is ahead.
        self._apply(_inverse(look_at(eye, target, up) @ np.diag((-1.0, 1.0, -1.0, 1.0))))

    def _do_Transform(self) -> None:  # noqa: N802
        self._apply(np.array(self.tokens.floats(16)).reshape(4, 4).T, instead=True)

    def _do_ConcatTransform(self) -> None:  # noqa: N802
        self._apply(np.array(self.tokens.floats(16)).reshape(4, 4).T)

    def _do_CoordinateSystem(self) -> None:  # noqa: N802
        self.coordinate_systems[self.tokens.string()] = self.state.transform

    def _do_CoordSysTransform(self) -> None:  # noqa: N802
        name = self.tokens.string()
        if name not in self.coordinate_systems:
            raise InputError(f"{self.tokens.last}: there is no coordinate system {name!r}")
        self.state = replace(self.state, transform=self.coordinate_systems[name])

    def _do_TransformTimes(self) -> None:  # noqa: N802
        start, end = self.tokens.floats(2)
        if not 0 <= start < end:
            raise InputError(f"{self.tokens.last}: times are {start:g} and {end:g}, expected 0 ≤ start < end")
        self.times = (start, end)

    def _do_ActiveTransform(self) -> None:  # noqa: N802
        token = self.tokens.take("StartTime, EndTime or All")
        choices = {"StartTime": (True, False), "EndTime": (False, True), "All": (True, True)}
        if token.text not in choices:
            fail(token, "StartTime, EndTime or All")
        self.state = replace(self.state, active=choices[token.text])

    # Blocks

    def _do_WorldBegin(self) -> None:  # noqa: N802
        self.state = State()
        self.coordinate_systems["world"] = self.state.transform

    def _do_AttributeBegin(self) -> None:  # noqa: N802
        if len(self.stack) >= MAX_STACK:
            raise InputError(f"{self.tokens.last}: blocks are nested deeper than {MAX_STACK}")
        self.stack.append(self.state)

    def _do_AttributeEnd(self) -> None:  # noqa: N802
        if not self.stack:
            raise InputError(f"{self.tokens.last}: ends a block that nothing has begun")
        self.state = self.stack.pop()

    _do_TransformBegin, _do_TransformEnd = _do_AttributeBegin, _do_AttributeEnd  # noqa: N815 (the same in version 4)

    def _do_ObjectBegin(self) -> None:  # noqa: N802
        name = self.tokens.string()
        if self.object is not None:
            raise InputError(f"{self.tokens.last}: an object cannot be defined within another")
        self._do_AttributeBegin()
        self.object = self.objects.setdefault(name, [])

    def _do_ObjectEnd(self) -> None:  # noqa: N802
        if self.object is None:
            raise InputError(f"{self.tokens.last}: ends an object that nothing has begun")
        self.object = None
        self._do_AttributeEnd()

    def _do_ObjectInstance(self) -> None:  # noqa: N802
        name = self.tokens.string()
        if name not in self.objects or self.object is not None:
            raise InputError(f"{self.tokens.last}: there is no object {name!r} to place here")
        if len(self.placed) + len(self.objects[name]) > MAX_INSTANCES:
            raise InputError(f"{self.tokens.last}: more than {MAX_INSTANCES} shapes are placed")
        for part in self.objects[name]:
            start, end = (a @ b for a, b in zip(self.state.transform, part.transform, strict=True))
            self.placed.append(Placed(part.mesh, (start, end)))

    def _do_ReverseOrientation(self) -> None:  # noqa: N802
        self.state = replace(self.state, reversed=not self.state.reversed)

    def _do_Attribute(self) -> None:  # noqa: N802
        self._warn(f"the attributes of a {self.tokens.string()} are left out")
        self.tokens.parameters()

    def _do_MediumInterface(self) -> None:  # noqa: N802
        self.tokens.string()
        token = self.tokens.peek()
        if token is not None and token.quoted:
            self.tokens.take()
        self._warn("media are left out")

    def _do_Option(self) -> None:  # noqa: N802
        self.tokens.string()  # its type and name in one; unlike other directives it has no name of its own before
        self.tokens.take("an option's value")

    def _do_Include(self) -> None:  # noqa: N802
        name = self.tokens.string()
        self.tokens.include(name, self.tokens.last)

    def _do_Import(self) -> None:  # noqa: N802
        state, depth = self.state, self.tokens.depth
        self._do_Include()
        self._follow(depth)
        self.state = state

    def _do_ColorSpace(self) -> None:  # noqa: N802
        name = self.tokens.string()
        if name.lower() != "srgb":
            self._warn(f"colours are taken as sRGB's primaries, not {name}'s")

    # What there is

    def _do_Film(self) -> None:  # noqa: N802
        self.tokens.string()
        self.film = read_film(self.tokens.parameters())

    def _do_Camera(self) -> None:  # noqa: N802
        kind = self.tokens.string()
        parameters = self.tokens.parameters()
        if kind not in ("perspective", "orthographic"):
            self._warn(f"cameras of type {kind} are left out")
            return
        try:
            start, end = (_inverse(matrix) for matrix in self.state.transform)
        except np.linalg.LinAlgError:
            raise InputError(f"{parameters.place}: the camera's transform has no inverse") from None
        self.camera = ((start, end), parameters, kind == "orthographic")
        self.coordinate_systems["camera"] = (start, end)

    def _do_Material(self) -> None:  # noqa: N802
        kind = self.tokens.string()
        self.state = replace(self.state, material=self.materials.read(kind, self.tokens.parameters()))

    def _do_MakeNamedMaterial(self) -> None:  # noqa: N802
        name = self.tokens.string()
        parameters = self.tokens.parameters()
        self.materials.named[name] = self.materials.read(parameters.word("type", "diffuse"), parameters)

    def _do_NamedMaterial(self) -> None:  # noqa: N802
        name = self.tokens.string()
        self.state = replace(self.state, material=self.materials.by_name(name, self.tokens.last))

    def _do_Texture(self) -> None:  # noqa: N802
        name, value, kind = (self.tokens.string() for _ in range(3))
        self.materials.add_texture(name, kind, self.tokens.parameters(), number=value == "float")

    def _do_AreaLightSource(self) -> None:  # noqa: N802
        kind = self.tokens.string()
        parameters = self.tokens.parameters()
        if kind != "diffuse":
            self._warn(f"area lights of type {kind} are left out")
            return
        if "filename" in parameters.found or "power" in parameters.found:
            self._warn("the images and powers of area lights are left out")
        emission = light_color(self.materials, parameters, "L")
        self.state = replace(self.state, emission=emission, emission_two_sided=parameters.flag("twosided", False))
        parameters.tell_unread("diffuse area light", self._warn)

    def _do_Shape(self) -> None:  # noqa: N802
        kind = self.tokens.string()
        parameters = self.tokens.parameters()
        mesh = read_shape(kind, parameters, self.folder, self._warn)
        if mesh is None or not len(mesh.triangles):
            return
        if self.state.reversed:
            normals = None if mesh.normals is None else -mesh.normals
            mesh = replace(mesh, triangles=np.ascontiguousarray(mesh.triangles[:, ::-1]), normals=normals)
        material = self.materials.opacity(self.state.material, parameters)
        if (emission := self._emission()) is not None:
            if material.opacity == 0:
                self._warn("lamps whose alpha is 0 are seen")  # in pbrt they shine all the same, and are not seen
                material = self.state.material
            material = replace(material, emission=emission, emits_behind=self.state.emission_two_sided)
        if mesh.uvs is None and is_textured(material, self.materials.materials):
            mesh = with_corner_uvs(mesh, DEFAULT_UVS)
        ids = np.full(len(mesh.triangles), self.materials.index(material), np.int32)
        placed = Placed(len(self.meshes), self.state.transform)
        self.meshes.append(replace(mesh, material_ids=ids))
        parameters.tell_unread(kind, self._warn)
        (self.placed if self.object is None else self.object).append(placed)

    def _emission(self) -> Vec3 | None:
        """Return what a shape emits: as in pbrt, nothing without a surface, nor within an object."""
        emission = self.state.emission
        if emission is None or not any(emission) or self.state.material.opacity == 0:
            return None
        if self.object is not None:
            self._warn("area lights within objects do not shine, as in pbrt")
            return None
        return emission

    def _do_LightSource(self) -> None:  # noqa: N802
        kind = self.tokens.string()
        parameters = self.tokens.parameters()
        if "portal" in parameters.found:
            self._warn("the portal of lights is left out")
        matrix = self.state.transform[0]
        if kind == "infinite":
            image = read_environment(parameters, matrix, self.folder, self._warn)
            if image is None:
                r, g, b = np.add(self.environment, light_color(self.materials, parameters, "L", "illuminance", math.pi))
                self.environment = (float(r), float(g), float(b))
            else:
                if self.environment_image is not None:
                    self._warn("of several infinite lights with images the last is used")
                self.environment_image = image
            parameters.tell_unread("light infinite", self._warn)
            return
        light = read_punctual(kind, self.materials, parameters, matrix)
        if light is None:
            self._warn(f"lights of type {kind} are left out")
        else:
            self.lights.append(light)
            parameters.tell_unread(f"light {kind}", self._warn)

    # The world

    def world(self) -> World:
        """Return what was collected, mirrored where the camera asks for it."""
        mirror = FLIP_Z
        if self.camera is not None and np.linalg.det(self.camera[0][0][:3, :3]) < 0:
            mirror = np.eye(4)
        instances = [read_instance(placed, mirror, self.times, self.meshes, self._warn) for placed in self.placed]
        lights = [light(mirror) for light in self.lights]
        environment_map = None if self.environment_image is None else self.environment_image(mirror)
        used = {instance.mesh for instance in instances}
        glowing = any(any(self.materials.materials[self.meshes[k].material_ids[0]].emission) for k in used)
        lit = bool(lights or environment_map or any(self.environment) or glowing)
        spheres = []
        if self.camera is None or not lit:
            center, size = bounds(self.path, self.meshes, instances)
        if self.camera is None:
            camera = orbiting_camera(center, size)
        else:
            camera = read_camera(*self.camera, self.film, self.times, mirror, self._warn)
        if not lit:
            spheres = [lamp(center, size)]
        world = World(
            name=self.path.stem,
            camera=camera,
            meshes=tuple(self.meshes),
            instances=tuple(instances),
            materials=tuple(self.materials.materials),
            textures=tuple(self.materials.textures),
            sphere_lights=tuple(spheres),
            punctual_lights=tuple(lights),
            environment=self.environment if lit else ENVIRONMENT,
            environment_map=environment_map,
            warnings=tuple(self.warnings),
        )
        return replace(world, duration_s=world.moving_s() or 1.0)


def _inverse(matrix: Matrix) -> Matrix:
    return np.asarray(np.linalg.inv(matrix), np.float64)
