"""Small worlds in which things are fast: what frames alone time badly."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from clsim.scene import Camera, CheckerTexture, Instance, Material, Mesh, Motion, Static, World, load_world
from clsim.scene.motion import compose
from clsim.scene.shapes import box, quad, sphere

Matrix = npt.NDArray[np.float64]
SIZE = 64, 48
_DISTANCE_M, _FOV_DEG = 4.0, 50.0


@dataclass(frozen=True)
class Faster:
    """A motion in less time.

    Attributes:
        motion: the motion.
        times: how many times as fast.
    """

    motion: Motion
    times: float

    @property
    def duration_s(self) -> float:
        """Length of the motion [s]."""
        return self.motion.duration_s / self.times

    def pose(self, time_s: float) -> Matrix:
        """Return the pose at that time."""
        return self.motion.pose(time_s * self.times)


@dataclass(frozen=True)
class Spin:
    """A turn about the line of sight that does not end."""

    turns_per_s: float
    duration_s: float = 10.0

    def pose(self, time_s: float) -> Matrix:
        """Return the pose at that time."""
        angle = 2 * math.pi * self.turns_per_s * time_s
        turn = [[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]]
        return compose((0.0, 0.0, 0.0), np.array(turn))


@dataclass(frozen=True)
class Pass:
    """A straight way to the right, in the middle of the picture after half of the time.

    Attributes:
        speed_m_s: speed.
        duration_s: time that it takes.
    """

    speed_m_s: float
    duration_s: float

    def pose(self, time_s: float) -> Matrix:
        """Return the pose at that time."""
        return compose((self.speed_m_s * (time_s - self.duration_s / 2), 0.0, 0.0), np.eye(3))


def ten_times_faster(name: str, size: tuple[int, int] = SIZE) -> World:
    """Return a bundled scene in a tenth of its time."""
    world = load_world(name, resolution=size)

    def moved(each):  # type: ignore[no-untyped-def]
        return replace(each, motion=Faster(each.motion, 10.0)) if each.motion.duration_s > 0 else each

    return replace(
        world,
        camera=moved(world.camera),
        instances=tuple(map(moved, world.instances)),
        sphere_lights=tuple(map(moved, world.sphere_lights)),
        punctual_lights=tuple(map(moved, world.punctual_lights)),
        duration_s=world.duration_s / 10,
    )


def fan(size: tuple[int, int] = SIZE) -> World:
    """Return three blades with checks before a grey wall, 20 turns a second."""
    blades = []
    for k in range(3):
        turn = Spin(1.0).pose(k / 3)[:3, :3]
        blade = box((0.5, 1.5, 0.02), 1)
        vertices = (blade.vertices + np.array((0.0, 0.8, 0.0), np.float32)) @ turn.T.astype(np.float32)
        blades.append(replace(blade, vertices=np.ascontiguousarray(vertices, np.float32)))
    return _before_a_wall("fan", [(blade, Spin(20.0)) for blade in blades], size)


def ball(size: tuple[int, int] = SIZE, speed_px_s: float = 3000.0) -> World:
    """Return a checked ball that crosses the picture at that speed."""
    return _before_a_wall("ball", [(sphere(0.4, 48, 1), _crossing(size, speed_px_s))], size)


def thin_bar(size: tuple[int, int] = SIZE, speed_px_s: float = 1000.0, width_px: float = 0.3) -> World:
    """Return a bright bar, thinner than a pixel, that crosses the picture at that speed."""
    bar = box((width_px * _metres_a_pixel(size), 6.0, 0.001), 2)
    return _before_a_wall("thin bar", [(bar, _crossing(size, speed_px_s))], size)


def worlds(size: tuple[int, int] = SIZE) -> dict[str, World]:
    """Return all of them by name."""
    faster = {f"{name}, ten times faster": ten_times_faster(name, size) for name in ("two-boxes", "moving-light")}
    return faster | {"fan": fan(size), "ball at 3000 px/s": ball(size), "bar of 0.3 px at 1000 px/s": thin_bar(size)}


def _metres_a_pixel(size: tuple[int, int]) -> float:
    """Return how much of the plane z = 0 a pixel shows."""
    return 2 * _DISTANCE_M * math.tan(math.radians(_FOV_DEG) / 2) / size[0]


def _crossing(size: tuple[int, int], speed_px_s: float) -> Pass:
    """Return a way over the whole picture and a little more."""
    return Pass(speed_px_s * _metres_a_pixel(size), 1.3 * size[0] / speed_px_s)


def _before_a_wall(name: str, things: list[tuple[Mesh, Motion]], size: tuple[int, int]) -> World:
    upright = compose((0.0, 0.0, -1.0), np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]))
    materials = (
        Material(color=(0.18, 0.18, 0.2)),
        Material(color=(1.0, 1.0, 1.0), texture=0),
        Material(color=(0.95, 0.95, 0.95)),
    )
    return World(
        name=name,
        camera=Camera(*size, _FOV_DEG, Static(compose((0.0, 0.0, _DISTANCE_M), np.eye(3)))),
        meshes=(quad((40.0, 40.0)), *(mesh for mesh, _ in things)),
        instances=(
            Instance(0, Static(upright)),
            *(Instance(k + 1, motion, f"thing {k}") for k, (_, motion) in enumerate(things)),
        ),
        materials=materials,
        textures=(CheckerTexture((0.85, 0.8, 0.7), (0.12, 0.15, 0.2), 3.0),),
        environment=(0.6, 0.6, 0.6),
        duration_s=max(motion.duration_s for _, motion in things),
    )
