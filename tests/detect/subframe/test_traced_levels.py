"""The light of what first hits alone tell of, looked up in the frames at both ends, where surfaces bring it."""

from __future__ import annotations

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detect.subframe.traced_levels import FirstHitLevels, PathLevels
from clsim.frames import ALBEDO, COVERAGE, DEPTH, EMISSION, RADIANCE, Frame

HEIGHT, WIDTH = 24, 40
NAMES = (*DEPTH, *RADIANCE, *EMISSION, *ALBEDO, *COVERAGE)
RED, GREEN, BLUE = 0.299, 0.587, 0.114


def frame_of(**planes):
    frame = Frame(np.zeros((len(NAMES), HEIGHT, WIDTH), np.float32), NAMES)
    for name, values in planes.items():
        for channel in {"albedo": ALBEDO, "coverage": COVERAGE, "emission": EMISSION, "depth": DEPTH}[name]:
            frame.plane(channel)[...] = values
    return frame


def asked_of(levels, frames, lights, ways, pixels, shares, scale=1.0, **seen):
    """Show frames lit so at both ends, and return the level of requests that see a surface as told."""
    ends = []
    for frame, light in zip(frames, lights, strict=True):
        levels.advance(frame)
        reflected = light * frame.plane("Albedo.R") * frame.plane("Coverage")
        ends.append(np.log(scale * (frame.plane(EMISSION[0]) + reflected)).astype(np.float32))
    levels.begin(*ends, ways)
    return levels.levels(frame_of(**seen).planes.reshape(len(NAMES), -1)[:, : len(pixels)], pixels, shares)


@pytest.mark.parametrize("scale", [1.0, 0.2])
@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 0.75, 1.0])
@pytest.mark.parametrize("way", [(4, -8), (-8, 4), (0, 4), (0, 0)])
def test_light_comes_along_with_the_surface_that_it_falls_on(way, share, scale):
    """Another one in each place, it is found at both ends at once, whatever part of its way a surface has gone."""
    light = np.random.default_rng(3).uniform(0.5, 5.0, (HEIGHT, WIDTH)).astype(np.float32)
    config = DetectorConfig(luminance="rec601", scale=scale)
    levels = FirstHitLevels(config, NAMES, (HEIGHT, WIDTH))
    frames = [frame_of(albedo=0.4, coverage=1.0, emission=0.3, depth=2.0) for _ in range(2)]
    ways = np.zeros((3, 2, HEIGHT, WIDTH), np.float32)
    ways[:] = np.array(way)[:, None, None]
    y, x = (each.ravel() for each in np.mgrid[8 : HEIGHT - 8, 8 : WIDTH - 8])
    moved = np.roll(light, way[::-1], axis=(0, 1))
    found = asked_of(
        levels, frames, (light, moved), ways, y * WIDTH + x, np.full(len(x), share), scale,
        albedo=0.7, coverage=0.5, emission=0.2, depth=2.0,
    )  # fmt: skip
    before = light[(y - share * way[1]).astype(int), (x - share * way[0]).astype(int)]
    np.testing.assert_allclose(found, np.log(scale * (0.2 + 0.7 * 0.5 * before)), atol=1e-4)


@pytest.mark.parametrize("behind", [True, False])
def test_light_on_another_surface_does_not_count(behind):
    """A bright thing goes to the right before a dark wall; each is asked for where the other is at one of both ends."""
    there = np.zeros((2, HEIGHT, WIDTH), bool)
    there[0, 4:20, 4:20], there[1, 4:20, 12:28] = True, True
    frames = [frame_of(albedo=0.5, coverage=1.0, depth=np.where(each, 2.0, 6.0)) for each in there]
    lights = [np.where(each, 50.0, 1.0).astype(np.float32) for each in there]
    ways = np.zeros((3, 2, HEIGHT, WIDTH), np.float32)
    ways[:2, 0] = 8.0
    columns = np.array([2, 3, 4, 5, 6, 7, 24, 25, 26, 27, 28, 29]) if behind else np.arange(9, 21)
    pixels = 10 * WIDTH + columns
    levels = FirstHitLevels(DetectorConfig(), NAMES, (HEIGHT, WIDTH))
    found = asked_of(
        levels, frames, lights, ways, pixels, np.full(12, 0.5), albedo=0.5, coverage=1.0, depth=6.0 if behind else 2.0
    )
    np.testing.assert_allclose(found, np.log(0.5 * (1.0 if behind else 50.0)), atol=1e-3)


def test_of_whole_paths_it_is_the_scaled_luminance_above_the_floor_that_counts():
    levels = PathLevels(DetectorConfig(luminance="rec601", scale=3.0, floor=0.1), NAMES)
    planes = np.full((len(NAMES), 4), 9.0, np.float32)
    for name, values in zip(RADIANCE, np.array([[1, 0, 0, 0.01], [0, 1, 0, 0.01], [0, 0, 1, 0.01]]), strict=True):
        planes[NAMES.index(name)] = values
    found = levels.levels(planes, np.arange(4), np.zeros(4))
    np.testing.assert_allclose(found, np.log([3 * RED, 3 * GREEN, 3 * BLUE, 0.1]), atol=1e-6)
