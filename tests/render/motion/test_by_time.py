"""Rows of numbers that belong to instants."""

from __future__ import annotations

import numpy as np

from clsim.render.motion.by_time import ByTime
from clsim.render.motion.pose_cache import PoseCache
from tests.render.motion.test_blur import Glide


def test_each_instant_is_found_once_and_none_is_mistaken_for_another():
    asked = []

    def find(times_s):
        asked.extend(times_s.tolist())
        return np.stack([times_s, -times_s], axis=1).astype(np.float32)

    by_time = ByTime(find)
    for times_s in ([0.5, 0.25], [0.25], [0.75, 0.125, 0.5], [1.0, 1.0]):
        np.testing.assert_array_equal(by_time.rows(np.array(times_s))[:, 0], times_s)
    assert sorted(asked) == [0.125, 0.25, 0.5, 0.75, 1.0]
    by_time.forget()
    by_time.rows(np.array([0.5]))
    assert asked.count(0.5) == 2


def test_a_pose_that_is_remembered_is_that_of_its_motion_and_instant():
    cache, motions = PoseCache(), (Glide(), Glide((5.0, 0.0, 0.0)))
    for time_s in (0.5, 0.5 + 1e-9, 0.25, 0.5):
        for motion in motions:
            np.testing.assert_array_equal(cache.pose(motion, time_s), motion.pose(time_s))
