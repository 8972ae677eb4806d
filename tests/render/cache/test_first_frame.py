"""How often the first frame is rendered, until its light is known."""

import numpy as np
import numpy.typing as npt
import pytest

from clsim.render.cache.first_frame import passes_of_first

PIXELS = 4096


def found(variance: float, paths: int) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Return what paths found whose relative variance is that, and that all of them hit something."""
    light = np.random.default_rng(3).gamma(1 / variance, variance, (paths, PIXELS, 1))
    return np.repeat(light, 3, axis=2).astype(np.float32), np.ones((paths, PIXELS, 4), np.float32)


@pytest.mark.parametrize(("variance", "error", "passes"), [(1.0, 0.25, 2), (1.0, 0.125, 8), (4.0, 0.25, 8)])
def test_paths_are_traced_until_their_mean_is_known_to_the_error(variance: float, error: float, passes: int) -> None:
    """The mean of n paths has a variance of that of one over n: 16, 64 and 64 paths, eight a pass."""
    assert abs(passes_of_first(*found(variance, 8), error) - passes) <= 1 + passes // 8


def test_light_that_is_known_at_once_is_learnt_twice() -> None:
    """What is seen in the second pass is looked up in what the first one learnt."""
    assert passes_of_first(*found(1e-4, 8), 0.28) == 2


def test_light_that_hardly_any_path_finds_does_not_take_for_ever() -> None:
    lights, positions = found(1.0, 32)
    lights[:] = 0.0
    lights[0] = 1.0
    assert passes_of_first(lights, positions, 0.28) == 5


def test_pixels_at_the_edge_of_nothing_do_not_count() -> None:
    """There, paths that met nothing and found no light tell of the pixel, and not of the light."""
    lights, positions = found(1.0, 8)
    whole = passes_of_first(lights, positions, 0.1)
    positions[:4, ::2, 3] = 0.0
    lights[:4, ::2] = 0.0
    assert abs(passes_of_first(lights, positions, 0.1) - whole) <= 2
