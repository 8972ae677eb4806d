"""Velocities and inertial samples against closed forms, and the noise against its densities."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from clsim.errors import InputError
from clsim.scene.motion import Keyframes, Orbit, Static, compose, euler_quaternion, rotation_matrix
from clsim.scene.trajectories.trajectory import CubicKeyframes
from clsim.truth.imu_file import read_imu_noise
from clsim.truth.kinematics import Imu, derivatives, track
from clsim.truth.record import ImuNoise

GRAVITY = (0.0, -9.80665, 0.0)


@given(st.floats(0.1, 5.0), st.floats(0.2, 4.0), st.booleans())
@settings(max_examples=10, deadline=None)
def test_an_orbit_is_pulled_to_its_centre(radius_m: float, period_s: float, clockwise: bool) -> None:
    orbit = Orbit((3.0, -2.0, 1.0), radius_m, period_s, 0.5, clockwise=clockwise, target=(3.0, -1.5, 1.0))
    times_s = np.linspace(0.0, period_s, 12)
    places, rotations, speeds, pulls, turns = derivatives(orbit, times_s)
    rate = 2 * np.pi / period_s
    from_centre = places - (3.0, -1.5, 1.0)
    size = radius_m * rate**2
    off = np.linalg.norm(pulls + rate**2 * from_centre, axis=1)
    assert off[1:-1].max() < 1e-6 * size + 1e-7
    assert off.max() < 1e-4 * size + 1e-7, "at the ends all five poses lie to one side"
    about = np.array((0.0, -rate if clockwise else rate, 0.0))
    assert np.abs(speeds - np.cross(about, from_centre)).max() < 1e-6 * (1 + radius_m * rate)
    assert np.abs((rotations @ turns[:, :, None])[:, :, 0] - about).max() < 1e-6 * (1 + rate)


def test_a_spline_has_the_derivatives_of_the_spline() -> None:
    rng = np.random.default_rng(0)
    times = tuple(np.arange(6) * 0.2)
    turns = tuple(euler_quaternion(tuple(v)) for v in rng.uniform(-40, 40, (6, 3)))
    motion = CubicKeyframes(times, tuple(map(tuple, rng.normal(size=(6, 3)))), turns)
    at = np.linspace(0.003, 0.99, 50)
    at = at[np.abs(at / 0.2 - np.rint(at / 0.2)) > 0.02]  # at a key the third derivative jumps
    _, _, speeds, pulls, spins = derivatives(motion, at)
    place, turn = motion._splines
    assert np.abs(speeds - place(at, 1)).max() < 1e-8 and np.abs(pulls - place(at, 2)).max() < 1e-5
    in_body = turn(at, 1)
    assert np.abs(spins - in_body).max() < 1e-6


@pytest.mark.parametrize("steps", [4, 5])
def test_a_short_motion_is_as_fast_at_its_ends(steps: int) -> None:
    """Nothing moves beyond them."""
    motion = Keyframes((0.0, steps * 1e-3), ((0.0, 0.0, 0.0), (0.01 * steps, 0.0, 0.0)), ((0.0, 0.0, 0.0, 1.0),) * 2)
    _, _, speeds, pulls, _ = derivatives(motion, np.arange(steps + 1) * 1e-3)
    np.testing.assert_allclose(speeds, [(10.0, 0.0, 0.0)] * (steps + 1), atol=1e-9)
    np.testing.assert_allclose(pulls, 0.0, atol=1e-5)


def test_at_rest_the_sensor_feels_its_support_and_nothing_turns() -> None:
    """OpenCV's y is down, so that a level camera is held up along −y; one that looks up, along +z."""
    for turn_deg, felt in (((0, 30, 0), (0, -9.80665, 0)), ((90, 0, 0), (0, 0, 9.80665))):
        pose = compose((1, 2, 3), rotation_matrix(euler_quaternion(turn_deg)))
        samples = Imu(Static(pose), 1000.0, ImuNoise(), GRAVITY, 0).until(9_000)
        assert samples.times_us.tolist() == list(range(0, 9_001, 1000))
        assert np.abs(samples.acceleration - felt).max() < 1e-12 and not samples.angular_velocity.any()


def test_samples_lead_from_pose_to_pose() -> None:
    """Turn rates add up to the rotation, and specific force with gravity to the way, as in any strapdown filter."""
    motion = Orbit((0.0, 1.0, 0.0), 2.0, 1.5, start_deg=50.0, target=(0.2, 1.4, 0.3))
    rate = 1000.0
    samples = Imu(motion, rate, ImuNoise(), GRAVITY, 0).until(400_000)
    camera = track("camera", motion, np.array([0, 400_000]), camera=True)
    turn, place, speed = Rotation.from_quat(camera.poses[0, 3:]), camera.poses[0, :3], camera.velocities[0, :3]
    middles = zip(
        (samples.acceleration[1:] + samples.acceleration[:-1]) / 2,
        (samples.angular_velocity[1:] + samples.angular_velocity[:-1]) / 2,
        strict=True,
    )
    for force, spin in middles:
        half = turn * Rotation.from_rotvec(spin / rate / 2)
        pull = half.apply(force) + GRAVITY
        place = place + speed / rate + pull / rate**2 / 2
        speed = speed + pull / rate
        turn = turn * Rotation.from_rotvec(spin / rate)
    np.testing.assert_allclose(camera.velocities[:, 3:], samples.angular_velocity[[0, -1]], atol=1e-9)
    assert np.abs(place - camera.poses[1, :3]).max() < 1e-5
    assert (turn * Rotation.from_quat(camera.poses[1, 3:]).inv()).magnitude() < 1e-5


@pytest.mark.parametrize("rate_hz", [4000.0, 16_000.0])
def test_a_sensor_of_a_high_rate_feels_fast_shaking(rate_hz: float) -> None:
    """A circle of 1 mm, 100 times a second: the pull is r·ω², whatever way the camera looks."""
    orbit = Orbit((0.0, 0.0, 0.0), 1e-3, 0.01, target=(0.0, 0.0, 0.0))
    felt = np.linalg.norm(Imu(orbit, rate_hz, ImuNoise(), (0, 0, 0), 0).until(9_000).acceleration[2:-2], axis=1)
    np.testing.assert_allclose(felt, 1e-3 * (200 * np.pi) ** 2, rtol=1e-4)


def test_the_noise_has_its_densities_and_does_not_hang_on_portions() -> None:
    noise = ImuNoise(0.02, 0.3, 0.003, 0.05)
    rate = 2000.0
    still = Static(np.eye(4))
    whole = Imu(still, rate, noise, GRAVITY, 7).until(20_000_000)
    parts = Imu(still, rate, noise, GRAVITY, 7)
    cut = [parts.until(t) for t in (0, 1_300, 1_300, 900_000, 20_000_000)]
    assert np.array_equal(np.concatenate([c.acceleration for c in cut]), whole.acceleration)
    assert not np.array_equal(Imu(still, rate, noise, GRAVITY, 8).until(1000).acceleration, whole.acceleration[:3])
    for values, white, walk in (
        (whole.acceleration + GRAVITY * np.array([1, -1, 1]), 0.02, 0.3),
        (whole.angular_velocity, 0.003, 0.05),
    ):
        # Neighbours differ by two draws of white noise and one step of the walk.
        steps = np.diff(values, axis=0).var()
        assert steps == pytest.approx(2 * white**2 * rate + walk**2 / rate, rel=0.03)
        means = values[:40_000].reshape(20, 2000, 3).mean(axis=1)  # over 1 s each
        assert np.diff(means, axis=0).var() == pytest.approx(walk**2 * 2 / 3, rel=0.6)


def test_keyframes_joined_linearly_are_felt_at_their_corners_alone() -> None:
    motion = Keyframes((0.0, 0.1, 0.2), ((0, 0, 0), (1, 0, 0), (1, 1, 0)), ((0, 0, 0, 1),) * 3)
    samples = Imu(motion, 1000.0, ImuNoise(), (0, 0, 0), 0).until(200_000)
    felt = np.abs(samples.acceleration).max(axis=1)
    assert set(np.flatnonzero(felt > 1e-6)) <= set(range(98, 103))
    assert samples.acceleration.sum(axis=0) / 1000 == pytest.approx([-10, -10, 0], rel=1e-6)  # y is down


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("accelerometer_noise_density: 0.01\n", "has no accelerometer_random_walk"),
        ("accelerometer_noise_density: many\n", "'many', expected a number"),
        ("accelerometer_noise_density: -1\n", "is -1, expected 0 or more"),
    ],
)
def test_a_wrong_file_of_noise_is_told(tmp_path, text: str, message: str) -> None:
    path = tmp_path / "imu.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_imu_noise(str(path))


def test_kalibrs_file_is_read(tmp_path) -> None:
    path = tmp_path / "imu.yaml"
    path.write_text(
        "#Accelerometers\naccelerometer_noise_density: 1.86e-03   #Noise density\n"
        "accelerometer_random_walk:   4.33e-04\ngyroscope_noise_density:     1.87e-04\n"
        "gyroscope_random_walk:       2.66e-05\nrostopic: /imu0\nupdate_rate: 200.0\n"
    )
    assert read_imu_noise(str(path)) == ImuNoise(1.86e-3, 4.33e-4, 1.87e-4, 2.66e-5)
    with pytest.raises(InputError, match="cannot be read"):
        read_imu_noise(str(tmp_path / "other.yaml"))
