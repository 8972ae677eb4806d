"""Duplicate sampling by paths alone: it is what another run sees, and changes nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.frames.patches import Patches
from clsim.render import RenderOptions
from clsim.scene import load_world
from clsim.scene.light.spectral import mosaic_of, seen_by_pixels
from tests.render.cache.test_light_cache import luminance, panning
from tests.render.primary.test_steered import Run, textured_world

pytestmark = pytest.mark.usefixtures("ordinary")


@pytest.mark.parametrize("noise", ["common", "independent"])
def test_duplicate_pixels_are_those_of_the_complement_of_the_seed(noise):
    world, given = panning(textured_world()), {"first_hit_rays": 0, "spp": 8, "noise": noise}
    once, twice = (Run(world, duplicate_every=every, **given) for every in (0, 3))
    other = Run(world, seed=2**64 - 1, **given)
    for index in range(3):
        np.testing.assert_array_equal(once.fill(index).planes, twice.fill(index).planes)
        assert twice.spent == once.spent
        first, again = twice.tracer.sampled_twice(twice.frame)
        np.testing.assert_allclose(first, luminance(twice.frame).reshape(-1)[::3], rtol=1e-6)
        np.testing.assert_allclose(again, luminance(other.fill(index)).reshape(-1)[::3], rtol=1e-6)
        assert not np.allclose(first, again, rtol=0.01)


@pytest.mark.parametrize(
    "seen",
    [
        {"spectral": "silicon"},
        {"spectral": (0.0, 0.2, 3.0)},
        {"mosaic": mosaic_of("GRBG", (1.0, 0.1, 0.0), (0.2, 1.0, 0.0), (0.0, 0.0, 1.0))},
    ],
    ids=["silicon", "blue", "filters"],
)
def test_duplicate_pixels_have_the_brightness_that_their_sensor_sees(seen):
    """Else pixels that see blue alone would be judged by noise that is mostly green."""
    world = textured_world()
    sensor = replace(world.sensor, **seen)
    run = Run(replace(world, sensor=sensor), duplicate_every=3, first_hit_rays=0, spp=8)
    planes = run.fill(0).planes[:3]
    height, width = planes.shape[1:]
    weights = np.tile(np.reshape(seen_by_pixels(sensor), (2, 2, 3)), (height, width, 1))[:height, :width]
    expected = np.einsum("yxc,cyx->yx", weights, planes).reshape(-1)[::3]
    first, again = run.tracer.sampled_twice(run.frame)
    np.testing.assert_allclose(first, expected, rtol=1e-5)
    assert again.mean() == pytest.approx(first.mean(), rel=0.1)


def test_patches_are_those_of_the_complement_of_the_seed():
    world, given = panning(textured_world()), {"first_hit_rays": 0, "spp": 4}
    patches = Patches(4, ((3, 2), (0, 5), (4, 3)), 1)
    once, twice = Run(world, **given), Run(world, duplicate_in=patches, **given)
    other = Run(world, seed=2**64 - 1, **given)
    for index in range(2):
        np.testing.assert_array_equal(once.fill(index).planes, twice.fill(index).planes)
        seen, differs = twice.tracer.sampled_twice(twice.frame), other.fill(index).planes
        assert seen.shape == (2, len(twice.frame.names), 12, 4)
        for k, (x, y) in enumerate(patches.corners):
            for estimate, planes in zip(seen, (twice.frame.planes, differs), strict=True):
                np.testing.assert_array_equal(estimate[:, 4 * k : 4 * k + 4], planes[:, y : y + 4, x : x + 4])


@pytest.mark.slow
def test_where_objects_move_two_estimates_differ_as_two_seeds_do():
    """To a factor of 1.5 in how much brighter pixels grow, by the noise of light and of first hits.

    The picture stays as it is.
    """
    world = load_world("cornell", resolution=(48, 36))
    given = {"first_hit_rays": 32, "spp": 16, "probe_spp": 4, "sampler": "sobol", "light_cache": True}
    primary_rays, seeds, dark = [], [], 1e-3
    for seed in range(3):
        once, twice, other = (
            Run(world, seed=seed + offset, duplicate_every=every, **given)
            for every, offset in ((0, 0), (1, 0), (1, 100))
        )
        for index in range(0, 32, 8):
            frames = [run.fill(index) for run in (once, twice, other)]
            np.testing.assert_array_equal(frames[0].planes, frames[1].planes)
            assert twice.spent == once.spent
            _, seen, differs = (luminance(frame).reshape(-1) for frame in frames)
            one, again = twice.tracer.sampled_twice(twice.frame)
            primary_rays.append(np.log((one + dark) / (again + dark)))
            seeds.append(np.log((seen + dark) / (differs + dark)))
    grown = (np.diff(np.reshape(each, (3, 4, -1)), axis=1) for each in (primary_rays, seeds))
    told, seen = (np.quantile(np.abs(each), (0.68, 0.95)) for each in grown)
    assert np.all(np.abs(np.log(told / seen)) < np.log(1.5)), (told, seen)


def test_first_hit_rays_without_cached_light_have_no_duplicates():
    with pytest.raises(InputError, match="`duplicate_every` 3 needs `light_cache` or no `first_hit_rays`"):
        RenderOptions(duplicate_every=3, first_hit_rays=8)
    for given in ({"first_hit_rays": 8}, {"duplicate_every": 3}):
        with pytest.raises(InputError, match="`duplicate_in` needs no `duplicate_every` and no `first_hit_rays`"):
            RenderOptions(duplicate_in=Patches(9, ((0, 0),), 1), **given)
