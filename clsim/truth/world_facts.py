"""What truth tells of a world: its objects and materials by name, and how they move."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np

from clsim.scene import Motion, World
from clsim.scene.rigid import quaternion_of, without_scale
from clsim.truth.record import F64


def object_names(world: World) -> tuple[str, ...]:
    """Return the names of instances, then sphere lights: number k of a plane of ids is the k-th of them.

    Those without a name get one, and those that share one a number behind it.
    """
    named = [instance.name or f"objects[{i}]" for i, instance in enumerate(world.instances)]
    return _distinct(named + [f"sphere_lights[{i}]" for i in range(len(world.sphere_lights))])


def material_names(world: World) -> tuple[str, ...]:
    """Return the names of the materials: number k of a plane of ids is the k-th of them."""
    return _distinct(material.name or f"materials[{i}]" for i, material in enumerate(world.materials))


def object_motions(world: World) -> tuple[Motion, ...]:
    """Return how instances and sphere lights move, in the order of `object_names`."""
    instances = [instance.motion for instance in world.instances]
    return (*instances, *(light.motion for light in world.sphere_lights))


def poses_at_start(world: World) -> F64:
    """Return where all objects are at time 0: x y z qx qy qz qw ``[n, 7]``."""
    rows = np.zeros((len(object_names(world)), 7))
    for row, motion in zip(rows, object_motions(world), strict=True):
        pose = without_scale(motion.pose(0.0))
        row[:3], row[3:] = pose[:3, 3], quaternion_of(pose[:3, :3])
    return rows


def _distinct(names: Iterable[str]) -> tuple[str, ...]:
    given = list(names)
    counts, seen = Counter(given), Counter[str]()
    found = []
    for name in given:
        seen[name] += 1
        found.append(name if counts[name] == 1 else f"{name}#{seen[name]}")
    return tuple(found)
