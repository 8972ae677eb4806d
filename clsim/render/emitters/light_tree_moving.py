"""Lights of a tree that move: what bounds them at the times of a frame."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.render.accel.placement import Placement
from clsim.render.emitters.light_list import TriangleLights, bounds_of_small
from clsim.render.emitters.light_tree_build import around, of_triangles
from clsim.scene import PunctualLight, SphereLight, World

_F64 = npt.NDArray[np.float64]
_I64 = npt.NDArray[np.int64]
_Rows = npt.NDArray[Any]
_STRAY = 0.1
"""Share of the way between its places at given times by which a light may stray from the box around these."""


class MovingBounds:
    """What bounds those lights of a tree that move.

    Attributes:
        rows: which of the tree's lights they are, in the order of `at`.
    """

    def __init__(self, world: World, placement: Placement, triangles: TriangleLights, in_tree: _I64) -> None:
        """Find them; ``in_tree`` are the numbers of the tree's lights, among all."""
        self._origin_m = placement.origin_m
        row_of = np.full(int(in_tree.max(initial=-1)) + 1, -1)
        row_of[in_tree] = np.arange(len(in_tree))
        self._bounds: list[Callable[[float], _Rows]] = []
        rows: list[_I64] = []

        def add(numbers: _I64, bounds: Callable[[float], _Rows]) -> None:
            if len(numbers) and numbers.max() < len(row_of) and (row_of[numbers] >= 0).all():
                rows.append(row_of[numbers])
                self._bounds.append(bounds)

        for k, instance in enumerate(placement.instances):
            if instance.motion.duration_s > 0:
                numbers = np.arange(triangles.instance_first[k], triangles.instance_first[k + 1])
                add(numbers, self._of_instance(placement, k, triangles))
        lights: tuple[SphereLight | PunctualLight, ...] = (*world.sphere_lights, *world.punctual_lights)
        for i, light in enumerate(lights):
            if light.motion.duration_s > 0:
                add(np.array([len(triangles.power) + i]), self._of_small(light))
        self.rows = np.concatenate([np.zeros(0, np.int64), *rows])

    def at(self, times_s: _F64) -> _Rows:
        """Return what bounds them at all of those times [s] together."""
        each = [np.concatenate([bounds(float(time_s)) for bounds in self._bounds]) for time_s in times_s]
        if len(each) == 1:
            return each[0]
        low, high = np.min([rows["low"] for rows in each], axis=0), np.max([rows["high"] for rows in each], axis=0)
        slack = _STRAY * (high - low)
        # Within an exposure they may face anywhere.
        together = around(low - slack, high + slack, each[0]["intensity"])
        together["both"] = each[0]["both"]
        return together

    def _of_instance(self, placement: Placement, index: int, triangles: TriangleLights) -> Callable[[float], _Rows]:
        instance = placement.instances[index]
        mesh, local = placement.meshes[instance.mesh], triangles.of_mesh[instance.mesh]
        corners = mesh.vertices[mesh.triangles[local]].astype(np.float64)
        known = triangles.bounds[triangles.instance_first[index] : triangles.instance_first[index + 1]]

        def bounds(time_s: float) -> _Rows:
            pose = instance.motion.pose(time_s)
            now = of_triangles(
                corners @ pose[:3, :3].T + (pose[:3, 3] - self._origin_m), known["intensity"], known["both"]
            )
            now["intensity"] = known["intensity"]
            return now

        return bounds

    def _of_small(self, light: SphereLight | PunctualLight) -> Callable[[float], _Rows]:
        return lambda time_s: bounds_of_small(light, light.motion.pose(time_s), self._origin_m)
