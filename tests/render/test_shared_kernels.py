"""The kernels that tests of rendering share give the pictures of those that users get."""

import numpy as np
import pytest

from clsim.render.scene_data import SceneData
from clsim.scene import load_world
from tests.render import hand_worlds as hw


@pytest.mark.slow
@pytest.mark.parametrize("known", ["any_lights", "anything"])
@pytest.mark.parametrize("scene", ["cornell", "moving-light"])
def test_what_is_known_and_absent_decides_nothing(scene: str, known: str, request: pytest.FixtureRequest) -> None:
    """The same random numbers decide the same: pictures differ by rounding, but for a path here or there."""
    if request.config.getoption("own_kernels"):
        pytest.skip("no kernel is shared")
    world = load_world(scene, resolution=(32, 24))
    features, own = SceneData(world).features, hw.render(world, 3, spp=64).planes
    request.getfixturevalue(known)
    assert SceneData(world).features != features
    shared = hw.render(world, 3, spp=64).planes
    near = np.isclose(own, shared, rtol=1e-3, atol=1e-5, equal_nan=True)
    assert near.mean() > 0.99
