"""Method irradiance: its window gives way to the pixel where it differs from it by more than noise."""

import dataclasses
import itertools

import numpy as np
import pytest
from scipy.ndimage import convolve

from clsim.detect.reference.irradiance import LEAST_OF_FOUR, detail_noise, smoothed_level
from clsim.opencl.device import choose_device
from tests.detect.irradiance_scenes import config_of, seen, shadowed_wall, spoiled, surface


def distance_weights(reach):
    """The weights of a window on one surface: a Gaussian of half its reach, and those of its inner 3×3."""
    x, y = np.meshgrid(*2 * [np.arange(-reach, reach + 1)])
    window = np.exp(-2 * (x * x + y * y) / reach**2)
    inner = window * (np.abs(x) <= 1) * (np.abs(y) <= 1)
    return window / window.sum(), inner / inner.sum()


def irradiance_seen(frame, **options):
    """What falls on a grey surface, as the detector sees it, ``[H, W]``."""
    return np.exp(seen(frame, floor=1e-30, **options)[0]) / frame.plane("Albedo.R").astype(np.float64)


@pytest.mark.parametrize(("precision", "exact"), [("float32", 2e-5), ("float64", 1e-12)])
@pytest.mark.parametrize(("lanes", "window"), [(None, 7), (1, 3), pytest.param(8, 13, marks=pytest.mark.slow), (16, 5)])
@pytest.mark.parametrize("samples", [1, 16, 256])
def test_kernels_equal_the_reference_at_shadows(samples, lanes, window, precision, exact):
    device = choose_device() if lanes is None else dataclasses.replace(choose_device(), lanes=lanes)
    frame, _ = shadowed_wall(1, samples)
    spoiled(frame, 2, share=0.02)
    expected, error, valid = smoothed_level(frame, config_of(window=window))
    level, stderr = seen(frame, device, precision=precision, window=window)
    np.testing.assert_allclose(level[valid], expected[valid], rtol=0, atol=exact)
    np.testing.assert_allclose(stderr[valid], error[valid], rtol=100 * exact, atol=10 * exact)


@pytest.mark.parametrize("window", [3, 7, pytest.param(11, marks=pytest.mark.slow)])
def test_an_upright_shadow_without_noise_stays_as_sharp_as_it_is(window):
    """Second differences see no straight edge, so that nothing there counts as noise."""
    frame, light = shadowed_wall(3, None, slant=0.0)
    away_from_ends = slice(window // 2 + 5, -window // 2 - 5)
    found = irradiance_seen(frame, window=window)
    np.testing.assert_allclose(found[away_from_ends], light[away_from_ends], rtol=1e-6)


@pytest.mark.parametrize("slant", [0.0, 0.15, 0.75, 1.0])
def test_more_samples_bring_a_shadow_nearer_to_the_truth(slant):
    """The window alone stops where its own blur is all that is left."""
    window, _ = distance_weights(3)
    edge = (slice(4, -4), slice(4, -4))
    rms = []
    for samples in (1, 4, 16, 64, 256, 1024):
        walls = [shadowed_wall(seed, samples, slant=slant) for seed in range(4)]
        rms.append(np.sqrt(np.mean([(irradiance_seen(frame) - light)[edge] ** 2 for frame, light in walls])))
    light = shadowed_wall(0, None, slant=slant)[1]
    blur = np.sqrt(np.mean((convolve(light, window) - light)[edge] ** 2))
    assert all(later < 0.85 * earlier for earlier, later in itertools.pairwise(rms))
    assert rms[-1] < 0.3 * blur


def test_on_a_plain_wall_the_window_keeps_its_samples():
    """Whatever their number: noise is not taken for detail."""
    inner = (slice(4, -4), slice(4, -4))
    window, _ = distance_weights(3)
    for samples in (1, 64):
        rng = np.random.default_rng(samples)
        walls = rng.gamma(samples, 1.0 / samples, (12, 40, 40))
        found = np.std([irradiance_seen(surface(wall, 0.5))[inner] for wall in walls])
        assert found < 1.04 * np.std([convolve(wall, window)[inner] for wall in walls])


def test_a_lone_bright_pixel_is_noise():
    """One path in many finds the lamp; it is spread over the window, like any other."""
    light = np.ones((21, 21))
    light[10, 10] = 1e4
    window, _ = distance_weights(3)
    np.testing.assert_allclose(irradiance_seen(surface(light, 0.5)), convolve(light, window, mode="nearest"), rtol=1e-5)


def test_a_pixel_that_is_unknown_takes_the_windows_mean_beside_a_shadow_too():
    frame, light = shadowed_wall(5, None, slant=0.0)
    samples = np.ones(light.shape, dtype=np.float32)
    samples[15, 20] = 0
    frame = surface(light, frame.plane("Albedo.R").astype(np.float64), Samples=samples)
    frame.planes[:3, 15, 20] = 50.0
    window, _ = distance_weights(3)
    around = light[12:19, 17:24]
    window[3, 3] = 0
    assert irradiance_seen(frame)[15, 20] == pytest.approx((window * around).sum() / window.sum(), rel=1e-6)


@pytest.mark.parametrize("reach", [1, 3, 6])
def test_the_noise_of_both_details_is_that_of_white_noise(reach):
    noise = np.random.default_rng(6).standard_normal((300, 300))
    window, inner = distance_weights(reach)
    mean, near = convolve(noise, window), convolve(noise, inner)
    assert detail_noise(reach) == pytest.approx((np.var(near - mean), np.var(noise - near)), rel=0.03, abs=1e-12)


def test_the_least_of_four_second_differences_is_scaled_to_the_noise():
    noise = np.random.default_rng(7).standard_normal((600, 600))
    steps = [(noise[1:-1, 2:], noise[1:-1, :-2]), (noise[2:, 1:-1], noise[:-2, 1:-1])]
    steps += [(noise[2:, 2:], noise[:-2, :-2]), (noise[2:, :-2], noise[:-2, 2:])]
    squares = [(one + other - 2 * noise[1:-1, 1:-1]) ** 2 for one, other in steps]
    assert pytest.approx(np.min(squares, axis=0).mean(), rel=0.02) == LEAST_OF_FOUR
