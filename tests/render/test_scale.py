"""Rays that leave a surface: as near to it as rounding allows, however large the world is and wherever it lies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.render import SceneData
from clsim.scene import Instance, Material, PunctualLight, SphereLight, Static
from clsim.scene.motion import Nested, Orbit
from tests.render import hand_worlds as hw

pytestmark = pytest.mark.usefixtures("anything")

GREY = Material(color=(0.5, 0.5, 0.5))
SUN_M, SUN_RADIUS_M = 1e5, 465.0
"""As large in the sky as the sun, 100 km away."""


def seen_from_above(x, width_m=0.004):
    """The floor around (x, 0, 0), from 1 m above it."""
    view = hw.look_from((x, 1, 0), (x, 0, 0), up=(0, 0, -1))
    return hw.camera(view, 8, 8, fov_deg=float(np.degrees(2 * np.arctan(width_m / 2))))


def sunlit_box(half_floor_m, light):
    """A box 10 cm high on a floor; the sun is 45 degrees high over +x, so that the shadow is 10 cm long, over -x."""
    floor = hw.quad((-half_floor_m, 0, half_floor_m), (2 * half_floor_m, 0, 0), (0, 0, -2 * half_floor_m))
    box = hw.box((-0.05, 0, -0.05), (0.05, 0.1, 0.05))
    if light == "sphere":
        position = np.array((1.0, 1.0, 0.0)) / np.sqrt(2) * SUN_M
        lights = {"sphere_lights": (SphereLight(SUN_RADIUS_M, (1e5,) * 3, Static(hw.translation(*position))),)}
    else:
        pose = hw.look_from((1, 1, 0), (0, 0, 0), up=(0, 0, 1))
        lights = {"punctual_lights": (PunctualLight("directional", (1.0,) * 3, Static(pose)),)}
    return hw.world(floor, box, materials=(GREY,), **lights)


@pytest.mark.parametrize("light", ["sphere", "directional"])
@pytest.mark.parametrize("half_floor_m", [1.0, 500.0])
def test_a_small_box_has_its_contact_shadow_under_a_far_sun(light, half_floor_m):
    scene = sunlit_box(half_floor_m, light)
    irradiance = np.sqrt(0.5)
    if light == "sphere":
        irradiance *= 1e5 * np.pi * (SUN_RADIUS_M / SUN_M) ** 2
    for x, expected in ((-0.055, 0.0), (-0.1, 0.0), (-0.14, 0.0), (-0.16, 0.5 / np.pi * irradiance)):
        frame = hw.render(hw.with_camera(scene, seen_from_above(x)), spp=16, max_depth=2)
        np.testing.assert_allclose(hw.radiance(frame), expected, rtol=2e-3, err_msg=f"x = {x}")


def tilted(scene_to_world, half_m, offset=(0.0, 0.0, 0.0)):
    """A large floor turned by any angle about the origin, its vertices moved by an offset in its own space."""
    floor = hw.quad((-half_m, 0, half_m), (2 * half_m, 0, 0), (0, 0, -2 * half_m))
    vertices = floor.vertices.astype(np.float64) @ scene_to_world.T + offset
    return replace(floor, vertices=vertices.astype(np.float32))


def turned(seed):
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("moving", [False, True])
def test_a_large_triangle_does_not_shade_itself_where_its_coordinates_are_small(seed, moving):
    """Its corners are far from where it is hit; light comes in at a grazing angle."""
    rotation, motion = turned(seed), hw.IDENTITY
    if moving:
        motion = Nested(Still(), hw.IDENTITY)
    place = np.eye(4)
    place[:3, :3] = rotation
    pose = place @ hw.look_from((0, 1, 0), (0, 0, 0), up=(0, 0, -1))
    sun = place @ hw.look_from((1, 0.05, 0.3), (0, 0, 0))
    light = PunctualLight("directional", (1.0,) * 3, Static(sun))
    floor = tilted(rotation, 700.0)
    scene = hw.world(floor, materials=(GREY,), view=hw.camera(pose, 24, 24), motions=[motion], punctual_lights=(light,))
    frame = hw.render(scene, spp=4, max_depth=2)
    expected = 0.5 / np.pi * 0.05 / np.linalg.norm((1, 0.05, 0.3))
    np.testing.assert_allclose(hw.radiance(frame), expected, rtol=1e-3)


class Still:
    """Counts as moving, but stands still."""

    duration_s = 1.0

    def __init__(self, matrix=None):
        self.matrix = np.eye(4) if matrix is None else matrix

    def pose(self, time_s):
        return self.matrix


def test_a_small_triangle_far_from_its_own_origin_does_not_shade_itself():
    """An instance 3 km off, of a mesh whose vertices are 3 km off the other way, is hit at the world's origin."""
    rotation = turned(7)
    away = np.array((2000.0, -1500.0, 1700.0))
    place = np.eye(4)
    place[:3, :3] = rotation
    pose = place @ hw.look_from((0, 1, 0), (0, 0, 0), up=(0, 0, -1))
    sun = place @ hw.look_from((1, 0.05, 0.3), (0, 0, 0))
    light = PunctualLight("directional", (1.0,) * 3, Static(sun))
    scene = hw.world(
        tilted(rotation, 2.0, away),
        materials=(GREY,),
        view=hw.camera(pose, 24, 24),
        motions=[Still(hw.translation(*-away))],
        punctual_lights=(light,),
    )
    lit = hw.radiance(hw.render(scene, spp=4, max_depth=2))
    expected = 0.5 / np.pi * 0.05 / np.linalg.norm((1, 0.05, 0.3))
    np.testing.assert_allclose(lit, expected, rtol=5e-3)


@pytest.mark.parametrize("axis", range(3))
def test_what_is_far_off_on_the_negative_side_of_an_axis_does_not_shade_itself(axis):
    """As much of the world is on the other side, so that its middle is no nearer."""
    away = 3000.0 * np.eye(3)[axis]
    place = hw.translation(*-away)
    place[:3, :3] = turned(5)
    pose = place @ hw.look_from((0, 1, 0), (0, 0, 0), up=(0, 0, -1))
    sun = PunctualLight("directional", (1.0,) * 3, Static(place @ hw.look_from((1, 0.05, 0.3), (0, 0, 0))))
    meshes, motions = [tilted(np.eye(3), 2.0)] * 2, [Still(place), Still(hw.translation(*away))]
    view = hw.camera(pose, 24, 24)
    scene = hw.world(*meshes, materials=(GREY,), view=view, motions=motions, punctual_lights=(sun,))
    expected = 0.5 / np.pi * 0.05 / np.linalg.norm((1, 0.05, 0.3))
    np.testing.assert_allclose(hw.radiance(hw.render(scene, spp=4, max_depth=2)), expected, rtol=5e-3)


def test_a_lamp_does_not_hide_itself_from_far_away():
    """E = L·A·cos·cos'/d² on a surface 1 km from a square metre that is seen at a grazing angle."""
    glow = Material(color=(0.0, 0.0, 0.0), emission=(1e6,) * 3)
    rotation = turned(3)
    far = np.array((800.0, 500.0, -300.0))
    distance = np.linalg.norm(far)
    lamp = tilted(rotation, 0.5)
    lamp = replace(lamp, material_ids=np.ones(2, np.int32))
    toward = -far / distance
    right = np.cross(toward, (0.0, 1.0, 0.0))
    right /= np.linalg.norm(right)
    up = np.cross(right, toward)
    target = hw.quad(far - 0.01 * right - 0.01 * up, 0.02 * right, 0.02 * up)
    view = hw.camera(hw.look_from(far + 0.5 * toward, far), 8, 8, fov_deg=0.5)
    expected = 0.5 / np.pi * 1e6 * abs(rotation[:, 1] @ toward) / distance**2
    for moving in (False, True):
        motions = [hw.IDENTITY, Still() if moving else hw.IDENTITY]
        scene = hw.world(target, lamp, materials=(GREY, glow), view=view, motions=motions)
        frame = hw.render(scene, spp=64, max_depth=2)
        assert np.all(np.abs(hw.radiance(frame).mean(axis=(1, 2)) / expected - 1) < 0.01), moving


@pytest.mark.parametrize("way", [(1e6, -4e5, 7e5), (-1e6, -4e5, -7e5)])
@pytest.mark.parametrize("moving", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_world_far_from_its_origin_looks_as_it_does_there(moving, way):
    """A thousand kilometres off, float32 tells 6 cm apart, whichever way that is."""
    away = hw.translation(*way)

    def scene(matrix):
        lamp = SphereLight(0.2, (9.0,) * 3, Static(matrix @ hw.translation(1, 2, 1)))
        above = matrix @ hw.translation(-1, 1.5, 1)
        point = PunctualLight("point", (2.0,) * 3, Still(above) if moving else Static(above))
        still = hw.world(hw.quad((-2, -0.5, 2), (4, 0, 0), (0, 0, -4)), hw.ball(0.5, rings=8), materials=(GREY,))
        motions = [Static(matrix), Still(matrix) if moving else Static(matrix)]
        return replace(
            still,
            instances=tuple(Instance(k, motion) for k, motion in enumerate(motions)),
            camera=hw.camera(matrix @ hw.look_from((0.5, 1, 3), (0, 0, 0)), 12, 10),
            sphere_lights=(lamp,),
            punctual_lights=(point,),
        )

    here, there = (hw.render(scene(matrix), spp=16) for matrix in (np.eye(4), away))
    for name in ("R", "Nx", "Ny", "Depth", "Coverage"):
        a, b = here.plane(name), there.plane(name)
        assert np.isclose(a, b, rtol=1e-3, atol=1e-4).mean() > 0.97, name
        assert abs(a.mean() - b.mean()) < 0.01 * np.abs(a).mean(), name


@pytest.mark.parametrize("origin_m", [0.0, 500.0])
def test_all_of_a_still_world_is_within_its_farthest_and_not_much_nearer(origin_m):
    """Rays that go no farther must find lamps far from all that has triangles, from wherever they start."""
    place = hw.translation(origin_m, 0.0, 0.0)
    lamp = SphereLight(2.0, (1.0, 1.0, 1.0), Static(place @ hw.translation(0, 70, 0)))
    box = hw.box((-1, -2, -3), (1, 2, 3))
    world = hw.world(box, motions=[Static(place)], sphere_lights=(lamp,))
    data, alone = SceneData(world), SceneData(replace(world, sphere_lights=()))
    for at in np.random.default_rng(0).normal(0, 30, (20, 3)):
        start = np.add(at, (origin_m, 0, 0))
        corners = np.linalg.norm(box.vertices.astype(float) - at, axis=1).max()
        far_side = np.linalg.norm((0, 70, 0) - at) + 2
        assert max(corners, far_side) - 1e-3 <= data.farthest_m(start) <= max(corners, far_side) + 4
        assert corners - 1e-3 <= alone.farthest_m(start) <= corners + 4
    moving = replace(world, instances=(replace(world.instances[0], motion=Orbit((0, 1, 0), 1.0, 1.0)),))
    assert np.isinf(SceneData(moving).farthest_m(np.zeros(3)))
