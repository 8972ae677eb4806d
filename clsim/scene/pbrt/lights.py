"""pbrt-v4's lights: those without size, and images at infinity."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from clsim.errors import InputError
from clsim.scene.motion import Matrix, Static, compose, look_at
from clsim.scene.pbrt.materials import MaterialReader
from clsim.scene.pbrt.shapes import latitude_longitude
from clsim.scene.pbrt.tokens import Parameters, file_of
from clsim.scene.pictures.images import PixelBudget, read_linear
from clsim.scene.rigid import without_stretch
from clsim.scene.world import EnvironmentMap, PunctualLight, Vec3

InMirror = Callable[[Matrix], PunctualLight]
"""Makes a light once it is known whether the world is mirrored."""


def light_color(
    materials: MaterialReader, parameters: Parameters, name: str, total: str = "", total_of_one: float = 1.0
) -> Vec3:
    """Return what a light sends out, its scale included.

    Args:
        materials: what reads colours.
        parameters: those of the light.
        name: that of its colour.
        total: the parameter, if any, that tells how much the light sends out in all.
        total_of_one: how much that is where the light's colour is 1.
    """
    scale = parameters.number("scale", 1.0)
    if (wanted := parameters.number(total, 0.0)) > 0:
        scale *= wanted / total_of_one
    r, g, b = (max(channel * scale, 0.0) for channel in materials.color(parameters, name, 1.0, emits=True))
    return r, g, b


def read_punctual(kind: str, materials: MaterialReader, parameters: Parameters, matrix: Matrix) -> InMirror | None:
    """Return a light without size; None where clsim lacks its kind.

    Args:
        kind: pbrt's name of it.
        materials: what reads colours.
        parameters: those of the light.
        matrix: from the light's space to pbrt's world.

    Raises:
        InputError: with file and line, if the light shines nowhere.
    """
    if kind not in ("point", "spot", "distant"):
        return None
    outer = parameters.number("coneangle", 30.0)
    inner = max(outer - parameters.number("conedeltaangle", 5.0), 0.0)
    if kind == "distant":
        color = light_color(materials, parameters, "L", "illuminance")
    else:
        # As pbrt has it, a spot is on average half as bright between its two cones.
        cosine = -1.0 if kind == "point" else (math.cos(math.radians(inner)) + math.cos(math.radians(outer))) / 2
        color = light_color(materials, parameters, "I", "power", 2 * math.pi * (1 - cosine))
    start, target = (
        np.zeros(3) if rows is None else rows[0] for rows in (parameters.rows(3, "from"), parameters.rows(3, "to"))
    )
    if "to" not in parameters.found:
        target = np.array((0.0, 0.0, 1.0))
    if kind != "point" and np.allclose(start, target):
        raise InputError(f"{parameters.place}: the light shines from {start} to itself")
    ends = [matrix[:3, :3] @ point + matrix[:3, 3] for point in (start, target)]

    def placed(mirror: Matrix) -> PunctualLight:
        position, aim = (mirror[:3, :3] @ end for end in ends)
        if kind == "point":
            return PunctualLight("point", color, Static(compose(position, np.eye(3))))
        motion = Static(look_at(position, aim))
        if kind == "distant":
            return PunctualLight("directional", color, motion)
        return PunctualLight("spot", color, motion, inner, outer, "smooth")

    return placed


def read_environment(
    parameters: Parameters, matrix: Matrix, folder: Path, warn: Callable[[str], None]
) -> Callable[[Matrix], EnvironmentMap] | None:
    """Return what makes an infinite light's image once it is known whether the world is mirrored; None without image.

    Raises:
        InputError: with file and line, if the image cannot be read.
    """
    name = parameters.word("filename", "")
    if not name:
        return None
    if "illuminance" in parameters.found:
        warn("the illuminance of infinite lights with images is left out")
    image = read_linear(file_of(parameters.place, name, folder), PixelBudget())
    image = image * np.float32(parameters.number("scale", 1.0))
    turn = without_stretch(matrix)  # a mirror is part of how the image lies

    def placed(mirror: Matrix) -> EnvironmentMap:
        return EnvironmentMap(latitude_longitude(image, turn.T @ mirror[:3, :3]), np.eye(3))

    return placed
