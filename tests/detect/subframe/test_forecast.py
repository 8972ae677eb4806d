"""Where brightness should be known within a step, by the pictures at both ends: against NumPy in float64."""

from __future__ import annotations

import numpy as np
import pytest

from clsim.detect.subframe.forecast import BEND, Forecast
from clsim.opencl.device import choose_device
from clsim.opencl.workplace import Grid, Workplace

WIDTH, HEIGHT = 200, 90
WAY = np.array([2.3, -1.1])
NEARLY = 1e-4


def cubic(share):
    rest = 1 - share
    return np.array([
        -0.5 * share * rest**2, rest * (1 + share - 1.5 * share**2),
        share * (1 + rest - 1.5 * rest**2), -0.5 * rest * share**2,
    ])  # fmt: skip


def sampled(image, x, y):
    """An image at x, y ``[N]``, by Catmull and Rom's cubic."""
    x, y = np.clip(x, 0, WIDTH - 1), np.clip(y, 0, HEIGHT - 1)
    left, top = x.astype(int), y.astype(int)
    across, down = cubic(x - left), cubic(y - top)
    columns, rows = (np.clip(at + np.arange(-1, 3)[:, None], 0, n - 1) for at, n in ((left, WIDTH), (top, HEIGHT)))
    return np.einsum("jn,in,jin->n", down, across, image[rows[:, None], columns[None]])


@pytest.mark.parametrize("specks", [0.3, -0.3], ids=["bright", "dark"])
@pytest.mark.parametrize(("on", "off"), [(0.2, 0.2), (0.2, 0.7), (0.7, 0.2)])
def test_pixels_are_marked_where_what_is_carried_over_them_bends_near_a_threshold(on, off, specks):
    """Calm squares with specks in some: none of the pixels over which a speck goes is left out.

    Specks that are far from the threshold of their own polarity mark nothing, however near the other one is.
    """
    rng = np.random.default_rng(5)
    start, end = 0.02 * rng.random((2, HEIGHT, WIDTH))
    for image in start, end:
        image[(rng.random(image.shape) < 0.02) & (np.arange(WIDTH) > 40)] += specks
    device = choose_device()
    grid = Grid(WIDTH, HEIGHT, device.lanes, np.float32)
    place = Workplace(device, grid, device.queue())

    def held(image):
        whole = np.zeros(grid.image_shape, np.float32)
        whole[:, :WIDTH] = image
        buffer = place.allocate(grid.image_shape)
        place.write(buffer, whole)
        return buffer

    ways = np.zeros((3, 2, HEIGHT, WIDTH), np.float32)
    ways[:] = WAY[:, None, None]
    forecast = Forecast(place, on, off, False)
    pixels, _ = forecast.marks(held(start), held(end), held(np.zeros((HEIGHT, WIDTH))), ways)
    marked = np.isin(np.arange(WIDTH * HEIGHT), pixels)

    y, x = np.divmod(np.arange(WIDTH * HEIGHT), WIDTH)
    shares = np.linspace(0, 1, int(np.ceil(4 * np.hypot(*WAY))) + 1)
    values = np.array([
        (1 - s) * sampled(start, x - s * WAY[0], y - s * WAY[1])
        + s * sampled(end, x + (1 - s) * WAY[0], y + (1 - s) * WAY[1])
        for s in shares
    ])  # fmt: skip
    near = np.maximum(values.max(axis=0) - 0.5 * on, -values.min(axis=0) - 0.5 * off)
    chord = values[0] + shares[:, None] * (values[-1] - values[0])
    bent = np.abs(values - chord).max(axis=0) - 2 * BEND * min(on, off)
    assert marked[(near > NEARLY) & (bent > NEARLY)].all() and not marked[near < -NEARLY].any()
    reached = abs(specks) > 0.5 * (on if specks > 0 else off)
    assert 500 < marked.sum() < 0.7 * marked.size if reached else marked.sum() < 500
