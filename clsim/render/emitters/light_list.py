"""A world's lights in the order of their numbers: how much each sends out, and what is known of where it does."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.render.accel.placement import Placement
from clsim.render.emitters import punctual as lights_punctual
from clsim.render.emitters.emission_textures import mean_emission
from clsim.render.emitters.environment_build import LUMINANCE
from clsim.render.emitters.light_choice import arriving
from clsim.render.emitters.light_tree_build import around, of_spot, of_triangles
from clsim.render.features.scene_lamps import in_light_tree, tree_follows
from clsim.render.motion.deform import deforms
from clsim.scene import PunctualLight, SphereLight, World
from clsim.scene.modulation import Modulation

_F64 = npt.NDArray[np.float64]
_I64 = npt.NDArray[np.int64]
_Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class TriangleLights:
    """The triangles that emit, each instance's own.

    Attributes:
        power: of each [W], with the most light it ever has.
        in_tree: whether a light tree may hold it.
        bounds: what a light tree knows of each at time 0.
        instance, triangle: where each is: the instance, and the number among all triangles of all meshes.
        instance_first: number of the first one of each instance, and how many there are.
        ranks: for each triangle of each mesh its number among those that emit, −1 where it does not.
        of_mesh: those of each mesh that emit.
    """

    power: _F64
    in_tree: _Flags
    bounds: npt.NDArray[Any]
    instance: _I64
    triangle: _I64
    instance_first: _I64
    ranks: _I64
    of_mesh: list[_I64]


def triangle_lights(world: World, placement: Placement) -> TriangleLights:
    """Return the triangles that emit, by the light of the materials on their fronts, and of their textures' mean."""
    follows = tree_follows(world)
    sides = np.array([2.0 if material.emits_behind else 1.0 for material in world.materials])
    brightest = np.array([_largest(material.modulation) for material in world.materials])
    luminance_of = [mean_emission(world, mesh) for mesh in placement.meshes]
    ranks, of_mesh = [], []
    for luminance in luminance_of:
        emits = luminance > 0
        ranks.append(np.where(emits, np.cumsum(emits) - 1, -1))
        of_mesh.append(np.flatnonzero(emits))
    first_triangle = np.cumsum([0, *(len(mesh.triangles) for mesh in placement.meshes)])
    powers, in_tree, bounds, instance_of, triangle_of, first = [], [], [], [], [], [0]
    for k, instance in enumerate(placement.instances):
        mesh, local = placement.meshes[instance.mesh], of_mesh[instance.mesh]
        pose = instance.motion.pose(0.0)
        corners = (mesh.vertices @ pose[:3, :3].T)[mesh.triangles[local]]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        ids = mesh.material_ids[local]
        luminance = luminance_of[instance.mesh][local] * brightest[ids]
        powers.append(0.5 * np.linalg.norm(cross, axis=1) * (luminance * sides[ids] * math.pi))
        held = (follows or instance.motion.duration_s == 0) and not deforms(mesh)
        in_tree.append(np.full(len(local), held))
        bounds.append(of_triangles(corners + (pose[:3, 3] - placement.origin_m), luminance, sides[ids] > 1))
        instance_of.append(np.full(len(local), k))
        triangle_of.append(first_triangle[instance.mesh] + local)
        first.append(first[-1] + len(local))
    return TriangleLights(
        np.concatenate(powers),
        np.concatenate(in_tree),
        np.concatenate(bounds),
        np.concatenate(instance_of),
        np.concatenate(triangle_of),
        np.array(first),
        np.concatenate(ranks),
        of_mesh,
    )


@dataclass(frozen=True)
class SmallLights:
    """Spheres, and lights without size.

    Attributes:
        power: what each sends into the scene [W], with the most light it ever has.
        far: whether it comes from so far that it is spread over the whole scene.
        in_tree: whether a light tree may hold it.
        bounds: what that knows of each.
    """

    power: _F64
    far: _Flags
    in_tree: _Flags
    bounds: npt.NDArray[Any]


def small_lights(world: World, origin_m: _F64, middle_m: _F64, radius_m: float) -> SmallLights:
    """Return spheres and lights without size, for a scene of that middle, from the device's origin, and radius."""
    lights: tuple[SphereLight | PunctualLight, ...] = (*world.sphere_lights, *world.punctual_lights)
    power, far = np.zeros(len(lights)), np.zeros(len(lights), bool)
    bounds = [around(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))]
    for i, light in enumerate(lights):
        pose, most = light.motion.pose(0.0), _largest(light.modulation)
        if isinstance(light, SphereLight):
            share = arriving(float(np.linalg.norm(pose[:3, 3] - origin_m - middle_m)), radius_m)
            radiance = float(np.dot(light.radiance, LUMINANCE))
            power[i] = 4 * math.pi * light.radius_m**2 * math.pi * radiance * most * share
            far[i] = share < 1.0
        else:
            power[i] = lights_punctual.power(light, radius_m) @ LUMINANCE * most
            far[i] = light.kind == "directional"
        bounds.append(bounds_of_small(light, pose, origin_m))
    follows = tree_follows(world)
    in_tree = np.array([in_light_tree(light, follows) for light in lights], bool) & ~far
    return SmallLights(power, far, in_tree, np.concatenate(bounds))


def bounds_of_small(light: SphereLight | PunctualLight, pose: _F64, origin_m: _F64) -> npt.NDArray[Any]:
    """Return what a light tree knows of a sphere, or of a light without size, that is at a pose ``[4, 4]``."""
    position, most = pose[:3, 3] - origin_m, _largest(light.modulation)
    if isinstance(light, SphereLight):
        low, high = (position + light.radius_m * side for side in (-1.0, 1.0))
        radiance = float(np.dot(light.radiance, LUMINANCE))
        return around(low[None], high[None], np.array([math.pi * light.radius_m**2 * radiance * most]))
    intensity = float(np.dot(light.intensity, LUMINANCE)) * most
    if light.kind == "spot":
        axis = -pose[:3, 2]
        return of_spot(position, axis / np.linalg.norm(axis), light.outer_deg, intensity)
    return around(position[None], position[None], np.array([intensity]))


def _largest(modulation: Modulation | None) -> float:
    """Return how bright a light may become, as a multiple of its own radiance."""
    return 1.0 if modulation is None else modulation.largest
