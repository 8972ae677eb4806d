"""The two worlds that the renderer is measured on; both still, all diffuse, lit by area lights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from clsim.scene import Camera, Instance, Material, Mesh, Static, World, load_world
from clsim.scene.motion import look_at


def cornell(size: int = 256) -> World:
    """Return the bundled Cornell box, frozen at its start."""
    world = load_world("cornell")
    still = tuple(replace(each, motion=Static(each.motion.pose(0.0))) for each in world.instances)
    return replace(world, instances=still, camera=replace(world.camera, width=size, height=size))


def bumpy_room(triangles: int = 1_000_000, size: int = 256) -> World:
    """Return a closed room with about so many triangles: six bumpy walls, four bumpy balls, two lamps."""
    cells = max(2, round((triangles / 20) ** 0.5))
    rng = np.random.default_rng(7)
    walls = [_wall(cells, axis, side, rng) for axis in range(3) for side in (-1.0, 1.0)]
    centres = [(-1.0, -1.2, -0.5), (0.9, -1.1, 0.3), (0.2, -1.3, -1.2), (-0.4, 0.6, -0.9)]
    balls = [_ball(cells, 0.55, centre, rng) for centre in centres]
    lamps = [_lamp((-0.8, 1.8, -0.8)), _lamp((0.8, 1.8, 0.6))]
    meshes = (*walls, *balls, *lamps)
    return World(
        "bumpy room",
        Camera(size, size, 70.0, Static(look_at((0.0, 0.0, 1.7), (0.0, -0.3, -1.0)))),
        meshes=meshes,
        instances=tuple(Instance(i, Static(np.eye(4))) for i in range(len(meshes))),
        materials=(
            Material(color=(0.73, 0.72, 0.7)),
            Material(color=(0.0, 0.0, 0.0), emission=(12.0, 11.0, 9.0), emits_behind=False),
        ),
    )


def _grid(points: npt.NDArray[np.float64], material: int = 0) -> Mesh:
    """Two triangles for each cell of a grid of points ``[rows + 1, columns + 1, 3]``."""
    rows, columns = points.shape[0] - 1, points.shape[1] - 1
    a = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    b = a + columns + 1
    triangles = np.concatenate([np.stack([a, b, b + 1], -1), np.stack([a, b + 1, a + 1], -1)])
    ids = np.full(len(triangles), material, np.int32)
    return Mesh(points.reshape(-1, 3).astype(np.float32), triangles.astype(np.int32), ids)


def _bumps(u: npt.NDArray[np.float64], v: npt.NDArray[np.float64], rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """Return waves of several scales, from -1 to 1."""
    waves = np.zeros_like(u)
    for octave in range(5):
        angle, phase = rng.uniform(0, 2 * np.pi, 2)
        waves += 0.5**octave * np.sin(2.0**octave * 9 * (u * np.cos(angle) + v * np.sin(angle)) + phase)
    return waves / 2


def _wall(cells: int, axis: int, side: float, rng: np.random.Generator) -> Mesh:
    u, v = np.meshgrid(*[np.linspace(-2.0, 2.0, cells + 1)] * 2, indexing="ij")
    # No bumps at the border, so that walls meet.
    height = 2.0 - 0.08 * (1 + _bumps(u, v, rng)) * np.cos(u * np.pi / 4) * np.cos(v * np.pi / 4)
    return _grid(np.roll(np.stack([side * height, u, v], axis=-1), axis, axis=-1))


def _ball(cells: int, radius: float, centre: tuple[float, float, float], rng: np.random.Generator) -> Mesh:
    theta, phi = np.meshgrid(np.linspace(0, np.pi, cells + 1), np.linspace(0, 2 * np.pi, cells + 1), indexing="ij")
    unit = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], axis=-1)
    bumps = _bumps(2 * unit[..., 0] + unit[..., 1], 2 * unit[..., 2] - unit[..., 1], rng)
    return _grid(unit * (radius * (1 + 0.06 * bumps[..., None])) + centre)


def _lamp(centre: tuple[float, float, float]) -> Mesh:
    """A square that shines down."""
    corners = np.array([[[-1, 0, -1], [-1, 0, 1]], [[1, 0, -1], [1, 0, 1]]]) * 0.3
    return _grid(corners + centre, material=1)
