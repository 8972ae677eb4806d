"""How much a stored path may count: no rare luck changes a wall's light, and no door that opens is missed."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from hypothesis import given
from hypothesis import strategies as st

from clsim.render.cache.light_cache import Followed
from clsim.render.cache.stored_paths import FOLLOWED_SUMS, StoredPath, build_storing

pytestmark = pytest.mark.usefixtures("ordinary")

LIMIT = 10.0


def cell_after(first, then, limit=LIMIT):
    """Return what a cell is told after its paths, which found ``first`` ``[n, 3]``, find ``then``."""
    count = len(first)
    rows = np.zeros(count, StoredPath.numpy_dtype())
    rows["rows"], rows["base"], rows["limit"] = (0, -1, -1, -1), 1.0, limit
    paths = wp.array(rows, dtype=StoredPath, device="cpu")
    sums = wp.zeros((1, FOLLOWED_SUMS), dtype=wp.int64, device="cpu")
    followed = wp.zeros(1, dtype=Followed, device="cpu")
    traced = wp.ones(count, dtype=wp.int32, device="cpu")
    for joining, light in ((True, first), (False, then)):
        found = wp.array(np.float32(light), dtype=wp.vec3, device="cpu")
        of = [0, joining, False]
        wp.launch(build_storing().add_paths, count, [*of, 1.0, paths, found, traced, sums, followed], device="cpu")
        wp.launch(build_storing().average_paths, count, [*of, 1, paths, traced, sums, followed], device="cpu")
    return followed.numpy()[0]


def light_after(first, then, limit=LIMIT):
    """Return the factor, the light and the error of a cell whose paths found grey light, if it had ``first``'s mean."""
    cell = cell_after(*(np.repeat(np.array(light)[:, None], 3, axis=1) for light in (first, then)), limit)
    return cell["factor"][0], cell["factor"][0] * np.mean(first) + cell["more"][0], cell["error"]


def test_one_path_that_loses_a_window_hardly_changes_a_wall():
    """It found two hundred times the others' light; without a limit three quarters of the cell's would go with it."""
    first = np.ones(64)
    first[5] = 200.0
    then = first.copy()
    then[5] = 0.0
    factor, _, error = light_after(first, then)
    assert factor == pytest.approx(63 / 73, rel=1e-4)
    assert error == pytest.approx(np.hypot(10 * 63 / 73, np.sqrt(63) * 10 / 73) / 73, rel=1e-3)
    assert light_after(first, first)[0] == 1.0  # where nothing has changed, to the bit


def test_a_lost_window_takes_no_more_of_its_colour_than_a_path_counts():
    """Blue sky came by one path into a room of red light: the others' colour stays."""
    first = np.tile([1.5, 1.0, 0.5], (64, 1))
    first[5] = 100.0, 200.0, 300.0
    then = first.copy()
    then[5] = 0.0
    others, sky = then.sum(axis=0), LIMIT * first[5] / 200.0
    assert cell_after(first, then)["factor"] == pytest.approx(others / (others + sky), rel=1e-4)


@pytest.mark.parametrize("times", [1.5, 20.0, 1000.0])
def test_light_that_all_paths_find_is_followed(times):
    """Where a door opens to a bright room; what counts by the limits alone may be a tenth too little."""
    first = np.random.default_rng(1).exponential(1.0, 64)
    assert light_after(first, times * first)[1] == pytest.approx(times * first.mean(), rel=0.1)
    assert light_after(times * first, first, times * LIMIT)[1] == pytest.approx(first.mean(), rel=1e-3)


def test_a_shutter_that_opens_to_the_sky_lights_a_dark_room():
    """One path in thirty finds it, a thousand times as bright as all was."""
    first = np.full(64, 0.01)
    then = first.copy()
    then[[3, 40]] = 30.0
    assert light_after(first, then, 0.1)[1] == pytest.approx(then.mean(), rel=1e-3)


@given(st.lists(st.floats(0.0, 1e4), min_size=8, max_size=64), st.integers(0, 63), st.floats(1.0, 1e3))
def test_more_light_on_a_path_makes_no_cell_darker(light, which, times):
    first = np.ones(len(light))
    more = np.array(light)
    more[which % len(light)] *= times
    assert light_after(first, more)[1] >= light_after(first, light)[1] * (1 - 1e-4)
