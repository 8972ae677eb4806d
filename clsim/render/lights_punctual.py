# Warp: a variable that changes must be born by a call, and wp.static drops a branch only where it stands alone.
"""Lights without size, as KHR_lights_punctual defines them: points, spots and directional lights."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.render.features import Features
from clsim.render.shutter import shutter_key, shutter_weight
from clsim.scene import PunctualLight

_FAR = wp.constant(1.0e30)


@wp.struct
class Punctual:
    """The lights; positions and axes (where a light shines) light by light for each key of the exposure.

    A spot's falloff is ``clamp(cos·scale + offset)²``; a point has scale 0 and offset 1.
    """

    count: int
    directional: wp.array(dtype=int)
    intensity: wp.array(dtype=wp.vec3)
    falloff: wp.array(dtype=wp.vec2)
    positions: wp.array(dtype=wp.vec3)
    axes: wp.array(dtype=wp.vec3)


@wp.struct
class PunctualSample:
    """The way to a light, and its irradiance [W·m⁻²] on a surface across that way."""

    direction: wp.vec3
    distance: float
    irradiance: wp.vec3


def make_punctual(features: Features) -> Any:
    """Return the Warp function ``towards_punctual(lights, index, position, time)``."""

    @wp.func
    def blended(table: wp.array(dtype=wp.vec3), count: int, index: int, time: float) -> wp.vec3:
        value = table[index]
        if wp.static(features.motion_blur):
            first = shutter_key(time) * count + index
            value = wp.lerp(table[first], table[first + count], shutter_weight(time))
        return value

    @wp.func
    def towards_punctual(lights: Punctual, index: int, position: wp.vec3, time: float) -> PunctualSample:
        axis = wp.normalize(blended(lights.axes, lights.count, index, time))
        sample = PunctualSample(-axis, _FAR, lights.intensity[index])
        if lights.directional[index] == 0:
            away = blended(lights.positions, lights.count, index, time) - position
            sample.distance = wp.max(wp.length(away), 1.0e-15)
            sample.direction = away / sample.distance
            falloff = lights.falloff[index]
            cone = wp.clamp(wp.dot(-sample.direction, axis) * falloff[0] + falloff[1], 0.0, 1.0)
            sample.irradiance = sample.irradiance * (cone * cone / (sample.distance * sample.distance))
        return sample

    return towards_punctual


def falloff(light: PunctualLight) -> tuple[float, float]:
    """Return scale and offset of a light's cone (KHR_lights_punctual, "Inner and outer cone angles")."""
    if light.kind != "spot":
        return 0.0, 1.0
    inner, outer = math.cos(math.radians(light.inner_deg)), math.cos(math.radians(light.outer_deg))
    scale = 1.0 / max(inner - outer, 0.001)
    return scale, -outer * scale


def power(light: PunctualLight, radius_m: float) -> npt.NDArray[np.float64]:
    """Return the power [W] in R, G, B that a light sends into a scene of that radius."""
    intensity = np.asarray(light.intensity, np.float64)
    if light.kind == "directional":
        return intensity * (math.pi * radius_m**2)
    if light.kind == "point":
        return intensity * (4 * math.pi)
    scale, offset = falloff(light)
    # The integral of the squared ramp from the outer cone to where it reaches 1, then the full cone.
    full = (1.0 - offset) / scale
    return intensity * (2 * math.pi * (1.0 / (3.0 * scale) + 1.0 - min(full, 1.0)))


def rows(lights: Sequence[PunctualLight], times_s: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.float32], ...]:
    """Return positions and axes at those times, both ``[times · lights, 3]``."""
    poses = np.array([light.motion.pose(float(t)) for t in times_s for light in lights]).reshape(-1, 4, 4)
    axes = -poses[:, :3, 2] / np.linalg.norm(poses[:, :3, 2], axis=1, keepdims=True)
    return poses[:, :3, 3].astype(np.float32), axes.astype(np.float32)
