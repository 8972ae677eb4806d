# Warp: a variable that changes must be born by a call, and wp.static drops a branch only where it stands alone.
"""Lights without size, as KHR_lights_punctual defines them: points, spots and directional lights."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.render.features import Features, SceneFeatures
from clsim.render.geometry import make_row
from clsim.render.shutter import key_steps, position_between, shutter_key, shutter_weight
from clsim.scene import PunctualLight
from clsim.scene.world import Falloff

_FAR = wp.constant(1.0e30)
CURVES: dict[Falloff, int] = {"squared": 0, "linear": 1, "smooth": 2}
_LINEAR = wp.constant(CURVES["linear"])
_SMOOTH = wp.constant(CURVES["smooth"])


@wp.struct
class Punctual:
    """The lights; positions and axes (where a light shines) light by light for each key of the interval or instant.

    A spot fades as ``clamp(x·scale + offset)``, of which ``curve`` makes its falloff; x is the cosine to its axis, and
    the angle [rad] where the curve is linear. A point has scale 0 and offset 1.
    """

    count: int
    directional: wp.array(dtype=int)
    intensity: wp.array(dtype=wp.vec3)
    falloff: wp.array(dtype=wp.vec2)
    curve: wp.array(dtype=int)
    positions: wp.array(dtype=wp.vec3)
    steps: wp.array(dtype=wp.vec3)
    axes: wp.array(dtype=wp.vec3)


@wp.struct
class PunctualSample:
    """The way to a light, and its irradiance [W·m⁻²] on a surface across that way."""

    direction: wp.vec3
    distance: float
    irradiance: wp.vec3


def make_punctual(features: Features) -> Any:
    """Return the Warp function ``towards_punctual(lights, index, position, time)``."""
    row_at = make_row(features)

    @wp.func
    def axis_at(lights: Punctual, index: int, time: float) -> wp.vec3:
        axis = lights.axes[row_at(lights.count, index, time)]
        if wp.static(features.motion_blur):
            first = shutter_key(time) * lights.count + index
            axis = wp.lerp(lights.axes[first], lights.axes[first + lights.count], shutter_weight(time))
        return axis

    @wp.func
    def position_at(lights: Punctual, index: int, time: float) -> wp.vec3:
        position = lights.positions[row_at(lights.count, index, time)]
        if wp.static(features.motion_blur):
            first = shutter_key(time) * lights.count + index
            after = first + lights.count
            position = position_between(
                lights.positions[first],
                lights.positions[after],
                lights.steps[first],
                lights.steps[after],
                shutter_weight(time),
            )
        return position

    @wp.func
    def towards_punctual(lights: Punctual, index: int, position: wp.vec3, time: float) -> PunctualSample:
        axis = wp.normalize(axis_at(lights, index, time))
        sample = PunctualSample(-axis, _FAR, lights.intensity[index])
        if lights.directional[index] == 0:
            away = position_at(lights, index, time) - position
            sample.distance = wp.max(wp.length(away), 1.0e-15)
            sample.direction = away / sample.distance
            falloff = lights.falloff[index]
            x = wp.dot(-sample.direction, axis)
            curve = lights.curve[index]
            if curve == _LINEAR:
                x = wp.acos(wp.clamp(x, -1.0, 1.0))
            cone = wp.clamp(x * falloff[0] + falloff[1], 0.0, 1.0)
            share = cone * cone
            if curve == _LINEAR:
                share = cone
            if curve == _SMOOTH:
                share = share * (3.0 - 2.0 * cone)
            sample.irradiance = sample.irradiance * (share / (sample.distance * sample.distance))
        return sample

    return towards_punctual


def falloff(light: PunctualLight) -> tuple[float, float]:
    """Return scale and offset of a light's cone, on the cosine or the angle.

    Source: KHR_lights_punctual, "Inner and outer cone angles"; Mitsuba 3's and pbrt-v4's manuals.
    """
    if light.kind != "spot":
        return 0.0, 1.0
    if light.falloff == "linear":
        scale = 1.0 / math.radians(max(light.outer_deg - light.inner_deg, 1e-3))
        return -scale, math.radians(light.outer_deg) * scale
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
    if light.falloff != "squared":
        cosine = np.linspace(math.cos(math.radians(light.outer_deg)), 1.0, 257)
        cone = np.clip((np.arccos(cosine) if light.falloff == "linear" else cosine) * scale + offset, 0.0, 1.0)
        share = cone if light.falloff == "linear" else cone * cone * (3.0 - 2.0 * cone)
        return intensity * (2 * math.pi * float(share.mean() * (cosine[-1] - cosine[0])))
    # The integral of the squared ramp from the outer cone to where it reaches 1, then the full cone.
    full = (1.0 - offset) / scale
    return intensity * (2 * math.pi * (1.0 / (3.0 * scale) + 1.0 - min(full, 1.0)))


def rows(
    lights: Sequence[PunctualLight],
    times_s: npt.NDArray[np.float64],
    origin_m: npt.NDArray[np.float64],
    features: SceneFeatures,
) -> tuple[npt.NDArray[np.float32], ...]:
    """Return positions from the origin, steps (``shutter.key_steps``) and axes, ``[times · lights, 3]`` each."""
    poses = np.array([light.motion.pose(float(t)) for t in times_s for light in lights]).reshape(len(times_s), -1, 4, 4)
    axes = -poses[..., :3, 2] / np.linalg.norm(poses[..., :3, 2], axis=-1, keepdims=True)
    positions = poses[..., :3, 3] - origin_m
    steps = np.zeros_like(positions)
    if features.motion_blur:
        steps = key_steps([light.motion for light in lights], times_s, positions)
    return tuple(table.reshape(-1, 3).astype(np.float32) for table in (positions, steps, axes))
