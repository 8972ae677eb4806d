"""The numbers of scattering models are the kernels' own, whatever the order in which the scene room lists its names."""

from typing import get_args

from clsim.render.features import bsdf_kinds
from clsim.scene.world import Kind


def test_each_model_of_a_scene_has_a_number_of_its_own():
    assert set(bsdf_kinds.NUMBERS) == set(get_args(Kind))
    assert sorted(bsdf_kinds.NUMBERS.values()) == list(range(len(bsdf_kinds.NUMBERS)))


def test_the_constants_are_those_of_the_table():
    for kind, number in bsdf_kinds.NUMBERS.items():
        assert getattr(bsdf_kinds, kind.upper().replace("-", "_")) == number
