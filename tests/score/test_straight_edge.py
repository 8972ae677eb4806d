"""The straight edge in closed form, against brute force."""

import math

import numpy as np
import pytest

from clsim.score.straight_edge import Edge

SLANTED = (math.cos(math.radians(20)), math.sin(math.radians(20)))
EDGES = [
    Edge(SLANTED, 3.2, 40.0, 0.25, 1.0),
    Edge((-SLANTED[0], SLANTED[1]), -9.0, 40.0, 1.0, 0.25),
    Edge(SLANTED, 3.2, 40.0, 0.25, 1.0, ramp_px=2.5),
    Edge((1.0, 0.0), 3.3, 40.0, 0.25, 1.0),
    Edge((0.0, -1.0), -8.2, 40.0, 0.25, 1.0, ramp_px=0.4),
    Edge((1.0, 1e-7), 3.3, 40.0, 0.25, 1.0),
    Edge((math.sqrt(0.5), math.sqrt(0.5)), 5.0, 40.0, 1.0, 0.2),
]


def sampled(edge: Edge, right, down, time_s: float, side: int) -> np.ndarray:
    """Return the mean luminance of pixels at corners ``right, down`` over a grid of ``side`` × ``side`` points."""
    at = (np.arange(side) + 0.5) / side
    x, y = np.asarray(right)[..., None, None] + at, np.asarray(down)[..., None, None] + at[:, None]
    passed = edge.offset_px + edge.speed_px_s * time_s - edge.normal[0] * x - edge.normal[1] * y
    share = np.clip(passed / edge.ramp_px + 0.5, 0, 1) if edge.ramp_px else passed > 0
    return edge.ahead + (edge.behind - edge.ahead) * share.mean(axis=(-1, -2))


@pytest.mark.parametrize("edge", EDGES)
def test_pixels_see_what_many_points_in_them_see(edge):
    down, right = np.mgrid[:9, :12]
    for time_s in (0.0, 0.031, 0.1):
        expected = sampled(edge, right, down, time_s, 200)
        assert ((expected > 0.26) & (expected < 0.99)).sum() >= 4, "the edge is outside the picture"
        np.testing.assert_allclose(edge.luminance(12, 9, time_s), expected, atol=4e-3)


@pytest.mark.parametrize("edge", EDGES)
def test_shares_are_inverted_to_the_last_digits(edge):
    shares = np.linspace(0.001, 0.999, 97)
    np.testing.assert_allclose(edge.share(edge.passed_px(shares)), shares, rtol=0, atol=1e-11)


def test_times_are_the_nearest_whole_us():
    """An upright edge brightens a pixel evenly from 0.25 to 1, which is 0.25·e^(0.198 n) at the n-th event.

    The last of them fires a few microseconds before the end.
    """
    found = Edge((1.0, 0.0), 0.0, 30.0, 1.0, 0.25).events(3, 1, 0.1, 0.198)
    steps = np.arange(1, 8)
    expected = [x / 30.0 + (0.25 * np.exp(0.198 * steps) - 0.25) / 0.75 / 30.0 for x in range(3)]
    np.testing.assert_array_equal(found["t"], np.rint(1e6 * np.ravel(expected)))


@pytest.mark.parametrize("edge", [*EDGES[:2], *(pytest.param(edge, marks=pytest.mark.slow) for edge in EDGES[2:])])
def test_events_fire_when_brightness_has_changed_by_the_threshold(edge):
    """Each pixel's sequence, and the brightness at each stamp, counted over many points."""
    events = edge.events(12, 9, 0.1, 0.2)
    assert len(events) > 150 and np.all(np.diff(events["t"]) >= 0)
    assert set(events["on"]) == {edge.behind > edge.ahead}
    sign = 1 if edge.behind > edge.ahead else -1
    for pixel in {(int(e["x"]), int(e["y"])) for e in events[:: len(events) // 12]}:
        stamps = events["t"][(events["x"] == pixel[0]) & (events["y"] == pixel[1])]
        first, last = (sampled(edge, *pixel, t, 2000) for t in (0.0, 0.1))
        change = [sign * math.log(sampled(edge, *pixel, t / 1e6, 2000) / first) for t in stamps]
        assert len(stamps) == int(sign * math.log(last / first) / 0.2 + 1e-3)
        np.testing.assert_allclose(change, 0.2 * np.arange(1, len(stamps) + 1), atol=8e-3)
