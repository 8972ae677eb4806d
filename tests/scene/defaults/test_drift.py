"""The motion of a camera in a scene that stands still: it needs room, and must not leave the room it is in."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from clsim.scene import load_world
from clsim.scene.defaults.drift import drifting
from clsim.scene.modulation import Sine
from clsim.scene.motion import Static, compose, look_at
from clsim.scene.world import IDENTITY, Camera, EnvironmentMap, Instance, Mesh, World

LIVING_ROOM = Path(__file__).resolve().parents[4] / "shared" / "assets" / "mitsuba" / "living-room"
AHEAD_M = 5.0
RADIUS_M = 0.03 * AHEAD_M
TIMES_S = np.arange(48) / 24
EYE = np.array((0.3, 1.7, -0.4))
TURN = look_at((0, 0, 0), (1.0, -0.4, -2.0))[:3, :3]  # the columns are right, up, back


def quad(*corners):
    """A rectangle, in the camera's axes from its place."""
    triangles = np.array([(0, 1, 2), (0, 2, 3)], np.int32)
    return Mesh(np.array(corners, np.float32), triangles, np.zeros(2, np.int32))


def wall(axis, place_m):
    """A wall of 10 m beside the camera, at right angles to an axis; not centred, so that no ray meets its diagonal."""
    corners = np.array([(-4.9, -4.9, -4.9), (5.1, -4.9, -4.9), (5.1, 5.1, 5.1), (-4.9, 5.1, 5.1)])
    if axis == 0:
        corners = corners[:, [2, 0, 1]]
    elif axis == 1:
        corners = np.array([(-4.9, 0, -4.9), (5.1, 0, -4.9), (5.1, 0, 5.1), (-4.9, 0, 5.1)])
    corners[:, axis] = place_m
    return quad(*corners)


def still(*walls):
    """A still camera that sees a wall 5 m ahead, and walls around it."""
    pose = compose(EYE, TURN)
    meshes = (wall(2, -AHEAD_M), *walls)
    instances = tuple(Instance(i, Static(pose)) for i in range(len(meshes)))
    return World("box", Camera(32, 24, 60.0, Static(pose)), meshes=meshes, instances=instances)


def path_m(world):
    """The camera's places in its first axes: right, up, back."""
    return np.array([(world.camera.motion.pose(t)[:3, 3] - EYE) @ TURN for t in TIMES_S])


@pytest.mark.parametrize("walls", [(), (wall(1, -0.01),), (wall(1, 2 * 1.5 * RADIUS_M),), (wall(2, 0.01),)])
def test_with_room_the_circle_goes_up_with_its_full_radius(walls):
    motion = drifting(still(*walls)).camera.motion
    np.testing.assert_allclose(motion.distance_m, AHEAD_M, rtol=1e-6)
    right, up, back = TURN.T
    for time_s in TIMES_S:
        angle = 2 * math.pi * time_s / 2.0
        place = EYE + 0.03 * motion.distance_m * (math.sin(angle) * right + (1 - math.cos(angle)) * up)
        np.testing.assert_array_equal(motion.pose(time_s), look_at(place, EYE - motion.distance_m * back, up))


@pytest.mark.parametrize(
    ("walls", "away"),
    [
        ((wall(1, 0.05),), (0, -1, 0)),
        ((wall(0, -0.05),), (1, 0, 0)),
        ((wall(0, 0.05),), (-1, 0, 0)),
        ((wall(1, 2.2 * RADIUS_M),), (0, -1, 0)),  # upwards it would just fit, but scrape along the wall
    ],
)
def test_beside_a_wall_the_circle_goes_the_other_way(walls, away):
    world = drifting(still(*walls))
    path = path_m(world)
    assert (path @ away).max() == pytest.approx(2 * RADIUS_M)
    assert (path @ away).min() == pytest.approx(0, abs=1e-9)
    assert f"circles by {RADIUS_M:.3g} m" in world.notes[-1]
    x, y, z, _ = np.linalg.inv(world.camera.motion.pose(0.7)) @ (*(EYE - AHEAD_M * TURN[:, 2]), 1)
    assert (x, y) == pytest.approx((0, 0), abs=1e-6) and z < -4.9


@pytest.mark.parametrize("sides_m", [(-0.03, 0.04, -0.02, 0.05), (-0.001, 0.2, -0.2, 0.001), (-0.1, 0.1, -0.1, 0.1)])
def test_between_walls_the_circle_shrinks_and_stays_inside(sides_m):
    left, right, down, up = sides_m
    world = drifting(still(wall(0, left), wall(0, right), wall(1, down), wall(1, up)))
    path, radius_m = path_m(world), world.camera.motion.radius_m
    assert 0 < radius_m < RADIUS_M
    assert left < path[:, 0].min() and path[:, 0].max() < right
    assert down < path[:, 1].min() and path[:, 1].max() < up
    assert np.linalg.norm(path, axis=1).max() == pytest.approx(2 * radius_m, rel=1e-3)
    assert f"circles by {radius_m:.3g} m" in world.notes[-1]


@pytest.mark.parametrize(("sides_m", "away"), [((-0.25, 0.02), (-1, 0, 0)), ((-0.02, 0.25), (1, 0, 0))])
def test_between_walls_the_widest_circle_is_taken(sides_m, away):
    # To one side there is most room, though not enough: 0.25 m, with 1.5 times the way kept free.
    left, right = sides_m
    path = path_m(drifting(still(wall(0, left), wall(0, right), wall(1, -0.2), wall(1, 0.2))))
    assert (path @ away).min() == pytest.approx(0, abs=1e-9)
    assert (path @ away).max() == pytest.approx(0.25 / 1.5, rel=0.05)


def test_without_anything_to_meet_the_circle_is_the_full_one():
    world = drifting(World("void", Camera(32, 24, 60.0, IDENTITY)))
    assert world.camera.motion.radius_m == 0.03 * world.camera.motion.distance_m == 0.03


@pytest.mark.parametrize("turn_deg_per_s", [0.0, 3.0])
@pytest.mark.parametrize("flicker", [None, Sine(100.0, 0.5)])
def test_where_light_changes_by_itself_the_camera_stays(turn_deg_per_s, flicker):
    sky = EnvironmentMap(np.ones((2, 4, 3), np.float32), np.eye(3), turn_deg_per_s)
    world = replace(still(), environment_map=sky, environment_modulation=flicker)
    stays = drifting(world) is world
    assert stays == (turn_deg_per_s != 0 or flicker is not None)


def test_what_is_squeezed_flat_is_met_where_it_is():
    world = still()
    flat = compose(EYE, TURN) @ np.diag((1.0, 1.0, 0.0, 1.0))
    flat[:3, 3] -= 2.0 * TURN[:, 2]
    squeezed = replace(world, meshes=(wall(2, -AHEAD_M),), instances=(Instance(0, Static(flat)),))
    np.testing.assert_allclose(drifting(squeezed).camera.motion.distance_m, 2.0, rtol=1e-6)


@pytest.mark.skipif(not LIVING_ROOM.is_dir(), reason="the real scenes are not beside this checkout")
def test_the_camera_stays_in_the_living_room():
    world = load_world(LIVING_ROOM / "scene.xml")
    eye = world.camera.motion.pose(0.0)[:3, 3]
    ways = np.array([world.camera.motion.pose(t)[:3, 3] - eye for t in TIMES_S[1:]])
    assert np.linalg.norm(ways, axis=1).max() > 0.1
    assert sum(_walls_crossed(world, eye, ways)) == 0
    _, up, back = world.camera.motion.pose(0.0)[:3, :3].T
    assert sum(_walls_crossed(world, eye, np.array([0.3 * up, -20 * back]))) > 0  # the count does see walls


def _walls_crossed(world, eye, ways):
    """How many triangles lie on each way from the eye, by the signs of three volumes, in double precision."""
    crossed = np.zeros(len(ways), int)
    for instance in world.instances:
        mesh, matrix = world.meshes[instance.mesh], instance.motion.pose(0.0)
        points = mesh.vertices.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3] - eye
        a, b, c = (points[mesh.triangles[:, k]] for k in range(3))
        volumes = np.stack([np.cross(a, b) @ ways.T, np.cross(b, c) @ ways.T, np.cross(c, a) @ ways.T])
        inside = (volumes >= 0).all(axis=0) | (volumes <= 0).all(axis=0)
        # The three volumes add up to way · normal; the plane lies at the share (a · normal) / (way · normal).
        height, descent = np.einsum("ij,ij->i", a, np.cross(b, c))[:, None], volumes.sum(axis=0)
        crossed += (inside & (height * descent > 0) & (np.abs(height) <= np.abs(descent))).sum(axis=0)
    return crossed
