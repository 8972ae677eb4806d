"""From a world's lights to the arrays that the kernels read, and their change from frame to frame."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.render.accel.placement import Placement
from clsim.render.device.arrays import array, table, write
from clsim.render.emitters import punctual as lights_punctual
from clsim.render.emitters.environment_build import LUMINANCE, steps, tabulate, upload_environment
from clsim.render.emitters.light_choice import fair
from clsim.render.emitters.light_list import small_lights, triangle_lights
from clsim.render.emitters.light_tree_build import TreeOfLights
from clsim.render.emitters.light_tree_moving import MovingBounds
from clsim.render.emitters.lights import Lamp, Lights
from clsim.render.emitters.punctual import Punctual
from clsim.render.features.features import SceneFeatures
from clsim.scene import Mesh, World

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
        triangles = triangle_lights(world, placement)
        small = small_lights(world, placement.origin_m, middle_m, radius_m)
        power = np.concatenate([triangles.power, small.power])
        far = np.concatenate([np.zeros(len(triangles.power), bool), small.far])
        in_tree = np.concatenate([triangles.in_tree, small.in_tree]) & (power > 0) & features.light_tree
        self.lights = lights = Lights()
        lights.first_sphere = len(triangles.power)
        lights.first_punctual = lights.first_sphere + len(world.sphere_lights)
        lights.first_environment = lights.first_punctual + len(world.punctual_lights)
        sky = float(np.dot(world.environment, LUMINANCE))
        if world.environment_map is not None:
            tables = tabulate(world.environment_map, world.environment)
            lights.environment_image = upload_environment(tables, world.environment_map.to_world, device)
            sky = tables.mean
        environment = sky * (2 * math.pi * max(radius_m, 1e-3)) ** 2
        cumulative = steps(np.cumsum(_shares(power, far, in_tree, lights.first_sphere, environment)))
        probability = np.diff(cumulative, prepend=np.float32(0.0))
        lights.cumulative = array(cumulative, wp.float32, device)
        # One more: where all is dark, what is drawn lies beyond the last entry.
        lights.probability = array(np.append(probability, np.float32(0.0)), wp.float32, device)
        lights.instance = array(triangles.instance, wp.int32, device)
        lights.triangle = array(triangles.triangle, wp.int32, device)
        lights.instance_first = array(triangles.instance_first[:-1], wp.int32, device)
        lights.triangle_rank = array(triangles.ranks, wp.int32, device)
        if features.still_lamps:
            lights.lamps = self._lamps(placement.meshes[0], triangles.of_mesh[0])
        lights.sphere_radiance = array([light.radiance for light in world.sphere_lights], wp.vec3, device)
        lights.punctual = self._punctual_table(times_s)
        lights.environment = wp.vec3(*world.environment)
        lights.environment_probability = float(probability[lights.first_environment])
        if features.light_tree:
            # The kernel looks into it even where all such lights are dark or far.
            bounds = np.concatenate([triangles.bounds, small.bounds])[in_tree]
            share = float(probability[-1]) if in_tree.any() else 0.0
            held = np.flatnonzero(in_tree)
            self._tree = TreeOfLights(bounds, held, len(power), share, device)
            lights.tree = self._tree.tree
            self._moving = MovingBounds(world, placement, triangles, held)
            self._follow(times_s)

    def update(self, times_s: _F64) -> None:
        """Put what moves of the lights where it is at those times; work only where one moves, or times are others."""
        self._follow(times_s)
        if self._features.instants and len(times_s) * len(self._punctual_lights) > len(self._punctual.positions):
            self.lights.punctual = self._punctual_table(times_s)
        elif self._features.instants or any(light.motion.duration_s > 0 for light in self._punctual_lights):
            tables = lights_punctual.rows(self._punctual_lights, times_s, self._origin_m, self._features)
            own = self._punctual
            for out, rows in zip((own.positions, own.steps, own.axes, own.rights), tables, strict=True):
                write(out, rows)

    @property
    def follows(self) -> bool:
        """Whether there is a tree of lights, some of which move."""
        return self._features.light_tree and len(self._moving.rows) > 0

    def _follow(self, times_s: _F64) -> None:
        """Let the tree know where its lights are at those times."""
        if self.follows:
            self._tree.refit(self._moving.rows, self._moving.at(times_s))

    def _lamps(self, mesh: Mesh, triangles: npt.NDArray[np.int64]) -> Any:
        """Return the table of emitting triangles, all of them in the mesh of what never moves."""
        corners = mesh.vertices[mesh.triangles[triangles]].astype(np.float64)
        rows = table(Lamp, len(triangles))
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
        positions, steps_m, axes, rights = lights_punctual.rows(lights, times_s, self._origin_m, self._features)
        table.count = len(lights)
        table.directional = array([int(light.kind == "directional") for light in lights], wp.int32, self._device)
        table.intensity = array([light.intensity for light in lights], wp.vec3, self._device)
        table.falloff = array([lights_punctual.falloff(light) for light in lights], wp.vec2, self._device)
        table.curve = array([lights_punctual.CURVES[light.falloff] for light in lights], wp.int32, self._device)
        table.positions = array(positions, wp.vec3, self._device)
        table.steps = array(steps_m, wp.vec3, self._device)
        table.axes = array(axes, wp.vec3, self._device)
        table.rights = array(rights, wp.vec3, self._device)
        table.picture = array([light.picture for light in lights], wp.int32, self._device)
        table.picture_size = array([light.picture_size for light in lights], wp.vec2, self._device)
        self._punctual = table
        return table


def _shares(power: _F64, far: npt.NDArray[np.bool_], in_tree: npt.NDArray[np.bool_], small: int, sky: float) -> _F64:
    """Return the entries to draw from: one a light, one of the environment, and one of the tree where there is one.

    Args:
        power: of each light [W].
        far: whether it is far.
        in_tree: whether the tree tells its share.
        small: number of the first light that is no triangle.
        sky: what the environment sends into the scene [W].
    """
    not_in_tree = ~in_tree
    # The tree stands between triangles and small lights: it may hold some of these, and has a least share as they do.
    middle = np.array([power[in_tree].sum()]) if in_tree.any() else np.zeros(0)
    flat = [power[:small][not_in_tree[:small]], middle, power[small:][not_in_tree[small:]]]
    near = [far[:small][not_in_tree[:small]], np.zeros(len(middle), bool), far[small:][not_in_tree[small:]]]
    drawn = fair(np.concatenate(flat), np.concatenate(near), len(middle) + len(flat[2]))
    # Scattering finds a constant environment just as well, so that lamps keep at least half of the samples.
    sky = min(sky, float(drawn.sum())) if drawn.sum() > 0 else sky
    own = np.zeros(len(power))
    own[not_in_tree] = np.delete(drawn, len(flat[0])) if len(middle) else drawn
    return np.concatenate([own, [sky], drawn[len(flat[0]) : len(flat[0]) + len(middle)]])
