"""From a scene's name or file to the world."""

from __future__ import annotations

import difflib
import os
from dataclasses import replace
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np

from clsim.errors import InputError
from clsim.scene.defaults.drift import drifting
from clsim.scene.files import need_file
from clsim.scene.foreign import FOREIGN, load_foreign
from clsim.scene.light.map_sun import part_sun
from clsim.scene.motion import Motion
from clsim.scene.trajectories.paths import on_path, read_path
from clsim.scene.trajectories.trajectory import Axes, Interpolation
from clsim.scene.validate import validate
from clsim.scene.world import Material, World
from clsim.values import read_value

SUFFIXES = (".toml", *FOREIGN)


def load_world(
    scene: str | Path,
    *,
    resolution: tuple[int, int] | None = None,
    strict: bool = False,
    camera_path: str | Path | None = None,
    camera_axes: Axes = "opencv",
    camera_interpolation: Interpolation = "linear",
) -> World:
    """Load a bundled scene by name, or a file: TOML, glTF, USD, OBJ, PLY, Mitsuba's XML, pbrt-v4's or MuJoCo's.

    ``Fox.glb#Walk`` plays the animation of that name (or index) alone. The camera of a file in which nothing moves is
    set in motion; a TOML's stays where it is.

    Args:
        scene: name or path.
        resolution: width and height in place of the scene's own; the horizontal field of view stays, pixels are square.
        strict: refuse a file that asks for something that clsim lacks, rather than warn.
        camera_path: a file of poses that the camera follows in place of its own motion; see `clsim.scene.read_path`.
        camera_axes: a camera's axes there: ``opencv`` looks along +z with y down, ``opengl`` along −z with +y up.
        camera_interpolation: how to join these poses: straight and by slerp, or along splines.

    Raises:
        InputError: if there is no such scene or it cannot be used; a TOML's problems stand one a line.
    """
    scene = read_value("scene", scene, str)
    resolution = read_value("resolution", resolution, tuple[int, int] | None)
    strict = read_value("strict", strict, bool)
    camera_path = read_value("camera_path", camera_path, str | None)
    camera_axes = read_value("camera_axes", camera_axes, Axes)
    camera_interpolation = read_value("camera_interpolation", camera_interpolation, Interpolation)
    with np.errstate(over="ignore", invalid="ignore"):  # what 32 bits cannot hold, validate names
        motion = None
        if camera_path is not None:
            motion = read_path(Path(camera_path), axes=camera_axes, interpolation=camera_interpolation)
        world = part_sun(_warned(_load(scene, motion)))
        if strict and world.warnings:
            raise InputError("\n".join(f"{sentence} (refused by strict)" for sentence in world.warnings))
        if not is_lit(world):
            dark = f"{world.name}: the scene has no light, so only noise fires: add one, as by [environment] in a TOML"
            world = replace(world, warnings=(*world.warnings, dark))
        if resolution is not None:
            world = replace(world, camera=replace(world.camera, width=resolution[0], height=resolution[1]))
        validate(world, str(scene))
    return world


def _warned(world: World) -> World:
    """Add what holds for worlds of all formats."""
    glassy = {i for i, material in enumerate(world.materials) if _is_glass(material)}
    used = {int(k) for instance in world.instances for k in np.unique(world.meshes[instance.mesh].material_ids)}
    if not (world.punctual_lights and glassy & used):
        return world
    sentence = (
        f"{world.name}: point, spot and directional lights do not shine through glass, as in Mitsuba and pbrt; "
        "a sphere or an area light does"
    )
    return replace(world, warnings=(*world.warnings, sentence))


def is_lit(world: World) -> bool:
    """Tell whether there is any light: the sky's, a lamp's, or that of a surface that emits."""
    lamps = [light.radiance for light in world.sphere_lights] + [light.intensity for light in world.punctual_lights]
    if any(map(any, (world.environment, *lamps))) or world.environment_map is not None:
        return True
    emissive = [i for i, material in enumerate(world.materials) if any(material.emission)]
    return any(np.isin(world.meshes[instance.mesh].material_ids, emissive).any() for instance in world.instances)


def _is_glass(material: Material) -> bool:
    principled = material.kind in ("principled", "disney") and material.transmission > 0
    return principled or material.kind in ("dielectric", "thin-dielectric")


def bundled_scenes() -> dict[str, str]:
    """Return the names of the bundled scenes and their descriptions."""
    from clsim.scene.toml.scene import read_toml

    found = {}
    for name in bundled_names():
        with as_file(files("clsim.scenes") / f"{name}.toml") as path:
            found[name] = str(read_toml(path).get("description", ""))
    return found


def bundled_names() -> list[str]:
    """Return the names of the bundled scenes."""
    names = (entry.name for entry in files("clsim.scenes").iterdir())
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))


def _load(scene: str | Path, motion: Motion | None) -> World:
    """Load a scene, and put its camera on another path where there is one."""

    def follow(world: World) -> World:
        return world if motion is None else on_path(world, motion)

    path, animation = Path(scene), None
    if "#" in path.name and not os.path.isfile(path):
        name, _, animation = path.name.rpartition("#")
        path = path.with_name(name or "#")
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        return follow(_load_bundled(str(scene)))
    need_file(path, "a scene")
    if animation is not None and suffix not in (".gltf", ".glb", ".xml"):
        raise InputError(f"{scene}: only glTF files have animations to choose from, and Mitsuba's parameters to set")
    if suffix == ".toml":
        from clsim.scene.toml.scene import load_toml

        return follow(load_toml(path))
    return drifting(follow(load_foreign(path, animation)))


def _load_bundled(name: str) -> World:
    from clsim.scene.toml.scene import load_toml

    names = bundled_names()
    if name not in names and os.path.isfile(name):
        ending = Path(name).suffix or "no ending"
        raise InputError(f"{name}: is no scene that clsim reads ({ending}), expected one of {', '.join(SUFFIXES)}")
    if name not in names:
        close = difflib.get_close_matches(name, names, 1)
        hint = f"did you mean {close[0]}? " if close else ""
        raise InputError(
            f"there is no scene {name!r}: {hint}expected one of {', '.join(names)}, "
            f"or a file ending in {', '.join(SUFFIXES)}"
        )
    with as_file(files("clsim.scenes") / f"{name}.toml") as path:
        return load_toml(path)
