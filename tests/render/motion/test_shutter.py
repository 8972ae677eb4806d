"""What lies between the keys of an exposure, against scipy."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
import warp as wp
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from clsim.render import SceneData
from clsim.render.device.devices import start_warp
from clsim.render.motion import shutter
from clsim.scene import Mesh
from tests.render import hand_worlds as hw

COUNT = 64


@wp.kernel(enable_backward=False)
def between(
    times: wp.array(dtype=float),
    places: wp.array(dtype=wp.vec3),
    steps: wp.array(dtype=wp.vec3),
    turns: wp.array(dtype=wp.quat),
    out_places: wp.array(dtype=wp.vec3),
    out_turns: wp.array(dtype=wp.quat),
    out_nearest: wp.array(dtype=int),
):
    i = wp.tid()
    key = shutter.shutter_key(times[i])
    weight = shutter.shutter_weight(times[i])
    out_places[i] = shutter.position_between(places[key], places[key + 1], steps[key], steps[key + 1], weight)
    out_turns[i] = shutter.rotation_between(turns[key], turns[key + 1], weight)
    out_nearest[i] = shutter.nearest_key(times[i])


def test_between_keys_are_hermites_cubic_and_the_slerp():
    """From one key to the next by nothing, by so little that sines say nothing, and by nearly half a turn."""
    start_warp()
    keys, rng = shutter.SHUTTER_KEYS, np.random.default_rng(3)
    at = np.linspace(0.0, 1.0, keys)
    places, steps = rng.normal(size=(2, keys, 3))
    turned = np.array([0.0, 1e-5, 3e-4, 0.01, 0.5, 1.5, 2.5, 3.0])[:, None]
    axes = rng.normal(size=(keys - 1, 3))
    rotations = [Rotation.identity()]
    for turn in turned * axes / np.linalg.norm(axes, axis=1)[:, None]:
        rotations.append(rotations[-1] * Rotation.from_rotvec(turn))
    rotations = Rotation.concatenate(rotations)
    quaternions = shutter.quaternions(rotations.as_matrix())
    assert (np.sum(quaternions[1:] * quaternions[:-1], axis=1) >= 0).all()
    np.testing.assert_allclose(np.abs(np.sum(quaternions * rotations.as_quat(), axis=1)), 1, atol=1e-12)

    times = np.linspace(0.0, 1.0, COUNT).astype(np.float32)
    given = [wp.array(times, dtype=float, device="cpu")]
    given += [wp.array(each.astype(np.float32), dtype=wp.vec3, device="cpu") for each in (places, steps)]
    given.append(wp.array(quaternions.astype(np.float32), dtype=wp.quat, device="cpu"))
    out = [wp.empty(COUNT, dtype=kind, device="cpu") for kind in (wp.vec3, wp.quat, int)]
    wp.launch(between, COUNT, inputs=given, outputs=out, device="cpu")
    found, turns, nearest = (each.numpy() for each in out)
    np.testing.assert_allclose(found, CubicHermiteSpline(at, places, steps * (keys - 1))(times), atol=1e-5)
    off = (Rotation.from_quat(turns).inv() * Slerp(at, rotations)(times)).magnitude()
    assert off.max() < 1e-5
    np.testing.assert_array_equal(nearest, np.abs(times[:, None] - at).argmin(axis=1))


def test_each_quaternion_is_on_the_side_of_the_one_before():
    """Else the slerp between them would go the long way round. Of random turns every other one has to change sides."""
    turns = Rotation.random(4 * 50, random_state=np.random.default_rng(1))
    found = shutter.quaternions(turns.as_matrix().reshape(4, 50, 3, 3))
    assert (np.sum(found[1:] * found[:-1], axis=-1) >= 0).all()
    same = np.abs(np.sum(found * turns.as_quat().reshape(found.shape), axis=-1))
    np.testing.assert_allclose(same, 1, atol=1e-12)


def test_a_jump_bends_nothing_before_or_after_it():
    """Speed at the key where something jumps is beyond all bounds; elsewhere it stands."""

    class Jump:
        def pose(self, time_s):
            return hw.translation(float(time_s >= 0.5), 0.0, 0.0)

    times_s = shutter.key_times(0.5, 1.0)
    positions = np.array([[Jump().pose(time_s)[:3, 3]] for time_s in times_s])
    assert np.ptp(positions) == 1.0 and not shutter.key_steps([Jump()], times_s, positions).any()


@dataclass(frozen=True)
class Breath:
    """A mesh that grows and shrinks again while it turns and goes up and down."""

    rest: Mesh
    duration_s: float = 10.0

    def vertices_at(self, time_s):
        return (self.rest.vertices * (1.0 + 0.5 * np.sin(2 * np.pi * time_s))).astype(np.float32), None

    def pose(self, time_s):
        pose = hw.translation(0.0, 0.4 * np.cos(3.0 * time_s), 2.0)
        pose[:3, :3] = Rotation.from_rotvec((0.0, 0.3, 2.0 * time_s)).as_matrix()
        return pose


def test_keys_lie_evenly_about_the_time_of_the_frame():
    np.testing.assert_allclose(shutter.key_times(2.0, 0.08), 2.0 + 0.01 * np.arange(-4, 5), rtol=1e-12)
    assert shutter.key_times(2.0, 0.0).tolist() == [2.0]


def test_a_path_leaves_the_boxes_of_its_keys_by_no_more_than_is_said():
    keys = np.arange(5)
    places, steps = np.random.default_rng(2).normal(size=(2, len(keys), 200, 3))
    # And there and back between two keys at one place: by just as much, a quarter of the way at its speed.
    places[:2, 0], steps[:2, 0] = 0.0, np.array([[1.0], [-1.0]])
    said = shutter.chord_error(places, steps)
    for key in keys[:-1]:
        path = CubicHermiteSpline(keys, places, steps)(np.linspace(key, key + 1, 65))
        low, high = np.sort(places[key : key + 2], axis=0)
        assert (np.maximum(low - path, path - high).max(axis=0) <= said + 1e-12).all()
    np.testing.assert_allclose(shutter.chord_error(places[:2, :1], steps[:2, :1]), 0.25)


@pytest.mark.parametrize("together", ["exposure", "instants"])
def test_boxes_hold_all_of_what_moves_and_deforms_at_any_time(together):
    """Of an exposure it has the shape of the nearest key; instants that are asked for together are of one box."""
    rest = hw.box((-0.3, -0.2, -0.1), (0.5, 0.4, 0.2))
    breath = Breath(rest)
    world = hw.world(replace(rest, deformation=breath), motions=[breath])
    if together == "exposure":
        data = SceneData(world, interval_s=1.0)
        data.move(3.25)
        keys_s = shutter.key_times(3.25, 1.0)
        times_s = np.linspace(keys_s[0], keys_s[-1], 129)
        shapes_s = keys_s[np.abs(times_s[:, None] - keys_s).argmin(axis=1)]
    else:
        data = SceneData(world, instants=True)
        times_s = shapes_s = np.array([3.3, 3.1, 3.75, 3.2])
        data.move_to(times_s)
    ((low, high),) = data.places().boxes
    for time_s, shape_s in zip(times_s, shapes_s, strict=True):
        pose = breath.pose(time_s)
        corners = breath.vertices_at(shape_s)[0] @ pose[:3, :3].T + pose[:3, 3]
        assert (corners >= low - 1e-3).all() and (corners <= high + 1e-3).all(), time_s


def test_what_speeds_up_evenly_has_its_own_speed_at_each_key():
    class Falling:
        duration_s = 9.0

        def pose(self, time_s):
            return hw.translation(0.0, -(time_s**2), 0.0)

    times_s = shutter.key_times(4.0, 0.8)
    places = np.array([[Falling().pose(time_s)[:3, 3]] for time_s in times_s])
    np.testing.assert_allclose(shutter.key_steps([Falling()], times_s, places)[:, 0, 1], -0.2 * times_s, atol=1e-9)
