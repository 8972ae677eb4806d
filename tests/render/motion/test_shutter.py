"""What lies between the keys of an exposure, against scipy."""

from __future__ import annotations

import numpy as np
import warp as wp
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from clsim.render.device.devices import start_warp
from clsim.render.motion import shutter

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
