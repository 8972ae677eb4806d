"""Motions of USD files as our own: as many poses as it takes, and no more."""

from types import SimpleNamespace

import numpy as np
import pytest

from clsim.scene.motion import Static, compose, euler_quaternion, rotation_matrix
from clsim.scene.usd import motion
from clsim.scene.usd.motion import TOLERANCE, motion_of

STAGE = SimpleNamespace(start=10.0, seconds=lambda code: (code - 10.0) / 24)


def _turning(code):
    """Return a matrix whose angles about three axes are linear in time, as USD's ``rotateXYZ``; still after code 13."""
    angle = 40.0 * min(code - 10.0, 3.0)
    turn = rotation_matrix(euler_quaternion((angle, 0.5 * angle, -angle)))
    return compose((0.1 * code, 2.0, -code), turn * (1 + 0.1 * code))


def test_poses_are_added_only_where_slerp_differs():
    track = motion_of(STAGE, [10.0, 11.0, 13.0, 16.0], _turning, repeat=False)
    steps = np.diff(track.times_s) * 24
    assert steps.min() > 0 and steps[-1] == pytest.approx(3.0)  # what is still has no more poses than keys
    assert {float(step) for step in steps[:-1].round(9)} <= {2.0**-k for k in range(8)} and len(steps) < 400
    for code in np.random.default_rng(0).uniform(10.0, 16.0, 200):
        true = _turning(code)
        apart = np.abs(track.pose(STAGE.seconds(code)) - true).max()
        assert apart < 3 * TOLERANCE * np.abs(true).max()


def test_a_motion_has_no_more_poses_than_the_most(monkeypatch):
    monkeypatch.setattr(motion, "MAX_POSES", 11)
    track = motion_of(STAGE, [10.0, 11.0, 13.0], _turning, repeat=False)
    assert len(track.times_s) == 11 and np.all(np.diff(track.times_s) > 0)


def test_one_time_or_none_is_one_pose():
    assert np.array_equal(motion_of(STAGE, [], _turning, repeat=False).pose(0), _turning(10.0))
    assert isinstance(motion_of(STAGE, [], _turning, repeat=False), Static)
    assert np.allclose(motion_of(STAGE, [12.0], _turning, repeat=False).pose(5), _turning(12.0))
