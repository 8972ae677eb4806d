"""A world on a device, over an interval of time, for any number of views."""

from __future__ import annotations

import math
import threading
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.errors import InputError
from clsim.render.accel.bvh16_build import grow
from clsim.render.accel.geometry import Tree
from clsim.render.accel.placement import place
from clsim.render.accel.smallest import smallest_of
from clsim.render.accel.upload_geometry import GeometryData, Places
from clsim.render.device.compiler import compile_together, precompile_headers
from clsim.render.device.devices import check_device, fastest_tree
from clsim.render.emitters.shining import Shining
from clsim.render.emitters.upload_lights import LightData
from clsim.render.features.scene_features import light_stands_still, scene_features
from clsim.render.features.scene_lamps import lamp_motions
from clsim.render.kernel_input import Scene
from clsim.render.motion.pose_cache import PoseCache
from clsim.render.motion.shutter import key_times
from clsim.render.options import RenderOptions
from clsim.render.paths.integrator import build_kernel
from clsim.render.surfaces.texture_levels import add_levels
from clsim.render.surfaces.upload_materials import upload_materials
from clsim.scene import Motion, World
from clsim.scene.validate import validate
from clsim.scene.world import Vec3

_MOST_SPHERES = 16
"""Lamps that are spheres from which on nobody asks in each frame how wide they are seen."""
_SPECK_PX = 2.0
"""What is no wider, from corner to corner of its box, may lie between the corners of a pixel [pixels]."""
_MOST_SPECKS = 128
"""Each pixel whose corners are alike is compared with all of them, which takes some ns each."""


class SceneData:
    """A scene on a device: trees, instances, lights and materials, moved by data and not rebuilt.

    Several ``View`` may share one: all that they render between two calls of ``move`` is of one instant.

    Attributes:
        world: the world, as it was given.
        features: what it has.
        tree: how rays find triangles.
        device: Warp's device.
        origin_m: the world's point at which the device has its origin.
        interval_s: the time that it covers, about the instant to which it was moved [s].
        lock: held by a view while it moves the scene and renders.
        light_changes: whether light changes by itself.
        scene: what kernels take.
        instance_objects, triangle_objects: which of the world's instances is seen (`Placement`).
        poses: those that were asked for, where there are several instants.
        still: whether nothing but cameras moves, so that all instants are alike.
    """

    def __init__(
        self,
        world: World,
        device: str = "cpu",
        tree: Tree | None = None,
        interval_s: float | None = None,
        instants: bool = False,
        ahead: RenderOptions | None = None,
        light_cache: bool = False,
    ) -> None:
        """Copy the world to the device and build its trees.

        Args:
            world: what is rendered.
            device: render device, "cpu" or "cuda:0" …
            tree: how rays find triangles; None takes the fastest of the device.
            interval_s: at least the longest exposure of all views [s]; None takes that of the world's camera.
            instants: everything has a place for each of several instants, for `move_to`, and there is no interval.
            ahead: how the world's camera will render it: its kernels are compiled now, and at the same time as others.
            light_cache: whether views cache light; what is ``ahead`` tells that too.

        Raises:
            InputError: the world, the device or the tree cannot be used.
        """
        validate(world, world.name)
        check_device(device)
        self.world, self.light_changes = world, world.light_changes()
        self.lock = threading.RLock()
        self.device = wp.get_device(device)
        self.tree: Tree = tree or fastest_tree(device)
        if self.tree == "bvh16" and not self.device.is_cpu:
            raise InputError(f'tree is "bvh16", which works on a CPU only, but the render device is {device}')
        self.interval_s = world.camera.shutter_s if interval_s is None else interval_s
        if instants:
            self.interval_s = 0.0
        light_cache = light_cache if ahead is None else ahead.light_cache
        self.features = scene_features(world, self.interval_s, instants, light_cache)
        if ahead is not None:
            self._compile(ahead)
        self._time_s: float | None = None
        self.still = light_stands_still(world)  # asked once: there may be many objects
        self.poses = PoseCache()
        placement, times_s = place(world), self._key_times(0.0)
        self.origin_m = placement.origin_m
        self.instance_objects, self.triangle_objects = placement.instance_objects, placement.triangle_objects
        self._smallest = None if self.features.alpha else smallest_of(placement, world.sphere_lights)
        may_pass = np.array([material.alpha_mode != "opaque" for material in world.materials] or [False])
        self._geometry = GeometryData(
            placement, may_pass, world.sphere_lights, self.features, self.tree, times_s, self.device, self._pose
        )
        self._lights = LightData(world, placement, *self._geometry.bulk, self.features, times_s, self.device)
        self.scene: Any = Scene()
        self.scene.geometry = self._geometry.geometry
        self.scene.materials = upload_materials(world, self.device)
        self.scene.lights = self._lights.lights
        self._levels = False
        self._no_specks: Any = wp.zeros((0, 0), dtype=wp.vec4, device=self.device)
        self._lamp_motions, self._lamps_deform = lamp_motions(world)
        self._shining = Shining(world, self._lights.lights, self.scene.materials)

    def add_texture_levels(self) -> None:
        """Give image textures the coarser levels that primary rays read, unless they have them."""
        with self.lock:
            if self.features.images and not self._levels:
                add_levels(self.world, self.scene.materials.textures)
                self._levels = True

    @property
    def instance_count(self) -> int:
        """How many instances rays meet."""
        return len(self.instance_objects)

    def places(self) -> Places:
        """Return where all that moves is now."""
        return self._geometry.places(self._time_s)

    def moving_boxes(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Return lower and upper corners ``[n, 3]`` of boxes around what moves, and around all sphere lights.

        They are relative to the origin, and hold all the places to which `move_to` put them last.
        """
        return self._geometry.boxes_of_moving()

    def specks(self, places: npt.NDArray[np.float64], pixel_rad: float) -> Any:
        """Return the ways to what is so small that it may hide between a pixel's corners, from places in the world.

        Instances and sphere lights are where `move` put them last. Of more than `_MOST_SPECKS` the widest are told.

        Args:
            places: from where one looks ``[K, 3]``: one for each time to which all was moved, if these are several.
            pixel_rad: width of a pixel.

        Returns:
            On the device, ``[K, 1 + n, 4]``: each place from the origin, then the ways from there [m], and how far from
            each the middle of a pixel that shows some of it may point [rad]; ``[0, 0, 4]`` where nothing is so small.
        """
        eyes = places - self.origin_m
        middles, radii = self._geometry.balls()
        ways = middles - eyes[:, None]
        lengths = np.maximum(np.linalg.norm(ways, axis=2), 1e-30)
        seen_rad = radii / lengths
        small = 2.0 * seen_rad < _SPECK_PX * pixel_rad
        chosen = np.flatnonzero(small.any(axis=0))
        if not len(chosen):
            return self._no_specks
        widest = np.where(small, seen_rad, 0.0).max(axis=0)
        chosen = chosen[np.argsort(-widest[chosen], kind="stable")[:_MOST_SPECKS]]
        off = np.where(small, seen_rad + pixel_rad, 0.0)[:, chosen, None]
        rows = np.concatenate([ways[:, chosen], off], axis=2)
        first = np.broadcast_to(np.pad(eyes, ((0, 0), (0, 1)))[:, None], (len(rows), 1, 4))
        return wp.array(np.concatenate([first, rows], axis=1), dtype=wp.vec4, device=self.device)

    def lamp_poses(self) -> npt.NDArray[np.float64]:
        """Return where what moves and shines is now ``[n, 4, 4]``; another array at each time where it deforms."""
        poses = [self._pose(motion, self._time_s or 0.0) for motion in self._lamp_motions]
        times = [np.full((4, 4), self._time_s)] if self._lamps_deform else []
        return np.array([*poses, *times], np.float64).reshape(-1, 4, 4)

    def move(self, time_s: float) -> None:
        """Move everything to where it is about that time [s]; costs nothing where it is there already."""
        if time_s != self._time_s:
            times_s = self._key_times(time_s)
            self._geometry.update(times_s)
            self._lights.update(times_s)
            self._time_s = time_s

    def restart_motion(self) -> None:
        """Let the next `move` move everything, whatever its time: motions themselves have changed."""
        self._time_s = None

    def set_light(self, name: str, radiance: Vec3) -> None:
        """Let all lights and emitting materials of a name shine so from now on.

        How it changes with time goes on. They are drawn as often as before, by the power that they have in ``world``.

        Args:
            name: of sphere lights, lights without size, and materials.
            radiance: of spheres and materials [W·sr⁻¹·m⁻²]; of a point or spot the intensity [W·sr⁻¹], of a directional
                light the irradiance [W·m⁻²].
        """
        self._shining.set(name, radiance)

    def shine(self, start_s: float, end_s: float) -> npt.NDArray[np.float64]:
        """Let all light be its mean over an exposure [s]; where both times are one, what it is then.

        Return all that changes of it: another array where the light is another.
        """
        if self.light_changes:
            self._shining.shine(start_s, end_s)
            self.scene.lights = self._lights.lights
        return self._shining.state

    def move_to(self, times_s: npt.NDArray[np.float64]) -> None:
        """Put everything where it is at each of those times [s], for rays that tell which of them is theirs.

        They are at most `most_instants`, where something deforms.
        """
        if self.features.instants:
            self._geometry.update(times_s)
            self._lights.update(times_s)
            self.scene.geometry, self.scene.lights = self._geometry.geometry, self._lights.lights

    def farthest_m(self, place: npt.NDArray[np.float64]) -> float:
        """Return a distance beyond which nothing lies, from a place in the world; infinite where anything moves."""
        if not self.still:
            return math.inf
        middle, radius = self.origin_m + self._geometry.middle_m, self._geometry.radius_m
        balls = [(light.motion.pose(0.0)[:3, 3], light.radius_m) for light in self.world.sphere_lights]
        return float(max(np.linalg.norm(place - at) + size for at, size in [(middle, radius), *balls]))

    def least_sphere_rad(self, place: npt.NDArray[np.float64], time_s: float) -> float:
        """Return how wide each sphere at least is from a place in the world [rad]; 0 where nobody asks."""
        lights = self.world.sphere_lights
        # Without a tree over instances there are no boxes next to which spheres might hide.
        if not self.features.two_level or len(lights) > _MOST_SPHERES:
            return 0.0
        ways = [np.linalg.norm(place - self._pose(light.motion, time_s)[:3, 3]) for light in lights]
        wide = [2.0 * light.radius_m / max(float(way), 1e-30) for light, way in zip(lights, ways, strict=True)]
        return min(wide, default=math.inf)

    def clear_m(
        self, places: npt.NDArray[np.float64], times_s: npt.NDArray[np.float64], narrow: tuple[float, float]
    ) -> npt.NDArray[np.float64]:
        """Return how far from each place ``[K, 3]`` nothing is narrow at that time; see ``Smallest.clear_m``."""
        if self._smallest is None:
            return np.zeros(len(places))
        return self._smallest.clear_m(places, times_s, narrow, self._pose)

    @property
    def most_instants(self) -> int:
        """How many instants at a time serve well: boxes hold all places of an object, and shapes take memory.

        A tree of lights that move is of one: what is drawn from it must not depend on what else is asked for.
        """
        return 1 if self._lights.follows else self._geometry.most_instants

    def _compile(self, options: RenderOptions) -> None:
        """Compile what renders at the same time as what builds trees."""
        precompile_headers(str(self.device))
        kernels = [build_kernel(options.features(self.features, self.world.camera), self.tree)]
        if self.tree == "bvh16":
            kernels.append(grow)
        if options.light_cache:
            from clsim.render.cache.light_updates import build_updates
            from clsim.render.cache.stored_paths import build_storing

            kernels.append(build_updates().open_cells)
            if options.lights_set or not light_stands_still(self.world):
                kernels.append(build_storing().choose_paths)
                replay = options.features(self.features, self.world.camera, replay=True)
                kernels.insert(1, build_kernel(replay, self.tree))
        compile_together(kernels, self.device)

    def _pose(self, motion: Motion, time_s: float) -> npt.NDArray[np.float64]:
        return self.poses.pose(motion, time_s) if self.features.instants else motion.pose(time_s)

    def _key_times(self, time_s: float) -> Any:
        return key_times(time_s, self.interval_s if self.features.motion_blur else 0.0)
