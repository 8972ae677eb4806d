"""How bright the light of the first frame is, and how many paths tell it."""

import numpy as np
import numpy.typing as npt
import pytest

from clsim.render.cache.first_frame import paths_wanted, unit_of

PIXELS = 4096


def found(variance: float, paths: int) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Return what paths found whose relative variance is that, and that all of them hit something."""
    light = np.random.default_rng(3).gamma(1 / variance, variance, (paths, PIXELS, 1))
    return np.repeat(light, 3, axis=2).astype(np.float32), np.ones((paths, PIXELS, 4), np.float32)


@pytest.mark.parametrize(("variance", "error", "paths"), [(1.0, 0.125, 64), (1.0, 0.0625, 256), (4.0, 0.25, 64)])
def test_paths_are_traced_until_their_mean_is_known_to_the_error(variance: float, error: float, paths: int) -> None:
    """The mean of n paths has a variance of that of one over n."""
    assert paths_wanted(*found(variance, 32), error) == pytest.approx(paths, rel=0.15)


def test_few_paths_will_do_where_all_find_the_same() -> None:
    assert paths_wanted(*found(1e-4, 8), 0.28) < 0.01


def test_one_path_of_a_pixel_tells_nothing_of_others() -> None:
    assert paths_wanted(*found(4.0, 1), 0.01) == 0


def test_light_that_hardly_any_path_finds_does_not_take_for_ever() -> None:
    lights, positions = found(1.0, 32)
    lights[:] = 0.0
    lights[0] = 1.0
    assert paths_wanted(lights, positions, 0.28) == pytest.approx(160, rel=0.01)


def test_pixels_at_the_edge_of_nothing_do_not_count() -> None:
    """There, paths that met nothing and found no light tell of the pixel, and not of the light."""
    lights, positions = found(1.0, 8)
    whole = paths_wanted(lights, positions, 0.1)
    positions[:4, ::2, 3] = 0.0
    lights[:4, ::2] = 0.0
    assert paths_wanted(lights, positions, 0.1) == pytest.approx(whole, rel=0.1)


@pytest.mark.parametrize("mean", [1e-30, 3e-5, 1.0, 7e12])
def test_light_is_held_in_a_unit_that_is_near_it(mean: float) -> None:
    """Twice the light has twice the unit; where paths met nothing, or found nothing, nothing is told."""
    lights, positions = found(0.5, 8)
    unit = unit_of(lights * np.float32(mean), positions)
    assert unit is not None
    assert 1 < unit / mean < 10
    assert np.log2(unit) % 1 == 0
    assert unit_of(lights * np.float32(2 * mean), positions) == 2 * unit
    assert unit_of(lights, 0 * positions) is None
    assert unit_of(0 * lights, positions) is None
