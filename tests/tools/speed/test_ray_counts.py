"""Counts of rays, against scenes where they can be told by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.bench.throughput.render_worlds import bumpy_room
from clsim.frames import Frame
from clsim.render import PathTracer, RenderOptions
from clsim.scene import Material, World, load_world
from tools.speed.ray_counts import RaysPerPath, rays_per_path

pytestmark = pytest.mark.slow  # where counts lie is built into the kernels, so none of them is ever kept


@pytest.fixture(scope="module")
def wall() -> World:
    """A wall that fills the picture, in an environment that shines from everywhere."""
    world = load_world("uniform-wall")
    return replace(world, instances=world.instances[:1])


@pytest.mark.parametrize(("max_depth", "expected"), [(1, (1, 0, 0)), (2, (1, 1, 1)), (8, (1, 1, 1))])
def test_a_wall_and_a_sky(wall: World, max_depth: int, expected: tuple[int, int, int]) -> None:
    """From the wall one ray goes to the sky as a lamp and one scattered ray ends there."""
    rays = rays_per_path(wall, RenderOptions(frames=2, max_depth=max_depth))
    assert (rays.primary, rays.bounce, rays.shadow) == expected


def test_rays_to_lights_are_told_apart_where_surfaces_may_be_cut_out(wall: World) -> None:
    """They look for the nearest hit then, as bounces do; this wall is not cut out anywhere."""
    cut = replace(wall, materials=tuple(replace(each, alpha_mode="mask") for each in wall.materials))
    assert rays_per_path(cut, RenderOptions(frames=1)) == RaysPerPath(1.0, 1.0, 1.0)


def test_a_closed_room_without_a_lamp() -> None:
    """Nothing ends a path but its greatest length, and there is no light to aim at."""
    room = bumpy_room(400)
    dark = replace(room, materials=(Material(color=(0.7, 0.7, 0.7)),) * 2)
    rays = rays_per_path(dark, RenderOptions(frames=1, max_depth=5, roulette_start=100))
    assert rays == RaysPerPath(1.0, 4.0, 0.0)


def test_later_pictures_are_not_counted(wall: World) -> None:
    def picture() -> np.ndarray:
        small = replace(wall, camera=replace(wall.camera, width=8, height=6))
        tracer = PathTracer(small, RenderOptions(frames=1))
        frame = Frame(np.zeros((len(tracer.names), 6, 8), np.float32), tracer.names)
        tracer.fill(0, frame)
        tracer.close()
        return frame.planes

    before = picture()
    first, again = rays_per_path(wall, RenderOptions(frames=1)), rays_per_path(wall, RenderOptions(frames=1))
    assert first == again
    assert np.array_equal(picture(), before)
