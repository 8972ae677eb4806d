"""Events as arrays of fixed size."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clsim.errors import InputError
from clsim.events import EVENT_DTYPE
from clsim.events.grids import histogram, voxel_grid

WIDTH, HEIGHT = 5, 3


def some(seed: int, count: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    events = np.zeros(count, EVENT_DTYPE)
    events["t"] = np.sort(rng.integers(100, 1_101, count))
    events["x"], events["y"] = rng.integers(0, WIDTH, count), rng.integers(0, HEIGHT, count)
    events["on"] = rng.random(count) < 0.5
    return events


@given(st.integers(0, 99), st.integers(0, 40), st.integers(1, 6))
def test_grids_against_the_formula_event_by_event(seed: int, count: int, bins: int) -> None:
    events = some(seed, count)
    counts, voxels = np.zeros((2, HEIGHT, WIDTH)), np.zeros((bins, HEIGHT, WIDTH))
    for event in events:
        counts[int(event["on"]), event["y"], event["x"]] += 1
        at = (int(event["t"]) - 100) / 1_000 * (bins - 1)
        for k in range(bins):
            voxels[k, event["y"], event["x"]] += (1 if event["on"] else -1) * max(0.0, 1.0 - abs(k - at))
    assert (histogram(events, WIDTH, HEIGHT) == counts).all()
    np.testing.assert_allclose(voxel_grid(events, WIDTH, HEIGHT, bins, 100, 1_100), voxels, atol=1e-5)


def test_what_is_no_grid_is_told() -> None:
    for bins, end_us in ((0, 10), (3, 0)):
        with pytest.raises(InputError, match="expected at least 1 bin and an end after the start"):
            voxel_grid(some(0, 3), WIDTH, HEIGHT, bins, 0, end_us)


def test_an_event_outside_the_picture_counts_for_no_pixel_of_it() -> None:
    """Where width and height change places, its number is that of a pixel in another row."""
    events = some(0, 40)
    for grid in (
        lambda: histogram(events, HEIGHT, WIDTH),
        lambda: voxel_grid(events, HEIGHT, WIDTH, 3, 100, 1_100),
        lambda: histogram(events, WIDTH, HEIGHT - 1),
    ):
        with pytest.raises(InputError, match=r"an event at x=\d, y=\d lies outside \d × \d pixels"):
            grid()
    with pytest.raises(InputError, match="an end after the start"):
        voxel_grid(events, WIDTH, HEIGHT, 3, 100, float("nan"))  # type: ignore[arg-type]


def test_events_outside_the_time_count_once_at_the_nearest_end() -> None:
    events = np.zeros(4, EVENT_DTYPE)
    events["t"], events["x"], events["on"] = (0, 90, 2_000, 10**9), range(4), True
    voxels = voxel_grid(events, WIDTH, HEIGHT, 3, 100, 1_100)
    assert voxels[:, 0].T.tolist() == [[1, 0, 0], [1, 0, 0], [0, 0, 1], [0, 0, 1], [0, 0, 0]]
