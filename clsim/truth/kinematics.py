"""Velocities and accelerations of motions, and what an inertial sensor feels of them.

A motion is a function of time. Its derivatives are those of the polynomial through five of its poses, up to 2 ms before
and after, in float64: where the motion is smooth, all but exact. At the motion's ends the poses lie on the motion's
side. Where a motion has a corner, such as between keyframes that are joined linearly, its speed jumps: accelerations
about it are as large as makes the speed jump within a millisecond or two.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from clsim.scene import Motion
from clsim.scene.rigid import quaternions_of, rotation_vectors, without_scale
from clsim.truth.record import F64, ImuChunk, ImuNoise, Times, TrackChunk

_STEP_S = 1e-3
_REACH = 2
_STEPS = np.arange(-_REACH, _REACH + 1)
OPENCV = np.diag((1.0, -1.0, -1.0))
"""From a camera's own axes (−z ahead, +y up) to OpenCV's (+z ahead, +y down)."""


@cache
def _weights(shift: int) -> tuple[F64, F64]:
    """Return the weights of five poses, at steps −2 … 2 + ``shift``, for the first and second derivative at step 0."""
    powers = np.vander(_STEPS + float(shift), increasing=True).T
    first, second = np.linalg.solve(powers, np.eye(len(_STEPS))[:, 1:3] * (1.0, 2.0)).T
    return first, second


def _shift(motion: Motion, time_s: float, step_s: float) -> int:
    """Return by how many steps the five poses lie later than about the time, so that none is beyond an end."""
    before, after = (round(room_s / step_s) for room_s in (time_s, motion.duration_s - time_s))
    if after < 0 or before + after < 2 * _REACH:
        return 0
    return max(0, _REACH - before) - max(0, _REACH - after)


def derivatives(motion: Motion, times_s: F64, step_s: float = _STEP_S) -> tuple[F64, F64, F64, F64, F64]:
    """Return a motion's positions, rotations, velocities, accelerations and angular velocities.

    ``[n, 3]`` [m], ``[n, 3, 3]``, ``[n, 3]`` [m/s] and ``[n, 3]`` [m/s²] in the world, and ``[n, 3]`` [rad/s] in the
    body's own axes. Scale in the poses is left out. The five poses are ``step_s`` apart; each is found once where the
    times lie on that grid too.
    """
    count = len(times_s)
    if motion.duration_s == 0 or count == 0:
        pose = without_scale(motion.pose(0.0))
        still = np.zeros((count, 3))
        places, turns = np.tile(pose[:3, 3], (count, 1)), np.tile(pose[:3, :3], (count, 1, 1))
        return places, turns, still, still, still
    shifts = [_shift(motion, time_s, step_s) for time_s in times_s.tolist()]
    wanted_s = times_s[:, None] + (_STEPS + np.array(shifts)[:, None]) * step_s
    nodes_s, places_of = np.unique(np.rint(wanted_s * 1e10) * 1e-10, return_inverse=True)
    nodes = np.array([motion.pose(t) for t in nodes_s.tolist()])
    u, _, vt = np.linalg.svd(nodes[:, :3, :3])
    u[..., 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
    places_of = places_of.reshape(wanted_s.shape)
    positions, rotations = nodes[places_of, :3, 3], (u @ vt)[places_of]
    rows, now = np.arange(count), _REACH - np.array(shifts)
    places, turns = positions[rows, now], rotations[rows, now]
    first, second = (np.array(each) for each in zip(*map(_weights, shifts), strict=True))
    first, second = first / step_s, second / step_s**2
    from_now = positions - places[:, None]  # what is far from the origin must not cancel
    relative = np.swapaxes(turns, 1, 2)[:, None] @ rotations
    angles = rotation_vectors(relative.reshape(-1, 3, 3)).reshape(count, -1, 3)
    products = ((first, from_now), (second, from_now), (first, angles))
    speeds, forces, spins = (np.einsum("nk,nkc->nc", weights, values) for weights, values in products)
    return places, turns, speeds, forces, spins


def track(name: str, motion: Motion, times_us: Times, *, camera: bool = False) -> TrackChunk:
    """Return poses and velocities of a motion; those of a camera along OpenCV's axes."""
    axes = OPENCV if camera else np.eye(3)
    positions, rotations, speeds, _, turns = derivatives(motion, times_us.astype(np.float64) * 1e-6)
    poses = np.concatenate([positions, quaternions_of(rotations @ axes)], axis=1)
    return TrackChunk(name, times_us, poses, np.concatenate([speeds, turns @ axes], axis=1))


class Imu:
    """An inertial sensor in the camera's place, along OpenCV's axes, with Kalibr's noise.

    Source of the model: Kalibr's wiki, "IMU Noise Model"; white noise is σ/√Δt and a bias walks by σ_b·√Δt a sample.
    """

    def __init__(self, motion: Motion, rate_hz: float, noise: ImuNoise, gravity: tuple[float, ...], seed: int) -> None:
        """Feel ``motion`` at ``rate_hz``, in a world where free fall is ``gravity`` [m/s²]."""
        self._rate_hz, self._count = rate_hz, 0
        self._motion, self._gravity = motion, np.asarray(gravity, np.float64)
        white = [noise.accelerometer_noise_density] * 3 + [noise.gyroscope_noise_density] * 3
        walk = [noise.accelerometer_random_walk] * 3 + [noise.gyroscope_random_walk] * 3
        self._white, self._walk = np.array(white) * rate_hz**0.5, np.array(walk) * rate_hz**-0.5
        self._noise = np.random.Generator(np.random.Philox(seed))
        self._bias = np.zeros(6)

    def until(self, end_us: int) -> ImuChunk:
        """Return the samples up to and with ``end_us`` that were not returned before; sample k is at k/rate."""
        last = math.floor(end_us * 1e-6 * self._rate_hz + 1e-6)
        times_s = np.arange(self._count, last + 1) / self._rate_hz
        self._count = max(self._count, last + 1)
        _, rotations, _, forces, turns = derivatives(self._motion, times_s, min(_STEP_S, 1.0 / self._rate_hz))
        to_body = np.swapaxes(rotations @ OPENCV, 1, 2)
        felt = (to_body @ (forces - self._gravity)[:, :, None])[:, :, 0]
        drawn = self._noise.standard_normal((len(times_s), 2, 6))
        # From the last bias on, so that the sums are the same in whatever portions.
        biases = np.cumsum(np.concatenate([self._bias[None], drawn[:, 0] * self._walk]), axis=0)[1:]
        if len(biases):
            self._bias = biases[-1]
        off = biases + drawn[:, 1] * self._white
        times_us = np.rint(times_s * 1e6).astype(np.int64)
        return ImuChunk(times_us, felt + off[:, :3], turns @ OPENCV + off[:, 3:])
