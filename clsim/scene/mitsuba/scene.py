"""Mitsuba scenes (XML of versions 0.6 to 3): from the file to the world.

Mitsuba's cameras look along +z with x to the left; its lights shine along +z. Its environment maps lie as clsim's do.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from clsim.errors import InputError
from clsim.scene.defaults.framing import ENVIRONMENT, bounds, lamp, orbiting_camera
from clsim.scene.light.daylight import sky, sun_light
from clsim.scene.meshes.geometry import is_similarity, placed_rigidly
from clsim.scene.mitsuba.daylight import KINDS, read_daylight, scales, sun_deg
from clsim.scene.mitsuba.materials import MaterialReader
from clsim.scene.mitsuba.places import ahead, placed, start_of
from clsim.scene.mitsuba.sensors import read_sensor
from clsim.scene.mitsuba.shapes import is_turned, read_shape
from clsim.scene.mitsuba.values import Color, file_of, shown
from clsim.scene.mitsuba.xml import Plugin, read_scene
from clsim.scene.motion import Matrix, Motion, Nested, Static, compose, look_at
from clsim.scene.pictures.images import PixelBudget, read_linear
from clsim.scene.rigid import mirrors, without_stretch
from clsim.scene.world import (
    Camera,
    EnvironmentMap,
    ImageTexture,
    Instance,
    Mesh,
    PunctualLight,
    SphereLight,
    Vec3,
    World,
)

IGNORED = ("film", "bsdf", "texture", "medium", "spectrum", "phase")


def load_mitsuba(path: Path, parameters: Mapping[str, str] | None = None) -> World:
    """Load a Mitsuba scene.

    Args:
        path: the file.
        parameters: what stands for ``$name`` in it, before its own defaults.

    Raises:
        InputError: one sentence with the file, the line, and what is wrong there.
    """
    scene, legacy = read_scene(path, parameters or {})
    reader = _Reader(path, legacy)
    for plugin in scene.children:
        reader.add(plugin)
    if scene.get("hide_emitters", False):
        reader.warn("what emits is seen, though the integrator hides it")
    return reader.world(dict.fromkeys(scene.unread()))


class _Reader:
    """Collects the scene's contents, object by object."""

    def __init__(self, path: Path, legacy: bool) -> None:
        self.path, self.folder, self.legacy = path, path.parent, legacy
        self.warnings: list[str] = []
        self.materials = MaterialReader(legacy, self.folder, self.warn)
        self.meshes: list[Mesh] = []
        self.instances: list[Instance] = []
        self.punctual_lights: list[PunctualLight] = []
        self.sphere_lights: list[SphereLight] = []
        self.cameras: list[Camera] = []
        self.environment: Vec3 = (0.0, 0.0, 0.0)
        self.environment_map: EnvironmentMap | None = None
        self.suns: list[Callable[[Vec3, float], SphereLight]] = []
        self.groups: dict[int, list[tuple[int, Matrix]]] = {}

    def world(self, unread: Iterable[str]) -> World:
        """Return what was collected, with a camera and light of clsim's own where there is none."""
        for sentence in unread:
            self.warn(sentence)
        if self.suns:
            middle, extent = bounds(self.path, self.meshes, self.instances)
            self.sphere_lights += [make(middle, float(np.linalg.norm(extent)) / 2) for make in self.suns]
        lit = bool(self.environment_map or any(self.environment) or self.punctual_lights or self.sphere_lights) or any(
            any(material.emission) for material in self.materials.materials
        )
        cameras, lights = self.cameras, self.sphere_lights
        if not (cameras and lit):
            center, size = bounds(self.path, self.meshes, self.instances)
            cameras = cameras or [orbiting_camera(center, size)]
            lights = lights if lit else [lamp(center, size)]
        world = World(
            name=self.path.stem,
            camera=cameras[0],
            meshes=tuple(self.meshes),
            instances=tuple(self.instances),
            materials=tuple(self.materials.materials),
            textures=tuple(self.materials.textures.textures),
            sphere_lights=tuple(lights),
            punctual_lights=tuple(self.punctual_lights),
            environment=self.environment if lit else ENVIRONMENT,
            environment_map=self.environment_map,
            warnings=tuple(self.warnings),
        )
        return replace(world, duration_s=world.moving_s() or 1.0)

    def warn(self, sentence: str) -> None:
        """Tell what is lost, each thing once."""
        text = f"{self.path.name}: {sentence}"
        if text not in self.warnings:
            self.warnings.append(text)

    def add(self, plugin: Plugin) -> None:
        """Add an object of the scene."""
        if plugin.kind == "shape":
            self._add_shape(plugin)
        elif plugin.kind in ("emitter", "luminaire"):
            self._add_emitter(plugin)
        elif plugin.kind in ("sensor", "camera"):
            self._add_sensor(plugin)
        elif plugin.kind not in IGNORED:
            self.warn(f"<{plugin.kind}> is left out")

    def _add_shape(self, shape: Plugin) -> None:
        if shape.type == "shapegroup":
            return
        if shape.type == "instance":
            self._add_instances(shape)
            return
        if shape.type == "merge":  # which has no place of its own
            for each in shape.of_kind("shape"):
                self._add_shape(each)
            return
        motion, stretch = placed(shape)
        emitter = next(iter(shape.of_kind("emitter", "luminaire")), None)
        if emitter is not None and self._add_sphere_light(shape, emitter, motion, stretch):
            return
        mesh = self._mesh(shape, stretch[:3, :3], emitter)
        if mesh is not None:
            self.instances.append(Instance(len(self.meshes), motion, shape.get("filename", "") or shape.type))
            self.meshes.append(mesh)

    def _mesh(self, shape: Plugin, linear: Matrix, emitter: Plugin | None = None) -> Mesh | None:
        mesh = read_shape(shape, self.folder, linear, legacy=self.legacy)
        if mesh is None:
            self.warn(f"shapes of type {shape.type} are left out")
            shape.pass_over()
            return None
        emission: Vec3 = (0.0, 0.0, 0.0)
        texture = -1
        if emitter is not None:
            if emitter.type != "area":
                self.warn(f"emitters of type {emitter.type} are left out")
                emitter.pass_over()
            elif (image := emitter.child("radiance")) is not None:
                emission, texture = self.materials.textures.light(image)
            else:
                emission = _radiance(emitter, "radiance")
        bsdfs = shape.of_kind("bsdf")
        if len(bsdfs) > 1:
            self.warn("the first of several bsdfs of a shape is used")
        media = shape.of_kind("medium")
        inside = next((medium for medium in media if medium.name == "interior"), None)
        if any(medium.name == "exterior" for medium in media):
            self.warn("media outside of shapes are left out: what is fog is clear")
        material = self.materials.index(bsdfs[0] if bsdfs else None, emission, texture, inside)
        return replace(mesh, material_ids=np.full(len(mesh.triangles), material, np.int32))

    def _add_sphere_light(self, shape: Plugin, emitter: Plugin, motion: Motion, stretch: Matrix) -> bool:
        """Add a sphere that glows evenly as the light it is; tell whether it could be done."""
        if shape.type != "sphere" or emitter.type != "area" or emitter.child("radiance") is not None:
            return False
        linear = start_of(shape)[:3, :3]
        if not (is_similarity(linear) or is_similarity(-linear)) or is_turned(shape, linear, self.legacy):
            return False
        scale = float(np.linalg.norm(linear[:, 0]))
        center = compose(stretch[:3, :3] @ shape.get("center", np.zeros(3)), np.eye(3))
        self.sphere_lights.append(
            SphereLight(
                shape.get("radius", 1.0) * scale, _radiance(emitter, "radiance"), Nested(motion, Static(center))
            )
        )
        return True

    def _add_instances(self, shape: Plugin) -> None:
        groups = [child for child in shape.children if child.type == "shapegroup"]
        if not groups:
            raise InputError(f"{shape.place}: the instance refers to no shapegroup")
        key = id(groups[0].children)  # a reference shares the children of what it refers to
        if key not in self.groups:
            parts = []
            for child in groups[0].of_kind("shape"):
                if child.of_kind("emitter", "luminaire"):
                    self.warn("emitters within groups are left out, as Mitsuba has none")
                within, stretch = placed(child)
                mesh = self._mesh(child, stretch[:3, :3])
                if mesh is not None:
                    parts.append((len(self.meshes), within.pose(0.0)))
                    self.meshes.append(mesh)
            self.groups[key] = parts
        motion, stretch = placed(shape)
        for index, matrix in self.groups[key]:
            if isinstance(motion, Static):
                copy, pose = placed_rigidly(self.meshes, index, motion.matrix @ stretch @ matrix)
                self.instances.append(Instance(copy, Static(pose), "instance"))
            else:
                copy, pose = placed_rigidly(self.meshes, index, stretch @ matrix)
                self.instances.append(Instance(copy, Nested(motion, Static(pose)), "instance"))

    def _add_emitter(self, emitter: Plugin) -> None:
        motion = ahead(emitter)
        kind = emitter.type
        if kind == "constant":
            self.environment = _radiance(emitter, "radiance")
        elif kind == "envmap":
            path = file_of(emitter.place, emitter.get("filename", ""), self.folder)
            scale = np.float32(emitter.get("scale", 1.0))
            pixels = read_linear(path, PixelBudget()) * scale
            self.environment_map = EnvironmentMap(pixels, without_stretch(start_of(emitter)))
        elif kind in KINDS:
            self._add_daylight(emitter, without_stretch(start_of(emitter)))
        elif kind == "point":
            position = emitter.values.get("position")
            if position is not None:
                motion = Static(compose(position, np.eye(3)))
            self.punctual_lights.append(PunctualLight("point", _radiance(emitter, "intensity"), motion))
        elif kind == "spot":
            self.punctual_lights.append(self._spot(emitter, motion))
        elif kind == "projector":
            self.punctual_lights.append(self._projector(emitter, motion))
        elif kind == "directional":
            direction = emitter.values.get("direction")
            if direction is not None and np.linalg.norm(direction) > 0:
                motion = Static(look_at((0.0, 0.0, 0.0), direction))
            self.punctual_lights.append(PunctualLight("directional", _radiance(emitter, "irradiance"), motion))
        elif kind != "area":  # which only shapes refer to
            self.warn(f"emitters of type {kind} are left out")
            emitter.pass_over()

    def _spot(self, emitter: Plugin, motion: Motion) -> PunctualLight:
        outer = emitter.get("cutoff_angle", 20.0)
        inner = emitter.get("beam_width", outer * 3 / 4)
        light = PunctualLight("spot", _radiance(emitter, "intensity"), motion, min(inner, outer), outer, "linear")
        if (texture := emitter.child("texture")) is None:
            return light
        size = math.tan(math.radians(outer))
        # Its right is Mitsuba's left, unless that is mirrored; and there the picture stands on its head.
        across = size if mirrors(start_of(emitter)) else -size
        return replace(light, picture=self.materials.textures.index(texture), picture_size=(across, -size))

    def _projector(self, emitter: Plugin, motion: Motion) -> PunctualLight:
        """Return a projector: its picture, times its scale and π, is irradiance on a plane at a distance of 1."""
        texture = emitter.child("irradiance")
        picture = -1 if texture is None else self.materials.textures.index(texture)
        image = self.materials.textures.textures[picture] if picture >= 0 else None
        rows, columns = image.pixels.shape[:2] if isinstance(image, ImageTexture) else (1, 1)
        half = math.tan(math.radians(min(emitter.get("fov", 45.0), 179.0)) / 2)
        across = half * {"x": 1.0, "y": columns / rows}.get(self._fov_axis(emitter, columns, rows), 1.0)
        up = across * rows / columns
        strength = math.pi * emitter.get("scale", 1.0)
        outer = math.degrees(math.atan(math.hypot(across, up)))
        light = PunctualLight("spot", (strength,) * 3, motion, 0.0, outer, "frame")
        return replace(light, picture=picture, picture_size=(-across if mirrors(start_of(emitter)) else across, up))

    @staticmethod
    def _fov_axis(emitter: Plugin, columns: int, rows: int) -> str:
        """Return the axis, x or y, along which a field of view is told."""
        axis = str(emitter.get("fov_axis", "x"))
        wider = "x" if columns >= rows else "y"
        return {"smaller": "y" if wider == "x" else "x", "larger": wider}.get(axis, axis)

    def _add_daylight(self, emitter: Plugin, turn: Matrix) -> None:
        day, to_world = read_daylight(emitter, turn, self.legacy)
        if day.is_night:
            self.warn("the sun is below the horizon, so there is no daylight")
            return
        sky_scale, sun_scale = scales(emitter)
        if sky_scale > 0:
            self.environment_map = EnvironmentMap(sky(day) * np.float32(sky_scale), to_world)
        if sun_scale > 0:
            self.suns.append(partial(sun_light, day, to_world, scale=sun_scale, seen_deg=sun_deg(emitter)))

    def _add_sensor(self, sensor: Plugin) -> None:
        if sensor.type not in ("perspective", "thinlens", "perspective_rdist", "orthographic"):
            self.warn(f"sensors of type {sensor.type} are left out")
            return
        if self.cameras:
            self.warn("the first of several sensors is used")
            return
        self.cameras.append(read_sensor(sensor))


def _radiance(plugin: Plugin, name: str) -> Vec3:
    value = plugin.values.get(name, plugin.values.get("value", 1.0))
    if plugin.child(name) is not None:
        raise InputError(f"{plugin.place}: {plugin.type}.{name} is a texture, expected a colour")
    if isinstance(value, float):
        value = Color((value, value, value))
    if not isinstance(value, Color):
        raise InputError(f"{plugin.place}: {plugin.type}.{name} is {shown(value)}, expected a colour")
    scale = plugin.get("scale", 1.0)
    r, g, b = (max(channel * scale, 0.0) for channel in value.rgb)
    return r, g, b
