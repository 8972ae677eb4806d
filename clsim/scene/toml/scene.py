"""TOML scenes: from the file to the world."""

from __future__ import annotations

import importlib
import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from clsim.errors import InputError
from clsim.scene import shapes
from clsim.scene.defaults.drift import drifting
from clsim.scene.files import USD_ENDINGS, named_file, need_usd
from clsim.scene.foreign import FOREIGN, load_foreign
from clsim.scene.light.spectra import METALS
from clsim.scene.meshes.geometry import is_similarity, placed_rigidly, transformed
from clsim.scene.motion import (
    Attached,
    LookAtKeyframes,
    Motion,
    Nested,
    Orbit,
    Quaternion,
    Static,
    compose,
    euler_quaternion,
    rotation_matrix,
)
from clsim.scene.parts import Parts, with_textures_from
from clsim.scene.pictures.film import Film
from clsim.scene.pictures.images import U8, PixelBudget, is_linear, read_light, read_linear, read_texture
from clsim.scene.rigid import Facing
from clsim.scene.toml.light import read_daylight, read_film, read_modulation
from clsim.scene.trajectories.paths import read_path
from clsim.scene.trajectories.trajectory import CubicKeyframes, Interpolation, through
from clsim.scene.trajectories.wandering import Shake, Wander
from clsim.scene.world import (
    Camera,
    CheckerTexture,
    EnvironmentMap,
    ImageTexture,
    Instance,
    Lens,
    Material,
    Mesh,
    Mount,
    PunctualLight,
    Sensor,
    SphereLight,
    Texture,
    Vec3,
    World,
    scaled,
)
from clsim.values import read_text, toml_problem

if TYPE_CHECKING:  # pydantic costs a third of the start-up, and only scenes from TOML need it
    from clsim.scene.toml import schema

MAX_BYTES = 16 << 20
MAX_PICTURE_DEG = 89.0
"""Half angle of the widest picture: at a right angle it has no end."""
NO_TURN: Quaternion = (0.0, 0.0, 0.0, 1.0)


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file; raises InputError that names the file and line."""
    tomllib = importlib.import_module("tomllib" if sys.version_info >= (3, 11) else "tomli")
    text = read_text(path, MAX_BYTES, "a scene's TOML")
    try:
        parsed: dict[str, Any] = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(f"{path}: is not valid TOML: {toml_problem(text, error)}") from None
    return parsed


def load_toml(path: Path) -> World:
    """Build the world that a TOML scene describes.

    Raises:
        InputError: with every problem of the file, one line each.
    """
    from clsim.scene.toml.check import parse, small_angles
    from clsim.scene.toml.unused import unused_keys

    data = read_toml(path)
    scene = parse(data, path)
    problems: list[str] = []
    base: World | None = None
    if scene.base is not None:
        with _collecting(problems, f"{path}: base"):
            base = _read_base(named_file(scene.base, path.parent), drifts=scene.camera is None)
    builder = _Builder(path, base)
    builder.warnings += [*small_angles(scene, path), *unused_keys(data, path)]
    for name, material in scene.materials.items():
        with _collecting(problems, f"{path}: materials.{name}"):
            builder.add_material(name, material)
    for i, table in enumerate(scene.objects):
        with _collecting(problems, f"{path}: objects[{i}]"):
            builder.add_object(i, table)
    lights = builder.sphere_lights
    for i, light in enumerate(scene.sphere_lights):
        with _collecting(problems, f"{path}: sphere_lights[{i}]"):
            motion, modulation = _motion(light), read_modulation(light.modulation)
            lights.append(SphereLight(light.radius_m, light.radiance, motion, light.name, modulation))
    for i, punctual in enumerate(scene.lights):
        with _collecting(problems, f"{path}: lights[{i}]"):
            builder.add_light(punctual)
    environment, modulation = scene.environment.radiance, read_modulation(scene.environment.modulation)
    environment_map: EnvironmentMap | None = None
    if base is not None and "environment" not in scene.model_fields_set:
        environment, modulation = base.environment, base.environment_modulation
        environment_map = base.environment_map
    with _collecting(problems, f"{path}: environment.map"):
        environment_map = builder.environment_map(scene.environment) or environment_map
    if scene.environment.daylight is not None and not problems:
        daylight = scene.environment.daylight
        environment_map, suns = read_daylight(daylight, path, builder.meshes, builder.instances)
        lights += [replace(sun, modulation=read_modulation(scene.environment.modulation)) for sun in suns]
        if environment_map is None and not suns and (daylight.sky_scale > 0 or daylight.sun_scale > 0):
            builder.warnings.append(f"{path.name}: the sun is below the horizon, so there is no daylight")
    camera: Camera | None = None if base is None else base.camera
    if scene.camera is not None:
        with _collecting(problems, f"{path}: camera"):
            camera = _camera(scene.camera, path.parent)
    if problems or camera is None:
        raise InputError("\n".join(problems))
    world = World(
        name=path.stem,
        camera=camera,
        meshes=tuple(builder.meshes),
        instances=tuple(builder.instances),
        materials=tuple(builder.materials),
        textures=tuple(builder.textures),
        sphere_lights=tuple(lights),
        punctual_lights=tuple(builder.punctual_lights),
        environment=environment,
        environment_map=environment_map,
        environment_modulation=modulation,
        sensor=Sensor(**scene.sensor.model_dump()),
        fps=scene.fps,
        warnings=tuple(builder.warnings),
        notes=tuple(builder.notes),
        rig=tuple(map(_mount, scene.cameras)),
    )
    return replace(world, duration_s=scene.duration_s or world.moving_s() or 1.0)


class _Builder:
    """Collects meshes, materials and instances as objects are added."""

    def __init__(self, path: Path, base: World | None) -> None:
        self.folder = path.parent
        self.meshes: list[Mesh] = list(base.meshes) if base else []
        self.instances: list[Instance] = list(base.instances) if base else []
        self.materials: list[Material] = [*(base.materials if base else ()), Material()]
        self.textures: list[Texture] = list(base.textures) if base else []
        self.punctual_lights: list[PunctualLight] = list(base.punctual_lights) if base else []
        self.sphere_lights: list[SphereLight] = list(base.sphere_lights) if base else []
        self.warnings: list[str] = list(base.warnings) if base else []
        self.notes: list[str] = list(base.notes) if base else []
        self.budget = PixelBudget()
        self.material_ids: dict[str | None, int] = {None: len(self.materials) - 1}

    def add_material(self, name: str, table: schema.MaterialTable) -> None:
        self.material_ids[name] = len(self.materials)
        self.materials.append(Material())  # stands in where the real one has a problem
        self.materials[-1] = replace(self._material(table), name=name)

    def _material(self, table: schema.MaterialTable) -> Material:
        bright = table.texture is not None or table.kind in ("conductor", "dielectric", "thin-dielectric")
        default: Vec3 = (1.0, 1.0, 1.0) if bright else (0.5, 0.5, 0.5)
        texture, color = -1, table.color or default
        if table.checker is not None:
            checker = table.checker
            texture, color = len(self.textures), (1.0, 1.0, 1.0)
            self.textures.append(CheckerTexture(checker.color_a, checker.color_b, checker.squares_per_m))
        if table.texture is not None:
            texture = self._image(table.texture, srgb=True)
        eta, k = table.eta, table.k
        if table.metal is not None:
            if table.metal not in METALS:
                raise InputError(f"metal is {table.metal!r}, expected one of {', '.join(METALS)}")
            eta, k = METALS[table.metal]
        emission_texture, brightest = self._light(table.emission_texture)
        return Material(
            kind=table.kind,
            color=color,
            texture=texture,
            emission=scaled(table.emission, brightest),
            emission_texture=emission_texture,
            modulation=read_modulation(table.modulation),
            emits_behind=table.emits_behind,
            back=table.back,
            alpha=table.roughness**2,
            roughness_texture=self._image(table.roughness_texture, srgb=False),
            metallic=table.metallic,
            ior=table.ior,
            eta=eta,
            k=k,
            specular_color=table.specular_color,
            distribution=table.distribution,
            stretch=table.stretch,
            absorption=table.absorption,
            nonlinear=table.nonlinear,
            specular_tint=table.specular_tint,
            sheen=table.sheen,
            sheen_tint=table.sheen_tint,
            flatness=table.flatness,
            transmission=table.transmission,
            clearcoat=table.clearcoat,
            clearcoat_alpha=table.clearcoat_roughness**2,
            normal_texture=self._image(table.normal_texture, srgb=False),
            normal_scale=table.normal_scale,
            bump_texture=self._image(table.bump_texture, srgb=False),
            bump_scale=table.bump_scale,
            alpha_mode=table.alpha_mode,
            alpha_cutoff=table.alpha_cutoff,
            opacity=table.opacity,
            opacity_texture=self._image(table.opacity_texture, srgb=True),
        )

    def _image(self, table: schema.ImageTable | None, *, srgb: bool) -> int:
        if table is None:
            return -1
        film = read_film(table, self.folder, self.budget)
        # A table that is no film has a file: the check of the whole TOML says so.
        pixels = film.first if film else read_texture(named_file(str(table.file), self.folder), self.budget, srgb=srgb)
        return self._add(table, pixels, film, srgb=srgb)

    def _light(self, table: schema.ImageTable | None) -> tuple[int, float]:
        """Return the index of a light's picture, and what the light is to be multiplied by."""
        if table is None or table.file is None or not is_linear(table.file):
            return self._image(table, srgb=True), 1.0
        pixels, brightest = read_light(named_file(table.file, self.folder), self.budget)
        return self._add(table, pixels, None, srgb=True), brightest

    def _add(self, table: schema.ImageTable, pixels: U8, film: Film | None, *, srgb: bool) -> int:
        (u, v), wrap = table.repeats, table.wrap
        matrix = ((u, 0.0, 0.0), (0.0, v, 0.0))
        self.textures.append(ImageTexture(pixels, srgb, wrap, wrap, table.nearest, matrix, film))
        return len(self.textures) - 1

    def add_light(self, table: schema.LightTable) -> None:
        motion = _motion(table, table.rotation_deg, table.look_at)
        inner = min(table.inner_deg, table.outer_deg)
        modulation = read_modulation(table.modulation)
        light = PunctualLight(
            table.kind, table.intensity, motion, inner, table.outer_deg, "squared", table.name, modulation
        )
        if table.picture is not None:
            size = math.tan(math.radians(min(table.outer_deg, MAX_PICTURE_DEG)))
            picture, brightest = self._light(table.picture)
            intensity = scaled(light.intensity, brightest)
            light = replace(light, picture=picture, picture_size=(size, size), intensity=intensity)
        self.punctual_lights.append(light)

    def environment_map(self, table: schema.EnvironmentTable) -> EnvironmentMap | None:
        if table.map is None:
            return None
        pixels = read_linear(named_file(table.map, self.folder), self.budget)
        turn = rotation_matrix(euler_quaternion((0.0, table.map_rotation_deg, 0.0)))
        return EnvironmentMap(pixels * np.float32(table.map_scale), turn, table.map_turn_deg_per_s)

    def add_object(self, index: int, table: schema.ObjectTable) -> None:
        from clsim.scene.toml import schema

        name, motion = table.name or f"objects[{index}]", _motion(table, table.rotation_deg)
        material = self.material_ids[table.material]
        if isinstance(table, schema.FileTable):
            self._add_file(table, name, motion)
            return
        if isinstance(table, schema.BoxTable):
            mesh = shapes.box(table.size, material)
        elif isinstance(table, schema.QuadTable):
            mesh = shapes.quad(table.size, material)
        elif isinstance(table, schema.SphereTable):
            mesh = shapes.sphere(table.radius_m, table.segments, material)
        else:
            raise TypeError(f"no shape is known for {type(table).__name__}")
        self.instances.append(Instance(len(self.meshes), motion, name))
        self.meshes.append(transformed(mesh, np.diag(_scale(table))))

    def _add_file(self, table: schema.FileTable, name: str, motion: Motion) -> None:
        parts = _read_parts(named_file(table.file, self.folder))
        first_mesh, first_material, first_texture = len(self.meshes), len(self.materials), len(self.textures)
        for mesh in parts.meshes:
            own = mesh.material_ids + first_material
            ids = own if table.material is None else np.full_like(own, self.material_ids[table.material])
            colors = mesh.colors if table.material is None else None
            self.meshes.append(replace(mesh, material_ids=ids, colors=colors))
        self.materials += [with_textures_from(material, first_texture) for material in parts.materials]
        self.textures += parts.textures
        self.warnings += parts.warnings
        self.notes += parts.notes
        stretch = compose((0.0, 0.0, 0.0), np.diag(_scale(table)))
        for part in parts.instances:
            index, inner = first_mesh + part.mesh, part.motion
            if isinstance(inner, Static) and self.meshes[index].deformation is None:
                index, offset = placed_rigidly(self.meshes, index, stretch @ inner.matrix)
                placed: Motion = Attached(motion, offset)
            elif is_similarity(stretch[:3, :3]):
                placed = Nested(Attached(motion, stretch), inner)
            else:
                raise InputError(f"{part.name} is animated, expected one scale for all axes, got {table.scale}")
            self.instances.append(Instance(index, placed, f"{name}/{part.name}"))
        for light in parts.lights:
            placed = Facing(Nested(Attached(motion, stretch), light.motion))
            self.punctual_lights.append(replace(light, motion=placed, name=f"{name}/{light.name}"))
        for sphere in parts.spheres:
            placed = Facing(Nested(Attached(motion, stretch), sphere.motion))
            size = float(np.cbrt(np.linalg.det(stretch[:3, :3])))
            radius_m = sphere.radius_m * size
            self.sphere_lights.append(replace(sphere, motion=placed, radius_m=radius_m, name=f"{name}/{sphere.name}"))


def _read_base(path: Path, *, drifts: bool) -> World:
    """Return the world of another program's file; its camera is in motion as where the file is the scene."""
    if path.suffix.lower() not in FOREIGN:
        raise InputError(f"{path.name}: expected a file of another program, ending in {', '.join(FOREIGN)}")
    world = load_foreign(path)
    return drifting(world) if drifts else world


def _read_parts(path: Path) -> Parts:
    if path.suffix.lower() in (".gltf", ".glb"):
        from clsim.scene.gltf.scene import read_gltf

        return read_gltf(path)
    if path.suffix.lower() in USD_ENDINGS:
        need_usd(path)
        from clsim.scene.usd.scene import read_usd

        return read_usd(path)
    from clsim.scene.meshes.trimesh_scene import load_parts

    return load_parts(path)


def _scale(table: schema.ObjectTable) -> Vec3:
    return table.scale if isinstance(table.scale, tuple) else (table.scale, table.scale, table.scale)


def _motion(
    table: schema.Placed,
    rotation_deg: Vec3 | None = None,
    target: Vec3 | None = None,
) -> Motion:
    """Return how something moves; ``target`` is looked at where the keyframes or the orbit name nothing else."""
    rotation = euler_quaternion(rotation_deg) if rotation_deg is not None else NO_TURN
    if table.keyframes is not None:
        return _keyframed(table.keyframes, target, table.interpolation)
    if table.orbit is not None:
        orbit = table.orbit
        return Orbit(
            orbit.center,
            orbit.radius_m,
            orbit.period_s,
            orbit.height_m,
            orbit.start_deg,
            orbit.degrees,
            orbit.clockwise,
            orbit.look_at or target,
            rotation,
        )
    position = table.position or (0.0, 0.0, 0.0)
    if target is not None:
        return Static(LookAtKeyframes((0.0,), (position,), (target,)).pose(0.0))
    return Static(compose(position, rotation_matrix(rotation)))


def _keyframed(
    keyframes: tuple[schema.KeyframeTable, ...], target: Vec3 | None, interpolation: Interpolation
) -> Motion:
    times = tuple(key.time_s for key in keyframes)
    positions = tuple(key.position for key in keyframes)
    turned = any(key.rotation_deg is not None or key.quaternion is not None for key in keyframes)
    targets = tuple(t for key in keyframes if (t := key.look_at or target) is not None)
    if len(targets) == len(keyframes) and not turned:
        if interpolation == "cubic" and len(times) > 1:
            return CubicKeyframes(times, positions, None, targets)
        return LookAtKeyframes(times, positions, targets)
    return through(times, positions, tuple(_rotation(key) for key in keyframes), interpolation)


def _rotation(key: schema.KeyframeTable) -> Quaternion:
    if key.quaternion is not None:
        return key.quaternion
    return NO_TURN if key.rotation_deg is None else euler_quaternion(key.rotation_deg)


def _camera(table: schema.CameraTable, folder: Path) -> Camera:
    target = table.look_at
    if table.orbit is not None and target is None and table.rotation_deg is None:
        target = table.orbit.center
    if table.trajectory is not None:
        file = named_file(table.trajectory, folder)
        motion = read_path(file, axes=table.trajectory_axes, interpolation=table.interpolation)
    else:
        motion = _motion(table, table.rotation_deg, target)
    if table.wander is not None:
        motion = Nested(motion, Wander(**table.wander.model_dump()))
    if table.shake is not None:
        motion = Nested(motion, Shake(**table.shake.model_dump()))
    fov_deg = table.fov_deg
    if table.focal_length_mm is not None:
        fov_deg = 2 * math.degrees(math.atan(table.sensor_width_mm / 2 / table.focal_length_mm))
    return Camera(*table.resolution, fov_deg, motion, table.shutter_s, Lens(**table.lens.model_dump()))


def _mount(table: schema.MountTable) -> Mount:
    turn = NO_TURN if table.rotation_deg is None else euler_quaternion(table.rotation_deg)
    lens = None if table.lens is None else Lens(**table.lens.model_dump())
    offset = compose(table.position, rotation_matrix(turn))
    return Mount(table.name, offset, table.resolution, table.fov_deg, lens, table.shutter_s)


@contextmanager
def _collecting(problems: list[str], place: str) -> Iterator[None]:
    """Note an InputError and go on, so that the user sees all of them."""
    try:
        yield
    except InputError as error:
        problems.append(f"{place}: {error}")
