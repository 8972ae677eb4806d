"""From a world's lights to the arrays that the kernels read, and their change from frame to frame."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.render import lights_punctual
from clsim.render.environment import LUMINANCE, EnvironmentImage, EnvironmentTables, steps, tabulate
from clsim.render.features import SceneFeatures
from clsim.render.light_choice import arriving, fair
from clsim.render.lights import Lamp, Lights
from clsim.render.lights_punctual import Punctual
from clsim.render.placement import Placement
from clsim.render.upload_arrays import array, write
from clsim.scene import Mesh, Motion, World
from clsim.scene.modulation import Modulation

_F64 = npt.NDArray[np.float64]


class LightData:
    """The lights of a world on a device; each has its share of the power at time 0, with the most light it ever has.

    Attributes:
        lights: what the kernel takes.
    """

    def __init__(
        self,
        world: World,
        placement: Placement,
        middle_m: _F64,
        radius_m: float,
        features: SceneFeatures,
        times_s: _F64,
        device: Any,
    ) -> None:
        """Number the lights, give each its probability and put those without size where they are at those times."""
        self._device = device
        self._features = features
        self._punctual_lights = world.punctual_lights
        self._origin_m = placement.origin_m
        emission = np.array([material.emission for material in world.materials]).reshape(-1, 3)
        sides = np.array([2.0 if material.emits_behind else 1.0 for material in world.materials])
        brightest = np.array([_largest(material.modulation) for material in world.materials])
        power_of = emission @ LUMINANCE * sides * math.pi * brightest
        ranks, emitting = [], []
        for mesh in placement.meshes:
            emits = power_of[mesh.material_ids] > 0 if len(power_of) else np.zeros(len(mesh.triangles), bool)
            ranks.append(np.where(emits, np.cumsum(emits) - 1, -1))
            emitting.append(np.flatnonzero(emits))
        first_triangle = np.cumsum([0, *(len(mesh.triangles) for mesh in placement.meshes)])
        powers: list[_F64] = []
        instance_of, triangle_of, instance_first = [], [], [0]
        for k, instance in enumerate(placement.instances):
            mesh, local = placement.meshes[instance.mesh], emitting[instance.mesh]
            corners = (mesh.vertices @ instance.motion.pose(0.0)[:3, :3].T)[mesh.triangles[local]]
            cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            powers.append(0.5 * np.linalg.norm(cross, axis=1) * power_of[mesh.material_ids[local]])
            instance_of.append(np.full(len(local), k))
            triangle_of.append(first_triangle[instance.mesh] + local)
            instance_first.append(instance_first[-1] + len(local))
        far = [np.zeros(instance_first[-1], bool)]
        for light in world.sphere_lights:
            surface_m2 = 4 * math.pi * light.radius_m**2
            power_w = surface_m2 * math.pi * float(np.dot(light.radiance, LUMINANCE)) * _largest(light.modulation)
            share = arriving(self._distance(light.motion, middle_m), radius_m)
            powers.append(np.array([power_w * share]))
            far.append(np.array([share < 1.0]))
        for punctual in world.punctual_lights:
            power_w = lights_punctual.power(punctual, radius_m) @ LUMINANCE * _largest(punctual.modulation)
            powers.append(np.array([power_w]))
            far.append(np.array([punctual.kind == "directional"]))
        sizeless = len(world.sphere_lights) + len(world.punctual_lights)
        power = fair(np.concatenate(powers), np.concatenate(far), sizeless)
        sky = float(np.dot(world.environment, LUMINANCE))
        self.lights = lights = Lights()
        if world.environment_map is not None:
            tables = tabulate(world.environment_map, world.environment)
            lights.environment_image = self._environment_image(tables, world.environment_map.to_world)
            sky = tables.mean
        environment = sky * (2 * math.pi * max(radius_m, 1e-3)) ** 2
        # Scattering finds a constant environment just as well, so that lamps keep at least half of the samples.
        power = np.append(power, min(environment, power.sum()) if power.sum() > 0 else environment)

        cumulative = steps(np.cumsum(power))
        probability = np.diff(cumulative, prepend=np.float32(0.0))
        lights.cumulative = array(cumulative, wp.float32, device)
        lights.probability = array(probability, wp.float32, device)
        lights.instance = array(np.concatenate(instance_of), wp.int32, device)
        lights.triangle = array(np.concatenate(triangle_of), wp.int32, device)
        lights.instance_first = array(instance_first[:-1], wp.int32, device)
        lights.triangle_rank = array(np.concatenate(ranks), wp.int32, device)
        if features.still_lamps:
            lights.lamps = self._lamps(placement.meshes[0], emitting[0])
        lights.first_sphere = instance_first[-1]
        lights.sphere_radiance = array([light.radiance for light in world.sphere_lights], wp.vec3, device)
        lights.first_punctual = lights.first_sphere + len(world.sphere_lights)
        lights.punctual = self._punctual_table(times_s)
        lights.first_environment = lights.first_punctual + len(world.punctual_lights)
        lights.environment = wp.vec3(*world.environment)
        lights.environment_probability = float(probability[-1])

    def _distance(self, motion: Motion, middle_m: _F64) -> float:
        """Return how far a light is from the middle of the scene, given from the device's origin, at time 0 [m]."""
        return float(np.linalg.norm(motion.pose(0.0)[:3, 3] - self._origin_m - middle_m))

    def update(self, times_s: _F64) -> None:
        """Put the lights without size where they are at those times; work only where one moves, or times are others."""
        if self._features.instants and len(times_s) * len(self._punctual_lights) > len(self._punctual.positions):
            self.lights.punctual = self._punctual_table(times_s)
        elif self._features.instants or any(light.motion.duration_s > 0 for light in self._punctual_lights):
            tables = lights_punctual.rows(self._punctual_lights, times_s, self._origin_m, self._features)
            for out, rows in zip(
                (self._punctual.positions, self._punctual.steps, self._punctual.axes), tables, strict=True
            ):
                write(out, rows)

    def _lamps(self, mesh: Mesh, triangles: npt.NDArray[np.int64]) -> Any:
        """Return the table of emitting triangles, all of them in the mesh of what never moves."""
        corners = mesh.vertices[mesh.triangles[triangles]].astype(np.float64)
        rows = np.zeros(len(triangles), Lamp.numpy_dtype())
        rows["corner"] = corners[:, 0]
        rows["edge1"], rows["edge2"] = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        ends = [rows["corner"] + rows[edge] for edge in ("edge1", "edge2")]
        rows["reach_m"] = np.abs([rows["corner"], *ends]).max(axis=(0, 2), initial=0)
        cross = np.cross(rows["edge1"].astype(np.float64), rows["edge2"].astype(np.float64))
        length = np.linalg.norm(cross, axis=1)
        rows["normal"] = cross / np.maximum(length, 1e-300)[:, None]
        rows["area"] = 0.5 * length
        rows["material"] = mesh.material_ids[triangles]
        return array(rows, Lamp, self._device)

    def _punctual_table(self, times_s: _F64) -> Any:
        lights, table = self._punctual_lights, Punctual()
        positions, steps_m, axes = lights_punctual.rows(lights, times_s, self._origin_m, self._features)
        table.count = len(lights)
        table.directional = array([int(light.kind == "directional") for light in lights], wp.int32, self._device)
        table.intensity = array([light.intensity for light in lights], wp.vec3, self._device)
        table.falloff = array([lights_punctual.falloff(light) for light in lights], wp.vec2, self._device)
        table.curve = array([lights_punctual.CURVES[light.falloff] for light in lights], wp.int32, self._device)
        table.positions = array(positions, wp.vec3, self._device)
        table.steps = array(steps_m, wp.vec3, self._device)
        table.axes = array(axes, wp.vec3, self._device)
        self._punctual = table
        return table

    def _environment_image(self, tables: EnvironmentTables, to_world: _F64) -> Any:
        image = EnvironmentImage()
        image.radiance = wp.array(tables.radiance, dtype=wp.vec3, device=self._device)
        image.rows = array(tables.rows, wp.float32, self._device)
        image.columns = array(tables.columns.ravel(), wp.float32, self._device)
        image.to_world = wp.mat33(*np.asarray(to_world, np.float64).ravel())
        return image


def _largest(modulation: Modulation | None) -> float:
    """Return how bright a light may become, as a multiple of its own radiance."""
    return 1.0 if modulation is None else modulation.largest
