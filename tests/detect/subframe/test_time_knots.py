"""Brightness between frames, as if it were traced: closed forms take the place of pixels."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clsim.detect.config import DetectorConfig
from clsim.detect.subframe.knots import CAUTION, TICKS_PER_S, Knots, ticks, vague
from clsim.detect.subframe.traced_levels import traced_levels
from clsim.frames import RADIANCE, Frame, rendered_planes
from clsim.sensor.reference.ideal import walk

STEP = 2**15
"""A step of 1/30 s [ticks]."""


def whole_step(levels, linear_light=False):
    """One piece a pixel; ``levels`` is the pair of each pixel's levels at both ends."""
    levels = np.asarray(levels, float)
    count = len(levels)
    times = np.tile([0, STEP], count)
    return Knots(np.repeat(np.arange(count), 2), times, levels.ravel(), np.full(2 * count, np.inf), linear_light)


def sharpened(functions, tolerance, on=0.2, off=0.2, linear_light=False):
    """Ask functions of the share of the step until their crossings are known; return knots and how often was asked."""
    knots = whole_step([(f(0.0), f(1.0)) for f in functions], linear_light)
    references = np.array([f(0.0) for f in functions])
    asked = 0
    for _ in range(30):
        pieces, times = vague(knots, references, on, off, tolerance, 1)
        if not len(pieces):
            return knots, asked
        asked += len(pieces)
        pixels = knots.pixels[pieces]
        knots.insert(pieces, times, np.array([functions[p](t / STEP) for p, t in zip(pixels, times, strict=True)]))
    raise AssertionError("it comes to no end")


def events(knots, pixel, reference, on=0.2, off=0.2):
    mine = knots.pixels == pixel
    points = list(zip(knots.times[mine].tolist(), knots.levels[mine].tolist(), strict=True))
    return [(time, rises) for time, rises, _ in walk(points, reference, on, off)[0]]


def test_a_time_has_its_tick_whatever_the_frame_rate():
    for fps in (30, 60, 120, 240):
        assert [ticks(round(k * 1e6 / fps)) for k in (0, 1, 7)] == [k * 2**15 * 30 // fps for k in (0, 1, 7)]
    assert TICKS_PER_S == 983040


@given(st.lists(st.lists(st.floats(-2, 2), min_size=2, max_size=7), min_size=1, max_size=5), st.floats(0.1, 0.5))
def test_pixels_walk_as_each_does_alone(rows, off):
    pixels = np.repeat(np.arange(len(rows)), [len(row) for row in rows])
    times = np.concatenate([np.arange(len(row)) * 100 for row in rows])
    knots = Knots(pixels, times, np.concatenate(rows), np.full(len(pixels), np.inf))
    _, crossings = knots.walk(np.array([row[0] for row in rows]), 0.2, off)
    for pixel, row in enumerate(rows):
        alone, _, margin = walk([(100.0 * k, level) for k, level in enumerate(row)], row[0], 0.2, off)
        if margin > 1e-9:
            mine = [bool(n > 0) for n in crossings[pixels == pixel] for _ in range(abs(n))]
            assert mine == [rises for _, rises, _ in alone]


@pytest.mark.parametrize("tolerance", [100.0, 10.0])
def test_crossings_of_curves_are_found_to_the_tolerance(tolerance):
    """Roots and squares: the k-th crossing is where the closed form is k thresholds above its start."""
    curves = [lambda x, p=p: 1.1 * x**p for p in (0.7, 0.9, 1.5, 3.0)]
    knots, asked = sharpened(curves, tolerance)
    for pixel, p in enumerate((0.7, 0.9, 1.5, 3.0)):
        expected = [(0.2 * k / 1.1) ** (1 / p) * STEP for k in range(1, 6)]
        found = [time for time, rises in events(knots, pixel, 0.0) if rises]
        assert len(found) == 5
        np.testing.assert_allclose(found, expected, atol=tolerance)
    assert asked < 20 * (3 if tolerance > 50 else 5)


@pytest.mark.parametrize("tolerance", [100.0, 10.0])
def test_crossings_of_light_that_bends_are_found_to_the_tolerance(tolerance):
    """Light of 1 + 4xᵖ is eᵏᶜ at a time in closed form; where it is a ramp (p = 1), one look says so."""
    powers = (1.0, 1.5, 3.0)
    knots, asked = sharpened([lambda x, p=p: np.log1p(4 * x**p) for p in powers], tolerance, linear_light=True)
    before, crossings = knots.walk(np.zeros(len(powers)), 0.2, 0.2)
    for pixel, p in enumerate(powers):
        pieces = np.flatnonzero((knots.pixels == pixel) & (crossings > 0))
        pieces, number = np.repeat(pieces, crossings[pieces]), np.concatenate([np.arange(crossings[k]) for k in pieces])
        share, _ = knots.crossed(pieces, before[pieces] + 0.2 * (number + 1))
        start, end = knots.times[pieces - 1], knots.times[pieces]
        expected = (np.expm1(0.2 * np.arange(1, 9)) / 4) ** (1 / p) * STEP
        np.testing.assert_allclose(start + share * (end - start), expected, atol=tolerance)
    assert np.sum(knots.pixels == 0) == 3 and asked < 1 + 16 * 4


def test_a_straight_line_is_asked_once_and_a_flat_one_never():
    _, asked = sharpened([lambda x: 0.5 * x, lambda x: 0.1 * x], 50.0)
    assert asked == 1


@pytest.mark.parametrize("sign", [1, -1])
def test_what_rises_and_falls_again_is_found_once_its_bend_is_known(sign):
    """A bump whose top alone passes the threshold, asked at its flank first; and a dip."""
    knots = whole_step([(0.0, 0.0)])
    knots.insert(np.array([1]), np.array([STEP // 4]), np.array([sign * 0.17]))
    pieces, times = vague(knots, np.zeros(1), *(0.2, 9.0)[::sign], 100.0, 1)
    assert pieces.tolist() == [2] and STEP // 4 < times[0] < STEP
    assert len(vague(knots, np.zeros(1), *(9.0, 0.2)[::sign], 100.0, 1)[0]) == 0, "the other threshold is far away"


def test_light_that_is_a_line_is_twice_as_bright_halfway_to_three_times():
    """Its logarithm then rises by light's own slope, 2 a step, over 2."""
    share, rise = whole_step([(0.0, np.log(3))], linear_light=True).crossed(np.array([1]), np.log([2.0]))
    assert (share[0], rise[0]) == (pytest.approx(0.5), pytest.approx(1.0))


def test_bends_between_known_levels_are_guessed_from_both_sides():
    x = np.array([0, 0.25, 0.5, 0.75, 1.0])
    levels = np.concatenate([x**2, 3 * x])
    knots = Knots(np.repeat([0, 1], 5), np.tile((x * STEP).astype(int), 2), levels, np.full(10, np.inf))
    knots.guess_error_bounds()
    # A parabola x² leaves its chord by h²/4, and more is taken; a straight line tells of no bend.
    np.testing.assert_allclose(knots.error_bounds[1:5], CAUTION * 0.25**2 / 4)
    assert np.isinf(knots.error_bounds[[0, 5]]).all()
    assert np.isinf(knots.error_bounds[6:]).all()


def test_bends_of_light_are_guessed_as_those_of_its_logarithm():
    x = np.array([0, 0.25, 0.5, 0.75, 1.0])
    knots = Knots(np.zeros(5, int), (x * STEP).astype(int), np.log1p(x**2), np.full(5, np.inf), linear_light=True)
    knots.guess_error_bounds()
    middle = 0.5 * (x[:-1] + x[1:])
    # In the middle of a piece a parabola of light is h²/4 below its chord.
    off = np.log1p((0.25**2 / 4) / (1 + middle**2))
    assert np.all(knots.error_bounds[1:] >= 0.75 * CAUTION * off) and np.all(
        knots.error_bounds[1:] <= 1.5 * CAUTION * off
    )


@pytest.mark.parametrize("linear_light", [False, True])
def test_levels_at_a_time_lie_on_the_lines_between_knots(linear_light):
    levels = np.array([0.0, 1.0, 0.5, -1.0, 3.0])
    knots = Knots(np.array([0, 0, 0, 1, 1]), np.array([10, 20, 40, 10, 40]), levels, np.zeros(5), linear_light)
    shape = np.exp if linear_light else np.asarray
    for time in (15, 20, 33):
        one, other = (np.interp(time, knots.times[mine], shape(levels[mine])) for mine in (slice(3), slice(3, 5)))
        np.testing.assert_allclose(shape(knots.at(time)), [one, other])
    assert knots.renumbered(np.array([4, 7])).pixels.tolist() == [4, 4, 4, 7, 7]


def test_light_traced_between_frames_has_their_scale_and_floor() -> None:
    config = DetectorConfig(method="esim", scale=3.0, floor=0.5)
    levels = traced_levels(config, RADIANCE, (1, 2), lit=True)
    found = levels.levels(np.array([[1.0, 0.0]] * 3, np.float32), np.arange(2), np.zeros(2))
    np.testing.assert_allclose(found, np.log([3.0, 0.5]), rtol=1e-6)


def mirror(picture, turn):
    """Return pictures ``[…, H, W]`` that are mirrored left to right, upside down, or along the diagonal."""
    mirrors = {"left to right": picture[..., ::-1], "upside down": picture[..., ::-1, :]}
    return mirrors.get(turn, picture.swapaxes(-1, -2))


@pytest.mark.parametrize("turn", ["diagonal", "left to right", "upside down"])
def test_light_that_goes_along_with_surfaces_goes_the_same_way_in_a_mirror(turn):
    """No way is rounded to one side more than to the other: mirrored frames, ways and requests have the same levels."""
    random, shape = np.random.default_rng(4), (7, 9)
    names = rendered_planes(first_hit_rays=True).names
    config = DetectorConfig(threshold_on=0.2, threshold_off=0.2)

    def levels_of(frames, ways, asked, shares):
        height, width = frames.shape[-2:]
        found = traced_levels(config, names, (height, width), lit=False)
        for planes in frames:
            found.advance(Frame(np.ascontiguousarray(planes), names))
        start, end = np.log(frames[:, 0]).astype(np.float32)
        found.begin(start, end, np.ascontiguousarray(ways))
        pixels = np.arange(height * width)
        there = found.levels(np.ascontiguousarray(asked).reshape(len(names), -1), pixels, shares.ravel())
        return there.reshape(height, width)

    frames = random.uniform(0.5, 2.0, (2, len(names), *shape)).astype(np.float32)
    frames[:, names.index("Emission")] *= 0.1
    ways, asked = random.normal(0, 1.5, (3, 2, *shape)).astype(np.float32), frames[0] * 0.9
    shares = random.uniform(size=shape)
    mirrored = mirror(ways, turn).copy()
    if turn == "diagonal":
        mirrored = mirrored[:, ::-1]
    else:
        mirrored[:, 0 if turn == "left to right" else 1] *= -1.0
    expected = mirror(levels_of(frames, ways, asked, shares), turn)
    given = [mirror(each, turn) for each in (frames, asked, shares)]
    np.testing.assert_allclose(levels_of(given[0], mirrored, *given[1:]), expected, rtol=1e-5)
    assert np.ptp(expected) > 0.5


@pytest.mark.parametrize("linear_light", [False, True])
def test_a_piece_that_lies_at_a_threshold_is_asked_about_within_it(linear_light):
    """It crosses where it begins, if the light of the step before was left just below."""
    knots = Knots(
        np.array([0, 0]), np.array([4096, 8192]), np.array([0.5, 0.5]), np.array([np.inf, np.inf]), linear_light
    )
    with np.errstate(all="raise"):
        pieces, times = vague(knots, np.array([0.25]), 0.25, 0.25, 100.0, 1)
    assert pieces.tolist() == [1]
    assert 4096 < times[0] < 4096 + 2048
