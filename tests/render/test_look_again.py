"""A second look by paths alone: it is what another run sees, and changes nothing."""

from __future__ import annotations

import numpy as np
import pytest
from test_light_cache import luminance, panning
from test_steered import Run, textured_world

from clsim.errors import InputError
from clsim.render import RenderOptions

pytestmark = pytest.mark.usefixtures("ordinary")


@pytest.mark.parametrize("noise", ["common", "independent"])
def test_a_second_look_is_that_of_the_complement_of_the_seed(noise):
    world, given = panning(textured_world()), {"first_hit_rays": 0, "spp": 8, "noise": noise}
    once, twice = (Run(world, look_again=every, **given) for every in (0, 3))
    other = Run(world, seed=2**64 - 1, **given)
    for index in range(3):
        np.testing.assert_array_equal(once.fill(index).planes, twice.fill(index).planes)
        assert twice.spent == once.spent
        first, again = twice.tracer.seen_twice(twice.frame)
        np.testing.assert_allclose(first, luminance(twice.frame).reshape(-1)[::3], rtol=1e-6)
        np.testing.assert_allclose(again, luminance(other.fill(index)).reshape(-1)[::3], rtol=1e-6)
        assert not np.allclose(first, again, rtol=0.01)


def test_first_hit_rays_without_kept_light_are_not_looked_at_again():
    with pytest.raises(InputError, match="`look_again` 3 needs `light_cache` or no `first_hit_rays`"):
        RenderOptions(look_again=3, first_hit_rays=8)
