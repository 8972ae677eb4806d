"""Where brightness should be known within a step, by the pictures at both ends: against NumPy in float64."""

from __future__ import annotations

import numpy as np
import pytest

from clsim.detect.subframe.forecast import BEND, MOMENTS, Forecast
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


def carried(start, end, way, x, y, shares):
    """What the pictures at both ends, carried along one way, show at x, y ``[N]`` at shares of the step, ``[S, N]``."""
    return np.array([
        (1 - s) * sampled(start, x - s * way[0], y - s * way[1])
        + s * sampled(end, x + (1 - s) * way[0], y + (1 - s) * way[1])
        for s in shares
    ])  # fmt: skip


def marks_of(start, end, ways, on=0.2, off=0.2, linear_light=False, real=np.float32):
    """Which moments are marked of each pixel, ``[H, W, MOMENTS]``, where the last events were at 0."""
    device = choose_device()
    grid = Grid(start.shape[1], start.shape[0], device.lanes, real)
    place = Workplace(device, grid, device.queue())

    def held(image):
        whole = np.zeros(grid.image_shape, real)
        whole[:, : grid.width] = image
        buffer = place.allocate(grid.image_shape)
        place.write(buffer, whole)
        return buffer

    forecast = Forecast(place, on, off, linear_light)
    pixels, moments = forecast.marks(held(start), held(end), held(np.zeros(start.shape)), ways)
    found = np.zeros((*start.shape, MOMENTS), bool)
    found.reshape(-1, MOMENTS)[pixels, moments] = True
    return found


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
    ways = np.zeros((3, 2, HEIGHT, WIDTH), np.float32)
    ways[:] = WAY[:, None, None]
    marked = marks_of(start, end, ways, on, off).any(axis=2).ravel()

    y, x = np.divmod(np.arange(WIDTH * HEIGHT), WIDTH)
    shares = np.linspace(0, 1, int(np.ceil(4 * np.hypot(*WAY))) + 1)
    values = carried(start, end, WAY, x, y, shares)
    near = np.maximum(values.max(axis=0) - 0.5 * on, -values.min(axis=0) - 0.5 * off)
    chord = values[0] + shares[:, None] * (values[-1] - values[0])
    bent = np.abs(values - chord).max(axis=0) - 2 * BEND * min(on, off)
    assert marked[(near > NEARLY) & (bent > NEARLY)].all() and not marked[near < -NEARLY].any()
    reached = abs(specks) > 0.5 * (on if specks > 0 else off)
    assert 500 < marked.sum() < 0.7 * marked.size if reached else marked.sum() < 500


def specked(shape, seed, specks=0.4, share=0.1):
    """Two pictures of noise with bright and dark specks in a share of their pixels."""
    rng = np.random.default_rng(seed)
    images = 0.02 * rng.random((2, *shape))
    images += specks * rng.choice([-1, 0, 1], images.shape, p=[share / 2, 1 - share, share / 2])
    return images


def test_each_of_several_ways_marks_what_it_marks_alone():
    """So do ways that are as long to the right, or as long down, and part in the other, and one of half a pixel."""
    start, end = specked((37, 53), 3)
    several = [
        [(2.3, -1.1), (0.4, 0.3), (0.0, 0.0)], [(0.0, 0.0), (2.3, -1.1), (2.3, 2.0)],
        [(1.0, 3.0), (-2.0, 3.0), (0.1, -0.1)],
    ]  # fmt: skip
    for three in several:
        ways = np.zeros((3, 2, 37, 53), np.float32)
        ways[:] = np.array(three)[:, :, None, None]
        alone = [marks_of(start, end, np.broadcast_to(ways[k], ways.shape).copy()) for k in range(3)]
        assert (marks_of(start, end, ways) == alone[0] | alone[1] | alone[2]).all()
        assert sum(map(np.any, alone)) == 2, "one of the three ways is none, and marks nothing"
    ways[1] = ways[0] + 0.3  # which is one way for both
    assert (marks_of(start, end, ways) == alone[0]).all()


def test_a_picture_on_its_side_is_marked_likewise():
    """Rows for columns: ways that differ from pixel to pixel, up to the edges of a picture that is no square."""
    start, end = specked((90, 121), 4, share=0.01)
    ways = np.random.default_rng(5).uniform(-4.0, 4.0, (3, 2, 90, 121)).astype(np.float32)
    upright = marks_of(start, end, ways, real=np.float64)
    turned = ways[:, ::-1].transpose(0, 1, 3, 2).copy()
    assert (marks_of(start.T, end.T, turned, real=np.float64).transpose(1, 0, 2) == upright).all() and upright.any()


@pytest.mark.parametrize("step", [-1.5, 1.5], ids=["darker", "brighter"])
@pytest.mark.parametrize("linear_light", [False, True])
def test_lines_from_mark_to_mark_stay_near_what_is_carried_however_much_it_changes(linear_light, step):
    """In units of light where it is light that is linear: a share of what there is, be that little or much."""
    start, end = specked((HEIGHT, WIDTH), 6, 1.0)
    end += step
    ways = np.zeros((3, 2, HEIGHT, WIDTH), np.float32)
    ways[:] = WAY[:, None, None]
    marked = marks_of(start, end, ways, linear_light=linear_light, real=np.float64).reshape(-1, MOMENTS)
    y, x = np.divmod(np.arange(WIDTH * HEIGHT), WIDTH)
    parts = int(np.ceil(4 * np.hypot(*WAY)))
    levels = carried(start, end, WAY, x, y, np.linspace(0, 1, parts + 1)).T
    values = np.exp(levels) if linear_light else levels
    at = np.arange(parts + 1)
    for value, moments in zip(values[::7], marked[::7], strict=True):
        knots = np.unique([0, *np.round(np.flatnonzero(moments) * parts / MOMENTS), parts])
        off = np.abs(np.interp(at, knots, value[knots.astype(int)]) - value)
        assert (off / (value if linear_light else 1.0) < 2 * BEND * 0.2 + 1e-9).all()
