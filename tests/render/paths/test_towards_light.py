"""Light straight from lights, found before textures are read: the same picture, to the last bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.scene import EnvironmentMap, ImageTexture, Material, PunctualLight, Static
from tests.render import hand_worlds as hw

WHITE = ImageTexture(np.full((1, 1, 4), 255, np.uint8), nearest=True)
"""Times this, a colour is itself."""


SKY = EnvironmentMap(np.random.default_rng(1).random((8, 16, 3), np.float32), np.eye(3))


def moved(mesh, by):
    return replace(mesh, vertices=mesh.vertices + np.float32(by))


@pytest.mark.slow
@pytest.mark.parametrize("sky", [None, SKY])
def test_looking_ahead_changes_nothing(sky):
    """A plain texture makes rays to lights go first: past glass, mirrors, dark backs and lamps that shine one way."""
    kinds = (
        Material(color=(0.5, 0.6, 0.7)),
        Material(kind="dielectric", alpha=0.2, ior=1.5),
        Material(kind="dielectric", alpha=0.0, ior=1.5),
        Material(kind="conductor", alpha=0.0, color=(0.9, 0.8, 0.7)),
        Material(kind="conductor", alpha=0.3, color=(0.9, 0.8, 0.7)),
        Material(kind="plastic", alpha=0.1, color=(0.3, 0.5, 0.2)),
        Material(color=(0.8, 0.2, 0.2), back="black"),
        Material(color=(0.1, 0.1, 0.1), emission=(9.0, 8.0, 7.0), emits_behind=False),
    )
    balls = [moved(hw.ball(0.4, material=i), (1.1 * (i % 3) - 1.1, 0.4, 1.1 * (i // 3) - 0.6)) for i in range(6)]
    scene = hw.world(
        hw.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)),
        *balls,
        hw.quad((-2, 0.2, -2), (1, 0, 0), (0, 1, 0.5), material=6),
        hw.quad((-1, 3, -1), (2, 0, 0), (0, 0, 2), material=7),
        materials=kinds,
        view=hw.camera(hw.look_from((0.5, 2.0, 5), (0, 0.3, 0)), 32, 24),
        environment_map=sky,
    )
    textured = replace(scene, textures=(WHITE,), materials=tuple(replace(kind, texture=0) for kind in kinds))
    plain, ahead = (hw.render(each, spp=4).planes for each in (scene, textured))
    assert plain[:3].mean() > 0.1
    np.testing.assert_array_equal(plain, ahead)


def test_a_textured_floor_has_the_light_of_a_lamp():
    """A point lamp's irradiance has no noise."""
    floor = hw.quad((-1, 0, 1), (2, 0, 0), (0, 0, -2))
    lamp = PunctualLight("point", (8.0, 6.0, 4.0), Static(hw.translation(0, 2, 0)))
    view = hw.camera(hw.look_from((0, 1, 0), (0, 0, 0), up=(0, 0, -1)), 2, 2, fov_deg=0.02)
    grey = Material(color=(0.5, 0.5, 0.5), texture=0)
    scene = hw.world(floor, materials=(grey,), textures=(WHITE,), view=view, punctual_lights=(lamp,))
    expected = np.array([8.0, 6.0, 4.0])[:, None, None] / 2.0**2 * 0.5 / np.pi
    np.testing.assert_allclose(hw.radiance(hw.render(scene, spp=1)), np.broadcast_to(expected, (3, 2, 2)), rtol=1e-4)
