"""The mean of a checkerboard over a pixel in perspective, against many points."""

from __future__ import annotations

import numpy as np
import warp as wp

from clsim.render.textures.checkerboards import checker_mean
from clsim.render.textures.texture_data import Footprint, TextureRow

CORNERS = {"top_left": (0, 0), "top_right": (1, 0), "bottom_left": (0, 1), "bottom_right": (1, 1)}
POINTS = 200
"""In a row and in a column, for the truth: a share is right to about a two-hundredth."""

SCALE = 2.5
"""Squares for each 1 of uv."""


@wp.kernel(enable_backward=False)
def shares(footprints: wp.array(dtype=Footprint), lines: int, out_shares: wp.array(dtype=float)):
    """Write the share of the first colour."""
    row = TextureRow()
    row.scale = SCALE
    row.color_a = wp.vec3(1.0, 1.0, 1.0)
    out_shares[wp.tid()] = checker_mean(row, footprints[wp.tid()], lines)[0]


def test_the_mean_of_a_checkerboard_is_that_of_many_points():
    """In any direction, in perspective, from pixels within one square to some that show a dozen."""
    random = np.random.default_rng(0)
    count = 300
    middle = random.uniform(-3, 3, (count, 2, 1))
    along = random.uniform(-1, 1, (count, 2, 2)) * random.choice([0.1, 0.5, 2.0], (count, 1, 1))
    nearness, slope = random.uniform(0.3, 0.5, (count, 1)), random.uniform(-0.05, 0.05, (count, 2))
    # A square of the plane x, y, as a pixel sees it: uv over distance and 1 over distance are linear in the picture.
    corners = np.array(list(CORNERS.values()), float)
    near = nearness + slope @ corners.T
    uv = middle * nearness[:, None] + along @ corners.T * nearness[:, None]
    over_distance = np.concatenate([uv / SCALE, near[:, None]], axis=1).transpose(0, 2, 1)
    given = np.zeros(count, dtype=Footprint.numpy_dtype())
    for number, name in enumerate(CORNERS):
        given[name] = over_distance[:, number]

    place = (np.arange(POINTS) + 0.5) / POINTS
    x, y = (each.ravel() for each in np.meshgrid(place, place))
    weights = np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y])
    seen = over_distance.transpose(0, 2, 1) @ weights
    squares = np.floor(SCALE * seen[:, 0] / seen[:, 2]) + np.floor(SCALE * seen[:, 1] / seen[:, 2])
    true = (squares % 2 == 0).mean(axis=1)

    found = wp.zeros(count, dtype=float)
    wp.launch(shares, dim=count, inputs=[wp.array(given, dtype=Footprint), 16, found])
    error = np.abs(found.numpy() - true)
    # Where the pixel shows two columns, or two rows, no line is needed: one tells as much as many.
    wp.launch(shares, dim=count, inputs=[wp.array(given, dtype=Footprint), 1, found])
    of_corners = np.floor(SCALE * over_distance[:, :, :2] / over_distance[:, :, 2:])
    several = np.sort(np.ptp(of_corners, axis=1), axis=1)
    one_edge = (several == [0, 1]).all(axis=1)
    assert one_edge.sum() > 40 and np.abs(found.numpy() - true)[one_edge].max() < 0.004
    assert ((true > 0.02) & (true < 0.98)).sum() > 100
    assert error.max() < 0.03 and np.sqrt((error**2).mean()) < 0.004


def test_of_a_great_many_squares_each_colour_has_half():
    """However many there are: lines through a pixel end after some, and what lies beyond must not be left out."""
    random = np.random.default_rng(1)
    count = 200
    squares = np.geomspace(20, 1e5, count)
    turn = random.uniform(0, 2 * np.pi, count)
    across = squares[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1) / SCALE
    down = across[:, ::-1] * (-1, 1)
    given = np.zeros(count, dtype=Footprint.numpy_dtype())
    start = random.uniform(-3, 3, (count, 2))
    for name, (x, y) in CORNERS.items():
        given[name] = np.concatenate([start + x * across + y * down, np.ones((count, 1))], axis=1)
    found = wp.zeros(count, dtype=float)
    wp.launch(shares, dim=count, inputs=[wp.array(given, dtype=Footprint), 16, found])
    assert np.abs(found.numpy() - 0.5).max() < 0.02
