"""Worlds that are put together in Python: meshes, also those of trimesh, materials, lights and a camera."""

from __future__ import annotations

import types
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.scene.driven import CAMERA, matrix_of, read_place
from clsim.scene.meshes.geometry import placed_rigidly
from clsim.scene.motion import Attached, Matrix, Motion, Static
from clsim.scene.pictures.images import PixelBudget, decode_srgb, unpack_rgba
from clsim.scene.validate import validate
from clsim.scene.world import (
    Camera,
    EnvironmentMap,
    ImageTexture,
    Instance,
    Material,
    Mesh,
    PunctualLight,
    Sensor,
    SphereLight,
    Texture,
    Vec3,
    World,
)
from clsim.values import read_value

ItemT = TypeVar("ItemT")
_hints: Callable[[Any], dict[str, Any]] = cache(get_type_hints)


class WorldBuilder:
    """Collects what a world holds; lengths in metres, +y up. Arrays are copied: who gives them may use them again.

    >>> scene = WorldBuilder(Camera(64, 48, 50.0, Static(np.eye(4))))
    >>> scene.add("ball", trimesh.creation.icosphere(), material=Material(color=(0.6, 0.1, 0.1)))  # doctest: +SKIP
    >>> world = scene.world()  # doctest: +SKIP
    """

    def __init__(self, camera: Camera, name: str = "world") -> None:
        """Begin with nothing but a camera; ``name`` is what messages and sidecars call the world."""
        self._camera, self._name = _read("camera", camera, Camera), name
        self._meshes: list[Mesh] = []
        self._instances: list[Instance] = []
        self._materials: list[Material] = []
        self._textures: list[Texture] = []
        self._lights: list[SphereLight | PunctualLight] = []
        self._names = {CAMERA}
        self._budget = PixelBudget()

    def add(self, name: str, shape: Any, pose: Any = None, *, material: Material | None = None) -> None:
        """Add an object.

        Args:
            name: by which it can be moved; no other thing has it.
            shape: a `Mesh`, or a ``Trimesh`` or ``Scene`` of trimesh, whose parts are then called NAME/PART.
            pose: where it is, as for `Simulator.set_pose`, or a `Motion`; None is the origin.
            material: of all its triangles; None takes grey, or what trimesh has.

        Raises:
            InputError: the name is taken, or the shape or the pose is none.
        """
        motion = self._motion(name, pose)
        material = None if material is None else _read(name, material, Material)
        if isinstance(shape, Mesh):
            self._place(name, self._mesh(_read(name, shape, Mesh), material or Material()), motion)
        elif hasattr(shape, "faces"):
            self._place(name, self._from_trimesh(name, shape, material), motion)
        elif hasattr(shape, "geometry") and hasattr(shape, "graph"):
            own = {key: self._from_trimesh(key, each, material) for key, each in shape.geometry.items()}
            for node in shape.graph.nodes_geometry:
                matrix, key = shape.graph[node]
                index, offset = placed_rigidly(self._meshes, own[key], np.asarray(matrix, np.float64))
                self._place(f"{name}/{node}", index, Attached(motion, offset))
        else:
            raise InputError(f"{name}: expected a Mesh, or a mesh or scene of trimesh, got {type(shape).__name__}")
        self._names.add(name)  # now that all is well: who mends a shape may add it under its name

    def add_parts(self, name: str, parts: Mapping[str, tuple[Mesh, Matrix, Material]], pose: Any = None) -> None:
        """Add an object of several meshes that move together.

        Args:
            name: of the whole; the parts are called NAME/PART.
            parts: by name, each mesh, where it is in the whole ``[4, 4]``, and the material of all its triangles.
            pose: where the whole is, as for `add`.

        Raises:
            InputError: the name is taken, or the pose is none.
        """
        motion = self._motion(name, pose)
        read = [
            (f"{name}/{part}", _read(f"{name}/{part}", mesh, Mesh), offset, _read(f"{name}/{part}", material, Material))
            for part, (mesh, offset, material) in parts.items()
        ]
        for each, mesh, offset, material in read:
            self._place(each, self._mesh(mesh, material), Attached(motion, np.array(offset, np.float64)))
        self._names.add(name)

    def add_light(self, name: str, light: SphereLight | PunctualLight, pose: Any = None) -> None:
        """Add a light under a name, with its own motion or at a pose; raises InputError as `add`."""
        kind: type[Any] = PunctualLight if isinstance(light, PunctualLight) else SphereLight
        light = _read(name, light, kind)
        motion = self._motion(name, light.motion if pose is None else pose)
        self._lights.append(replace(light, name=name, motion=motion))
        self._names.add(name)

    def add_texture(self, texture: Texture) -> int:
        """Add a texture and return the number by which materials name it."""
        self._textures.append(_read("texture", texture, ImageTexture) if isinstance(texture, ImageTexture) else texture)
        return len(self._textures) - 1

    def world(
        self,
        *,
        environment: Vec3 = (0.0, 0.0, 0.0),
        environment_map: EnvironmentMap | None = None,
        sensor: Sensor | None = None,
        fps: float = 120.0,
        duration_s: float | None = None,
    ) -> World:
        """Return the world; raises InputError, naming what is wrong with it.

        Args:
            environment: radiance of a constant sky [W·sr⁻¹·m⁻²].
            environment_map: an image of the sky.
            sensor: the event pixel.
            fps: frames per simulated second.
            duration_s: length of the motion [s]; None is until all has ended, 1 s where nothing moves.
        """
        told_s = read_value("duration_s", duration_s, float | None)
        world = World(
            name=self._name,
            camera=self._camera,
            meshes=tuple(self._meshes),
            instances=tuple(self._instances),
            materials=tuple(self._materials),
            textures=tuple(self._textures),
            sphere_lights=tuple(light for light in self._lights if isinstance(light, SphereLight)),
            punctual_lights=tuple(light for light in self._lights if isinstance(light, PunctualLight)),
            environment=read_value("environment", environment, tuple[float, float, float]),
            environment_map=None if environment_map is None else _read("sky", environment_map, EnvironmentMap),
            sensor=Sensor() if sensor is None else _read("sensor", sensor, Sensor),
            fps=read_value("fps", fps, float),
            duration_s=1.0 if told_s is None else told_s,
        )
        validate(world, self._name)
        return world if told_s is not None else replace(world, duration_s=world.moving_s() or 1.0)

    def _motion(self, name: str, pose: Any) -> Motion:
        """Return how something of a name moves, which must be a new one."""
        name = read_value("name", name, str)
        if not name or "/" in name or name in self._names:
            raise InputError(f"{name!r} must be a name of its own, without a slash")
        motion = Static(np.eye(4)) if pose is None else _own(pose)
        if not hasattr(motion, "duration_s"):
            motion = Static(matrix_of(read_place("pose", pose)))
        found: Motion = motion
        return found

    def _place(self, name: str, mesh: int, motion: Motion) -> None:
        self._instances.append(Instance(mesh, motion, name))

    def _mesh(self, mesh: Mesh, material: Material) -> int:
        ids = np.full(len(mesh.triangles), len(self._materials), np.int32)
        self._materials.append(material)
        self._meshes.append(replace(mesh, material_ids=ids))
        return len(self._meshes) - 1

    def _from_trimesh(self, name: str, geometry: Any, material: Material | None) -> int:
        from clsim.scene.meshes.trimesh_scene import mesh_of

        mesh = mesh_of(name, geometry)
        if material is not None:
            return self._mesh(replace(mesh, colors=None), material)
        white = Material(color=(1.0, 1.0, 1.0))
        return self._mesh(mesh, self._material(name, geometry.visual) if mesh.colors is None else white)

    def _material(self, name: str, visual: Any) -> Material:
        """Return the surface that trimesh has: a colour or a texture, metalness and roughness, and what it emits."""
        source = getattr(visual, "material", None)
        if source is None:
            colors = np.asarray(getattr(visual, "face_colors", np.zeros((0, 4))))[:, :3]
            return Material(color=_vec3(decode_srgb(colors / 255.0).mean(axis=0)) if len(colors) else (0.5, 0.5, 0.5))
        if not hasattr(source, "baseColorFactor"):
            image, diffuse = source.image, np.asarray(source.diffuse)[:3] / 255.0
            return Material(color=(1.0, 1.0, 1.0) if image else _vec3(diffuse), texture=self._image(name, image))
        base, glow = source.baseColorFactor, source.emissiveFactor
        roughness, metallic = source.roughnessFactor, source.metallicFactor
        return Material(
            kind="principled",
            color=(1.0, 1.0, 1.0) if base is None else _vec3(np.asarray(base)[:3] / 255.0),
            texture=self._image(name, source.baseColorTexture),
            alpha=1.0 if roughness is None else float(roughness) ** 2,
            metallic=1.0 if metallic is None else float(metallic),
            emission=(0.0, 0.0, 0.0) if glow is None else _vec3(np.asarray(glow, np.float64)),
            emission_texture=self._image(name, source.emissiveTexture),
        )

    def _image(self, name: str, image: Any) -> int:
        if image is None:
            return -1
        return self.add_texture(ImageTexture(unpack_rgba(f"the texture of {name}", image, self._budget)))


def _read(owner: str, item: Any, kind: type[ItemT]) -> ItemT:
    """Return a description with Python's numbers and arrays of its own; raises InputError, which names its owner."""
    if not isinstance(item, kind):
        raise InputError(f"{owner}: expected {kind.__name__}, got {type(item).__name__}")
    hint: Any
    found: dict[str, Any] = {}
    for name, hint in _hints(kind).items():
        value = getattr(item, name)
        try:
            if _is_plain(hint):
                found[name] = read_value(name, value, hint)
            elif value is not None and any(get_origin(part) is np.ndarray for part in (hint, *get_args(hint))):
                found[name] = _array(name, value)
            elif hint is Motion:
                found[name] = _own(value)
                if not hasattr(value, "duration_s"):
                    raise InputError(f"`{name}` must be a motion such as Static(matrix), got {type(value).__name__}")
        except InputError as error:
            raise InputError(f"{owner}: {error}") from None
    made: ItemT = replace(item, **found)  # type: ignore[type-var]
    return made


def _is_plain(hint: Any) -> bool:
    """Tell whether values of a type are numbers, truths, words, or lists of them."""
    if get_origin(hint) in (Union, types.UnionType, tuple):
        return all(map(_is_plain, get_args(hint)))
    return get_origin(hint) is Literal or hint in (bool, float, int, str, types.NoneType)


def _array(name: str, value: Any) -> npt.NDArray[Any]:
    try:
        array = np.array(value)
    except ValueError:  # of rows of several lengths
        array = np.array(None)
    if array.dtype.kind not in ("iu" if name == "triangles" else "fiu"):
        raise InputError(f"`{name}` must be an array of {'whole ' if name == 'triangles' else ''}numbers")
    if name == "colors" and array.max(initial=0) > 1 and array.dtype.kind != "f":
        raise InputError(f"`colors` are up to {array.max()}, expected numbers from 0 to 1")
    return array


def _own(motion: Any) -> Any:
    """Return a pose that stays when the caller's matrix changes."""
    return Static(np.array(motion.matrix, np.float64)) if isinstance(motion, Static) else motion


def _vec3(values: Any) -> Vec3:
    return float(values[0]), float(values[1]), float(values[2])
