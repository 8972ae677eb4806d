"""The numbers of scattering models are the kernels' own, whatever the order in which the scene room lists its names."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from clsim.render.features import bsdf_kinds
from clsim.render.features.scene_features import scene_features
from clsim.scene import Camera, ImageTexture, Instance, Material, Static, World, shapes
from clsim.scene.toml.check import KINDS_WITH
from clsim.scene.world import Kind


def test_each_model_of_a_scene_has_a_number_of_its_own():
    assert set(bsdf_kinds.NUMBERS) == set(get_args(Kind))
    assert sorted(bsdf_kinds.NUMBERS.values()) == list(range(len(bsdf_kinds.NUMBERS)))


def test_the_constants_are_those_of_the_table():
    for kind, number in bsdf_kinds.NUMBERS.items():
        assert getattr(bsdf_kinds, kind.upper().replace("-", "_")) == number


@pytest.mark.parametrize("kind", get_args(Kind))
def test_a_texture_of_roughness_is_read_for_each_model_that_a_scene_may_give_one(kind):
    texture = ImageTexture(np.full((1, 1, 4), 128, np.uint8), srgb=False)
    material = Material(kind=kind, roughness_texture=0)
    world = World(
        "w", Camera(4, 4, 50.0, Static(np.eye(4))), (shapes.box((1.0, 1.0, 1.0)),), (Instance(0, Static(np.eye(4))),)
    )
    found = scene_features(replace(world, materials=(material,), textures=(texture,)), 0.0)
    assert found.roughness_textures == found.images == (kind in KINDS_WITH["roughness_texture"])
