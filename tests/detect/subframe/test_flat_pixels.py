"""Brightness of pixels that show one flat surface, with a tracer that knows its albedo in closed form."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detect.subframe.between import Motion
from clsim.detect.subframe.flat_pixels import FlatPixels
from clsim.detect.subframe.knots import TICKS_PER_S
from clsim.detect.subframe.refine import Refiner
from clsim.frames import ALBEDO, COVERAGE, RADIANCE, Frame, Reflected, page_aligned
from clsim.opencl.path import BrightnessPath

SIZE = (40, 60)
NAMES = (*RADIANCE, *ALBEDO, *COVERAGE)
STEP_US = 33_333
WAY = (3.0, -1.0)


@dataclass
class Wall:
    """A wall of albedo 0.8 that from halfway through a step darkens to 0.2; a hole in it is seen at both ends."""

    holes: list[tuple[int, int]] = field(default_factory=list)
    told: bool = True
    lit: bool = True
    steady: bool = False
    names: tuple[str, ...] = NAMES
    asked: object = None

    def albedo(self, shares):
        return np.where(shares < 0.5, 0.8, 0.8 - 1.2 * (shares - 0.5))

    def bounds(self):
        found = np.zeros(SIZE, bool)
        for hole in self.holes[:1]:
            found[hole] = True
        self.holes = self.holes[1:]
        return found if self.told else None

    def steady_shadows(self):
        return np.full(SIZE[0] * SIZE[1], self.steady)

    def reflected(self, pixels, light, start_s, end_s, fineness):
        assert (start_s, end_s) == (0.0, STEP_US * 1e-6) and fineness.linear
        self.asked = fineness
        shares = np.tile(np.array([0.0, 0.5, 1.0], np.float32), (len(pixels), 1))
        start, end = (light[rows, :].sum(axis=0)[pixels, None] for rows in (slice(0, 3), slice(3, 6)))
        values = self.albedo(shares) * (start + (end - start) * shares)
        firsts = np.arange(len(pixels) + 1) * 3
        return Reflected(pixels, pixels, firsts, shares.ravel(), values.astype(np.float32).ravel())


def found_by(wall, lights=(2.0, 2.0), albedos=(0.8, 0.2), halfway=0.5, **options):
    """Show a wall at both ends of a step, in light [H, W]; return what is known of it, and the levels at both."""
    config = DetectorConfig(method="esim", event_rule="linear-light", **options)
    flat = FlatPixels(config, NAMES, SIZE)
    levels = []
    for light, albedo in zip(lights, albedos, strict=True):
        frame = Frame(page_aligned((len(NAMES), *SIZE)), NAMES)
        frame.planes[3:6] = albedo
        frame.planes[:3] = frame.planes[3:6] * light
        frame.planes[6] = 1.0
        flat.advance(frame, wall)
        levels.append(np.log(np.maximum(config.scale * frame.planes[0].ravel(), config.floor)))
    ways = np.tile(np.array(WAY, np.float32)[:, None, None], (3, 1, *SIZE))
    path = BrightnessPath(0, STEP_US, *[None] * 3, 0)
    motion = Motion(ways, halfway * ways)
    return flat.find(path, wall, motion, tuple(levels), 100.0), levels


@pytest.mark.parametrize(("scale", "floor"), [(1.0, 1e-4), (0.03, 1e-4), (7.0, 1e-4), (1.0, 1.607)])
def test_light_goes_straight_and_albedo_as_it_is_told(scale, floor):
    found, (start, end) = found_by(Wall(), lights=(2.0, 2.02), scale=scale, floor=floor)
    assert found.known.reshape(SIZE)[10:30, 10:50].all()
    pixel = 20 * SIZE[1] + 30
    mine = found.knots.pixels == np.searchsorted(found.pixels, pixel)
    middle = np.log(max(scale * 0.8 * 2.01, floor))
    np.testing.assert_allclose(found.knots.levels[mine], [start[pixel], middle, end[pixel]], atol=1e-6)
    np.testing.assert_allclose(found.knots.times[mine] / TICKS_PER_S * 1e6, [0, STEP_US / 2, STEP_US], atol=2)


def test_those_that_fire_leave_their_thresholds_at_any_knot():
    found, (start, _) = found_by(Wall())
    assert len(found.that_fire(start, 0.2, 0.2).pixels) == len(found.pixels) > 500
    assert not len(found.that_fire(start, 0.2, 5.0).pixels)
    few = found.that_fire(np.where(np.arange(len(start)) % 2, start, np.nan), 0.2, 0.2)
    assert (few.pixels % 2 == 1).all() and few.knots.pixels.max() == len(few.pixels) - 1


def test_nothing_is_known_where_something_else_may_come_over_a_pixel():
    """A hole goes 3 to the right and 1 up, and may be anywhere between.

    At the picture's border either end tells what comes over a pixel; at two of its corners neither does.
    """
    known = found_by(Wall(holes=[(20, 30), (19, 33)]))[0].known.reshape(SIZE)
    expected = np.ones(SIZE, bool)
    expected[19:21, 30:34] = False
    expected[0, :3] = expected[-1, -3:] = False
    np.testing.assert_array_equal(known, expected)


def test_where_something_may_come_over_a_pixel_it_is_told_when_it_may_fire_by_itself():
    found, (start, _) = found_by(Wall(holes=[(20, 30), (19, 33)]))
    unsure = 20 * SIZE[1] + 32
    assert unsure in found.unsure and not found.known[found.unsure].any()
    pixels, times = found.peaks(start, 0.2, 0.2)
    np.testing.assert_allclose(times[pixels == unsure] / TICKS_PER_S * 1e6, [STEP_US], atol=2)
    assert not len(found.peaks(start, 0.2, 5.0)[0])
    # One that is known needs no ray, and one without a reference does not fire.
    assert 10 * SIZE[1] + 30 not in pixels and not len(found.peaks(np.full_like(start, np.nan), 0.2, 0.2)[0])


def test_nothing_is_known_of_a_step_in_which_motion_turns_back():
    """What is farther away than the step's way may come and go meanwhile."""
    assert found_by(Wall(), halfway=0.9)[0].known.any() and not found_by(Wall(), halfway=1.5)[0].known.any()


@pytest.mark.parametrize("ratio, kept", [(1.03, True), (3.0, False)], ids=["wide", "sharp"])
def test_a_shadow_with_a_sharp_edge_is_traced(ratio, kept):
    light = np.full(SIZE, 2.0, np.float32)
    light[:, 30:] /= ratio
    assert found_by(Wall(), lights=(light, light))[0].known.reshape(SIZE)[20, 30] == kept


def test_light_that_differs_from_pixel_to_pixel_is_traced():
    """Rays have found it, so that it goes in stairs: in soft shadows, one pixel is off by a ray of 25."""
    uneven = np.full(SIZE, 2.0, np.float32)
    uneven[20, 30] *= 0.96
    for lights in ((uneven, 2.0), (2.0, uneven)):
        known = found_by(Wall(), lights=lights)[0].known.reshape(SIZE)
        assert not known[20, 30] and known[20, 29] and known[21, 30]


def test_uneven_light_is_known_where_the_same_rays_found_it_in_both_frames():
    uneven = np.full(SIZE, 2.0, np.float32)
    uneven[20, 30] *= 0.96
    assert found_by(Wall(steady=True), lights=(uneven, uneven))[0].known.reshape(SIZE)[20, 30]


def test_light_that_changes_much_is_traced():
    assert not found_by(Wall(), lights=(2.0, 3.0))[0].known.any()


@pytest.mark.parametrize("albedos", [(0.5, 0.5), (0.8, 0.19), (0.78, 0.2)])
def test_a_pixel_that_shows_something_else_too_is_traced(albedos):
    """Its albedo is not that of the surface its corners see: at both ends, at the last, at the first."""
    assert not found_by(Wall(), albedos=albedos)[0].known.any()


def test_where_no_bounds_are_told_nothing_is_known():
    assert not found_by(Wall(told=False))[0].known.any()


def test_what_has_come_back_by_the_end_of_a_step_has_gone_there_and_back():
    ways = np.zeros((3, 2, *SIZE), np.float32)
    halves = ways.copy()
    halves[1, :, 5, 7] = 3.0, 4.0
    assert Motion(ways, halves).longest_px == 10.0 and Motion(halves, ways).longest_px == 5.0


@pytest.mark.parametrize("smaller", [0.05, 0.2])
def test_lines_are_as_fine_as_the_smaller_threshold_asks(smaller):
    walls = [Wall() for _ in range(3)]
    for wall, (on, off) in zip(walls, ((smaller, smaller), (smaller, 1.0), (1.0, smaller)), strict=True):
        found_by(wall, threshold_on=on, threshold_off=off)
    assert walls[0].asked == walls[1].asked == walls[2].asked is not None
    coarse = Wall()
    found_by(coarse, threshold_on=1.0, threshold_off=1.0)
    assert coarse.asked != walls[0].asked


def test_peaks_are_asked_for_once_and_not_where_a_picture_knows_them():
    told = np.array([3, 3, 5, 5]), np.array([64, 64, 128, 200])
    refiner: Any = SimpleNamespace(_on=0.2, _off=0.2)
    flat: Any = SimpleNamespace(peaks=lambda references, on, off: told)
    pixels, ticks = Refiner._peaks(refiner, flat, np.zeros(9, np.float32), np.array([0, 128, 256]))
    assert (pixels.tolist(), ticks.tolist()) == ([3, 5], [64, 200])
