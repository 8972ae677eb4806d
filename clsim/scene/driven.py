"""What is moved from outside, as time goes on: poses that are set one by one, and the names by which to set them."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import replace
from typing import Any

import numpy as np

from clsim.errors import InputError
from clsim.scene.meshes.geometry import is_similarity
from clsim.scene.motion import Attached, Matrix, Motion, Nested, Quaternion, Vec3, compose, rotation_matrix, slerp
from clsim.scene.rigid import quaternion_of
from clsim.scene.world import World

CAMERA = "camera"
_SHORTEST_S = 1e-6
Place = tuple[Vec3, Quaternion, float]
"""Position [m], rotation x, y, z, w, and scale."""
Key = tuple[float, Vec3, Quaternion, float]
"""A time [s], and a place."""


class Driven:
    """The motion of a scene until a pose is set; from then on what is set: straight lines and slerp between keys.

    Before the first key that pose holds, and after the last one that. It never counts as still, so that nobody bakes
    what it moves into the place where it stands.

    Attributes:
        scenes: the scene's own motion.
        keys: time [s], position, rotation and scale of each pose that was set and is still needed.
    """

    def __init__(self, scenes: Motion) -> None:
        """Begin with the scene's own motion."""
        self.scenes = scenes
        self.keys: tuple[Key, ...] = ()
        self._found: tuple[object, float, Matrix] = (None, 0.0, np.eye(4))

    @property
    def duration_s(self) -> float:
        """Time of the last key, or the length of the scene's own motion [s]; more than 0."""
        last_s = self.keys[-1][0] if self.keys else self.scenes.duration_s
        return max(last_s, _SHORTEST_S)

    @property
    def last_s(self) -> float | None:
        """Time of the last key [s]; None where there is none."""
        return self.keys[-1][0] if self.keys else None

    def pose(self, time_s: float) -> Matrix:
        """Return the pose at that time."""
        keys = self.keys
        if not keys:
            return self.scenes.pose(time_s)
        known_keys, known_s, known = self._found  # a whole of many parts is asked once for each
        if known_keys is not keys or known_s != time_s:
            known = self._between(keys, time_s)
            self._found = keys, time_s, known
        return known

    @staticmethod
    def _between(keys: tuple[Key, ...], time_s: float) -> Matrix:
        j = bisect_right(keys, time_s, key=lambda key: key[0])
        _, start, turn, scale = keys[max(j - 1, 0)]
        weight = 0.0
        _, end, end_turn, end_scale = keys[min(j, len(keys) - 1)]
        if 0 < j < len(keys):
            weight = (time_s - keys[j - 1][0]) / (keys[j][0] - keys[j - 1][0])
        place = (1 - weight) * np.asarray(start, np.float64) + weight * np.asarray(end, np.float64)
        size = (1 - weight) * scale + weight * end_scale
        return compose(place, size * rotation_matrix(slerp(turn, end_turn, weight)))

    def set(self, time_s: float, place: Place) -> None:
        """Add a key after the last one, or put it in place of one at the same time."""
        if self.keys and time_s == self.keys[-1][0]:
            self.keys = self.keys[:-1]
        self.keys = (*self.keys, (time_s, *place))

    def forget_before(self, time_s: float) -> None:
        """Let go of keys that no pose from that time on needs."""
        needed = bisect_right(self.keys, time_s, key=lambda key: key[0]) - 1
        if needed > 0:
            self.keys = self.keys[needed:]

    def release(self) -> None:
        """Go back to the scene's own motion."""
        self.keys = ()


def stands_still(motion: Motion) -> bool:
    """Whether it does in the scene: what can be set from outside may move all the same."""
    if isinstance(motion, Driven):
        return stands_still(motion.scenes)
    return stands_still(motion.parent) if isinstance(motion, Attached) else motion.duration_s == 0


def read_place(name: str, value: Any) -> Place:
    """Return the place that a 4×4 matrix tells, or a pair of position and quaternion x, y, z, w.

    Raises:
        InputError: it is neither, or not a rotation with at most one positive scale, and a position.
    """
    try:
        if isinstance(value, tuple | list) and len(value) == 2:
            return _pair(np.array(value[0], np.float64), np.array(value[1], np.float64))
        return place_of(np.array(value, np.float64))
    except (TypeError, ValueError):
        raise InputError(
            f"`{name}` must be a 4×4 matrix of a rotation, at most one positive scale, and a position, or a pair of "
            f"position and quaternion x, y, z, w, got {_shown(value)}"
        ) from None


def place_of(pose: Matrix) -> Place:
    """Return the place that a 4×4 matrix tells; raises ValueError where it is no pose."""
    if pose.shape != (4, 4) or not np.isfinite(pose).all() or (np.abs(pose[3] - (0, 0, 0, 1)) > 1e-9).any():
        raise ValueError
    if not is_similarity(pose[:3, :3]):
        raise ValueError
    scale = float(np.cbrt(np.linalg.det(pose[:3, :3])))
    scale = 1.0 if abs(scale - 1.0) < 1e-6 else scale  # poses in float32 are rigid to so much
    x, y, z = pose[:3, 3].tolist()
    return (x, y, z), quaternion_of(pose[:3, :3] / scale), scale


def matrix_of(place: Place) -> Matrix:
    """Return the 4×4 matrix of a place."""
    position, rotation, scale = place
    return compose(position, scale * rotation_matrix(rotation))


def _pair(position: Matrix, quaternion: Matrix) -> Place:
    if position.shape != (3,) or quaternion.shape != (4,):
        raise ValueError
    (x, y, z), (qx, qy, qz, qw) = position.tolist(), quaternion.tolist()
    if not (all(map(math.isfinite, (x, y, z))) and abs(math.hypot(qx, qy, qz, qw) - 1.0) < 0.01):
        raise ValueError
    return (x, y, z), (qx, qy, qz, qw), 1.0


def _shown(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 160 else f"{text[:160]}…"


def placed(world: World) -> dict[str, Motion]:
    """Return by name how things move that can be told apart by their names.

    They are the camera, instances, lights, and what instances and lights are parts of: what is called "arm/hand" is
    part of "arm" where a file stands in the world under that name.
    """
    found: dict[str, Motion] = {CAMERA: world.camera.motion}
    ambiguous = {"", CAMERA}
    for each in (*world.instances, *world.sphere_lights, *world.punctual_lights):
        for name, motion in _names(each):
            if found.setdefault(name, motion) is not motion:
                ambiguous.add(name)
    return {name: motion for name, motion in found.items() if name == CAMERA or name not in ambiguous}


def with_driven(world: World, driven: dict[str, Driven]) -> World:
    """Return the world with what ``driven`` names moved by it; a part keeps its place in the whole."""

    def moved(each: Any) -> Any:
        names, motion = [name for name, _ in _names(each)], each.motion
        if len(names) > 1 and names[0] in driven:
            motion = _rooted(motion, driven[names[0]])
        if names[-1] in driven:
            driven[names[-1]].scenes, motion = motion, driven[names[-1]]
        return replace(each, motion=motion)

    return replace(
        world,
        camera=replace(world.camera, motion=driven.get(CAMERA, world.camera.motion)),
        instances=tuple(map(moved, world.instances)),
        sphere_lights=tuple(map(moved, world.sphere_lights)),
        punctual_lights=tuple(map(moved, world.punctual_lights)),
    )


def _names(each: Any) -> list[tuple[str, Motion]]:
    """Return the names by which something can be moved, and how it moves: that of the whole, if it is a part, first."""
    root, whole = _root(each.motion), each.name.partition("/")[0]
    own = [(each.name, each.motion)]
    return own if root is None or whole == each.name else [(whole, root), *own]


def _root(motion: Motion) -> Motion | None:
    """Return the motion of the whole that a part is attached to, if it is one."""
    if isinstance(motion, Nested):
        return _root(motion.outer)
    return motion.parent if isinstance(motion, Attached) else None


def _rooted(motion: Motion, root: Motion) -> Motion:
    """Return a part's motion with that of the whole in place of its own."""
    if isinstance(motion, Nested):
        return Nested(_rooted(motion.outer, root), motion.inner)
    return Attached(root, motion.offset) if isinstance(motion, Attached) else motion
