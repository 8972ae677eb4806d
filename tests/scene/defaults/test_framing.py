"""The camera that goes round what a file holds: it sees all of it, and not much else."""

import math
from pathlib import Path

import numpy as np
import pytest

from clsim.scene.defaults.framing import bounds, lamp, orbiting_camera
from clsim.scene.world import IDENTITY, Instance, Mesh


@pytest.mark.parametrize("size", [(1, 1, 1), (8, 0.5, 1), (0.2, 5, 0.3), (0.5, 4, 6), (0, 3, 0), (2, 0, 2)])
def test_a_box_is_just_seen_whole_from_everywhere_on_the_orbit(size):
    """By the pinhole's own projection; at the widest, 1.05 of the distance is left at the picture's edge."""
    center = np.array((5.0, -2.0, 1.0))
    camera = orbiting_camera(tuple(center.tolist()), np.array(size, float), period_s=4.0)
    right = math.tan(math.radians(camera.fov_deg / 2))
    limits = np.array((right, right * camera.height / camera.width))
    corners = center + np.stack(np.meshgrid(*[(-0.5, 0.5)] * 3), axis=-1).reshape(-1, 3) * size
    widest = 0.0
    for time_s in np.linspace(0.0, 4.0, 72, endpoint=False):
        pose = camera.motion.pose(time_s)
        x, y, z = ((corners - pose[:3, 3]) @ pose[:3, :3]).T
        assert (z < 0).all()
        widest = max(widest, float((np.abs(np.stack([x, y], axis=1)) / -z[:, None] / limits).max()))
    assert 0.85 < widest < 1


class Growing:
    """A shape whose corners move apart, until four times as far."""

    duration_s = 2.0

    def vertices_at(self, time_s):
        return FLAT * np.float32(1 + 1.5 * time_s), None


FLAT = np.array([(0, 0, 0), (1, 0, 0), (0, 2, 0)], np.float32)


def test_the_box_around_what_changes_its_shape_holds_all_shapes():
    mesh = Mesh(FLAT, np.array([[0, 1, 2]], np.int32), np.zeros(1, np.int32), deformation=Growing())
    center, size = bounds(Path("a.glb"), [mesh], [Instance(0, IDENTITY)])
    np.testing.assert_allclose(center, (2, 4, 0))
    np.testing.assert_allclose(size, (4, 8, 0))


@pytest.mark.parametrize("size", [(1, 1, 1), (8, 0.5, 1), (0.2, 5, 0.3), (0, 3, 0)])
def test_the_lamp_hangs_to_the_upper_right_in_front_and_lights_every_side_that_the_first_frame_shows(size):
    """As the camera sees it at the start: light comes over the right shoulder, and the lamp touches nothing."""
    center, size = np.array((5.0, -2.0, 1.0)), np.array(size, float)
    light = lamp(tuple(center.tolist()), size)
    away = light.motion.pose(0.0)[:3, 3] - center
    eye = orbiting_camera(tuple(center.tolist()), size).motion.pose(0.0)[:3, :3]
    assert (eye.T @ away > 0).all()  # right, up, and towards the camera
    assert np.linalg.norm(away) - light.radius_m > np.linalg.norm(size) / 2
    assert (away > size / 2).all()  # so it is before the front, the top and the right side of the box
