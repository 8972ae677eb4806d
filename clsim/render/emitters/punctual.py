# ruff: noqa: SIM102
"""Lights without size, as KHR_lights_punctual defines them: points, spots and directional lights."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.render.accel.geometry import make_row
from clsim.render.features.features import Features, SceneFeatures
from clsim.render.motion.shutter import key_steps, position_between, shutter_key, shutter_weight
from clsim.render.textures.texture_data import Textures
from clsim.render.textures.textures import make_textures
from clsim.scene import PunctualLight
from clsim.scene.world import Falloff

_FAR = wp.constant(1.0e30)
CURVES: dict[Falloff, int] = {"squared": 0, "linear": 1, "smooth": 2, "frame": 3}
_LINEAR = wp.constant(CURVES["linear"])
_SMOOTH = wp.constant(CURVES["smooth"])
_FRAME = wp.constant(CURVES["frame"])


@wp.struct
class Punctual:
    """The lights; positions and axes (where a light shines) light by light for each key of the interval or instant.

    A spot fades as ``clamp(x·scale + offset)``, of which ``curve`` makes its falloff; x is the cosine to its axis, and
    the angle [rad] where the curve is linear. A point has scale 0 and offset 1. ``picture`` is the texture that a spot
    shows, −1 for none, ``rights`` are its axes to the right.
    """

    count: int
    directional: wp.array[int]
    intensity: wp.array[wp.vec3]
    falloff: wp.array[wp.vec2]
    curve: wp.array[int]
    positions: wp.array[wp.vec3]
    steps: wp.array[wp.vec3]
    axes: wp.array[wp.vec3]
    rights: wp.array[wp.vec3]
    picture: wp.array[int]
    picture_size: wp.array[wp.vec2]


@wp.struct
class PunctualSample:
    """The way to a light, and its irradiance [W·m⁻²] on a surface across that way."""

    direction: wp.vec3
    distance: float
    irradiance: wp.vec3


def make_punctual(features: Features) -> Any:
    """Return the Warp function ``towards_punctual(lights, textures, index, position, time)``."""
    row_at = make_row(features)
    lookup, *_ = make_textures(features)

    @wp.func
    def axis_at(axes: wp.array[wp.vec3], count: int, index: int, time: float) -> wp.vec3:
        axis = axes[row_at(count, index, time)]
        if wp.static(features.motion_blur):
            first = shutter_key(time) * count + index
            axis = wp.lerp(axes[first], axes[first + count], shutter_weight(time))
        return axis

    @wp.func
    def pictured(
        lights: Punctual, textures: Textures, index: int, axis: wp.vec3, direction: wp.vec3, time: float
    ) -> wp.vec3:
        """Return what a spot's picture makes of its light in a direction, within a right angle of its axis."""
        right = wp.normalize(axis_at(lights.rights, lights.count, index, time))
        size = lights.picture_size[index]
        cosine = wp.max(wp.dot(direction, axis), 1.0e-6)
        x = wp.dot(direction, right) / (cosine * size[0])
        y = wp.dot(direction, wp.cross(right, axis)) / (cosine * size[1])
        rgba = lookup(textures, lights.picture[index], wp.vec2(0.5 + 0.5 * x, 0.5 + 0.5 * y))
        color = wp.vec3(rgba[0], rgba[1], rgba[2])
        if lights.curve[index] == _FRAME:
            color = color / (cosine * cosine * cosine)
            if wp.abs(x) > 1.0 or wp.abs(y) > 1.0 or wp.dot(direction, axis) <= 0.0:
                color = wp.vec3()
        return color

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
    def towards_punctual(
        lights: Punctual, textures: Textures, index: int, position: wp.vec3, time: float
    ) -> PunctualSample:
        axis = wp.normalize(axis_at(lights.axes, lights.count, index, time))
        sample = PunctualSample(-axis, _FAR, lights.intensity[index])  # type: ignore[call-arg]
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
            if curve == _FRAME:
                share = 1.0
            sample.irradiance = sample.irradiance * (share / (sample.distance * sample.distance))
            if wp.static(features.light_pictures):
                if lights.picture[index] >= 0:
                    tint = pictured(lights, textures, index, axis, -sample.direction, time)
                    sample.irradiance = wp.cw_mul(sample.irradiance, tint)
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
    if light.falloff == "frame":
        # What falls on a plane at a distance of 1.
        return intensity * (4.0 * abs(light.picture_size[0] * light.picture_size[1]))
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
    """Return positions from the origin, steps (``shutter.key_steps``), axes, rights: ``[times · lights, 3]`` each."""
    poses = np.array([light.motion.pose(float(t)) for t in times_s for light in lights]).reshape(len(times_s), -1, 4, 4)
    axes = -poses[..., :3, 2] / np.linalg.norm(poses[..., :3, 2], axis=-1, keepdims=True)
    rights = poses[..., :3, 0] / np.linalg.norm(poses[..., :3, 0], axis=-1, keepdims=True)
    positions = poses[..., :3, 3] - origin_m
    steps = np.zeros_like(positions)
    if features.motion_blur:
        steps = key_steps([light.motion for light in lights], times_s, positions)
    return tuple(table.reshape(-1, 3).astype(np.float32) for table in (positions, steps, axes, rights))
