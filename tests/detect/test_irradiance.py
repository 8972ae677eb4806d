"""Method irradiance: the kernels against the float64 reference, and laws that hold whatever the scene."""

import dataclasses

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from clsim.detect.config import DetectorConfig
from clsim.detect.reference import ReferenceDetector
from clsim.detect.reference.irradiance import smoothed_level
from clsim.detector import Detector
from clsim.errors import InputError
from clsim.frames import Frame
from clsim.opencl.device import choose_device
from tests.detect.irradiance_scenes import SURFACE, config_of, seen, spoiled, surface, textured_room

FEW = settings(max_examples=15, deadline=None)
SEEDS = st.integers(0, 10**6)


@pytest.mark.parametrize(("precision", "exact"), [("float32", 1e-5), ("float64", 1e-12)])
@pytest.mark.parametrize(
    ("lanes", "options"),
    [
        (None, {}),
        (1, {"window": 3}),
        pytest.param(8, {"window": 21}, marks=pytest.mark.slow),
        (4, {"scale": 0.3, "floor": 0.02, "luminance": "rec601"}),
        pytest.param(16, {"response": "lin-log", "window": 5}, marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_kernels_equal_the_reference(lanes, options, precision, exact):
    device = choose_device() if lanes is None else dataclasses.replace(choose_device(), lanes=lanes)
    frame = textured_room(1)
    bad = spoiled(frame, 2)
    expected, error, valid = smoothed_level(frame, config_of(**options))
    np.testing.assert_array_equal(valid, ~bad)
    level, stderr = seen(frame, device, precision=precision, **options)
    np.testing.assert_allclose(level[valid], expected[valid], rtol=0, atol=exact)
    np.testing.assert_allclose(stderr[valid], error[valid], rtol=100 * exact, atol=10 * exact)
    assert np.isnan(level[bad]).all() and (error > 0.1).any()


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1), (2, 40)], ids=str)
def test_frames_smaller_than_the_window(size):
    frame = textured_room(3, *size)
    np.testing.assert_allclose(seen(frame)[0], smoothed_level(frame, config_of())[0], rtol=0, atol=1e-12)


SHAPES = [("interpolated", (14, 22)), ("frame", (14, 22)), ("interpolated", (70, 5))]


@pytest.mark.parametrize(("rule", "shape"), SHAPES)
def test_events_equal_the_references(rule, shape):
    config = config_of(event_rule=rule, threshold_on=0.15, threshold_off=0.12)
    frames = [textured_room(seed, *shape) for seed in range(3)]
    size = (frames[0].width, frames[0].height, frames[0].names)
    kernels, reference = Detector(config, *size), ReferenceDetector(config, *size)
    total = 0
    for k, frame in enumerate(frames):
        frame.time_us = 1000 * k
        if k:
            spoiled(frame, k)
        got, expected = kernels.step(frame), reference.step(frame)
        for name in ("x", "y", "on"):
            np.testing.assert_array_equal(got[name], expected[name])
        assert np.abs(got["t"] - expected["t"]).max(initial=0) <= 1
        total += len(expected)
    assert total > 300
    for field in dataclasses.fields(reference.stats):
        assert getattr(kernels.stats, field.name) == getattr(reference.stats, field.name), field.name


def textured(seed, shape=(11, 19)):
    return np.random.default_rng(seed).uniform(0.02, 1.0, shape)


@FEW
@given(seed=SEEDS, irradiance=st.floats(0.01, 100), broken=st.booleans())
def test_constant_irradiance_is_returned_exactly_whatever_the_texture(seed, irradiance, broken):
    """And bad pixels, or pixels without samples, do not spread."""
    rng = np.random.default_rng(seed)
    albedo = textured(seed)
    normal = rng.standard_normal((3, *albedo.shape))
    samples = np.where(rng.random(albedo.shape) < 0.2, 0.0, 1.0) if broken else np.ones(albedo.shape)
    frame = surface(irradiance, albedo, normal, depth=rng.uniform(1, 1.1, albedo.shape), Samples=samples)
    expected = np.log(frame.plane("R").astype(np.float64))
    ready = samples > 0
    if broken:
        frame.planes[:3, ~ready] = 77.0
        ready &= ~spoiled(frame, seed)
    level, error = seen(frame)
    # The frame's float32 rounds the radiance of each pixel.
    np.testing.assert_allclose(level[ready], expected[ready], rtol=0, atol=2e-7)
    assert error[ready].max() < 1e-7


@FEW
@given(seed=SEEDS, power=st.integers(-20, 20))
@example(seed=829096, power=1)
def test_a_scaled_picture_is_shifted_by_the_factors_logarithm(seed, power):
    """But for pixels that have less than no light, of which this seed has one: they stay at the floor."""
    frame, scaled = textured_room(seed), textured_room(seed)
    for name in ("R", "G", "B", "Emission"):
        scaled.plane(name)[...] *= np.float32(2.0**power)
    floor = 1e-30
    plain, error = seen(frame, floor=floor)
    other, other_error = seen(scaled, floor=floor)
    lit = plain > np.log(floor)
    assert lit.mean() > 0.99
    np.testing.assert_allclose(other[lit], plain[lit] + power * np.log(2.0), rtol=0, atol=1e-11)
    np.testing.assert_array_equal(other[~lit], np.log(floor))
    np.testing.assert_allclose(other_error[lit], error[lit], rtol=1e-9, atol=1e-9)


@FEW
@given(seed=SEEDS)
def test_bad_pixels_weigh_nothing(seed):
    """Whatever is in them: with a value that is no number, or with none of that surface's in its place."""
    frame = textured_room(seed)
    bad = np.random.default_rng(seed).random((frame.height, frame.width)) < 0.1
    frame.plane("R")[bad] = np.nan
    first = seen(frame)
    for name in frame.names:
        frame.plane(name)[bad] = np.inf
    second = seen(frame)
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one[~bad], other[~bad])
    assert np.isfinite(first[0][~bad]).all()


@FEW
@given(seed=SEEDS)
def test_the_sky_is_left_alone_and_leaves_others_alone(seed):
    frame, other = textured_room(seed), textured_room(seed)
    sky = frame.plane("Coverage") == 0
    for name in ("R", "G", "B", "Depth", "Nx", "Emission"):
        other.plane(name)[sky] = np.random.default_rng(seed).uniform(0, 9, sky.sum())
    before, after = seen(frame)[0], seen(other)[0]
    np.testing.assert_array_equal(before[~sky], after[~sky])
    rgb = np.stack([other.plane(name) for name in ("R", "G", "B")]).astype(np.float64)
    own = np.tensordot([0.2126, 0.7152, 0.0722], rgb, axes=1)
    np.testing.assert_allclose(after[sky], np.log(np.maximum(own[sky], 1e-4)), rtol=0, atol=1e-12)


@FEW
@given(seed=SEEDS, corner=st.integers(2, 16))
def test_surfaces_at_right_angles_do_not_mix(seed, corner):
    albedo = textured(seed)
    right = np.broadcast_to(np.arange(albedo.shape[1]) >= corner, albedo.shape)
    frame = surface(np.where(right, 5e5, 0.1), albedo, (right * 1.0, 0.0, ~right * 1.0))
    np.testing.assert_allclose(seen(frame)[0], np.log(frame.plane("R").astype(np.float64)), rtol=0, atol=2e-7)


@FEW
@given(seed=SEEDS, factor=st.floats(2.0, 5.0))
def test_a_far_surface_behind_a_near_one_does_not_mix_beyond_its_edge(seed, factor):
    """Depth's slope opens the weights for the two columns at the edge, and for no others."""
    albedo = textured(seed)
    right = np.broadcast_to(np.arange(albedo.shape[1]) >= 9, albedo.shape)
    frame = surface(np.where(right, 50.0, 0.1), albedo, depth=np.where(right, factor, 1.0))
    level, exact = seen(frame)[0], np.log(frame.plane("R").astype(np.float64))
    np.testing.assert_allclose(np.delete(level, (8, 9), axis=1), np.delete(exact, (8, 9), axis=1), atol=2e-7)


def test_a_slanted_surface_is_one_surface():
    """A floor seen at a low angle: depth changes by more than its tolerance from row to row."""
    rows = np.arange(12.0)[:, None]
    noise = np.random.default_rng(4).lognormal(0.0, 0.3, (12, 20))
    frame = surface(noise, 0.5, depth=2 * 1.2 ** np.broadcast_to(rows, noise.shape))
    inner = (slice(3, -3), slice(3, -3))
    level = seen(frame)[0] - np.log(0.5)
    assert level[inner].std() < 0.4 * np.log(noise)[inner].std()


def test_the_mean_is_taken_of_light_not_of_logarithms():
    """Half of the pixels see .2, half 1.8: the mean of logs would be ln √(.2·1.8) = −.51."""
    light = np.where(np.random.default_rng(3).random((24, 20)) < 0.5, 0.2, 1.8)
    level = seen(surface(light, 0.5), window=13)[0] - np.log(0.5)
    assert abs(level[6:-6, 6:-6].mean()) < 0.1


def test_a_lamp_shines_by_itself():
    """It keeps its brightness, and brightens no neighbour whose surface is like its own."""
    emission = np.zeros((9, 9))
    emission[4, 4] = 100.0
    level = seen(surface(2.0, 0.5, Emission=emission))[0]
    expected = np.full((9, 9), np.log(1.0))
    expected[4, 4] = np.log(101.0)
    np.testing.assert_allclose(level, expected, rtol=0, atol=1e-6)


def test_a_pixel_without_samples_takes_its_neighbours_light_on_its_own_albedo():
    samples, albedo = np.ones((7, 7)), textured(5, (7, 7))
    samples[3, 3] = 0
    frame = surface(3.0, albedo, Samples=samples)
    expected = np.log(frame.plane("R").astype(np.float64))
    frame.planes[:3, 3, 3] = 0.0
    np.testing.assert_allclose(seen(frame)[0], expected, rtol=0, atol=2e-7)


def test_without_any_light_known_a_pixel_is_dark():
    """None of the window has samples: there is nothing to go by."""
    frame = surface(3.0, 0.5, Samples=np.zeros((5, 5)))
    level, error = seen(frame)
    np.testing.assert_allclose(level, np.log(1e-4), rtol=0, atol=1e-12)
    assert (error == 0).all()


def test_numbers_of_samples_do_not_weigh():
    frame = textured_room(6)
    plain = seen(frame)[0]
    frame.plane("Samples")[...] *= 50
    np.testing.assert_array_equal(seen(frame)[0], plain)


def test_dark_surfaces_keep_their_own_luminance():
    """Divided by 5e-4, what they show by other ways than diffuse reflection would outshine all else."""
    albedo = np.full((7, 7), 0.5)
    albedo[3, 3] = 5e-4
    frame = surface(2.0, albedo)
    frame.planes[:3, 3, 3] = 0.7
    level = seen(frame)[0]
    assert level[3, 3] == pytest.approx(np.log(0.7), abs=1e-6)
    np.testing.assert_allclose(np.delete(level, 24), 0.0, atol=1e-6)


def test_planes_that_may_lack_have_defaults():
    """Emission 0, coverage 1 and some samples are what a frame without them means."""
    room = textured_room(7)
    lacking = Frame(np.ascontiguousarray(room.planes[: len(SURFACE)]), SURFACE)
    shape = (1, room.height, room.width)
    extra = np.concatenate([np.ones(shape), np.zeros(shape), np.full(shape, 3)]).astype(np.float32)
    full = Frame(np.concatenate([lacking.planes, extra]), (*SURFACE, "Coverage", "Emission", "Samples"))
    for one, other in zip(seen(lacking), seen(full), strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_standard_error_is_the_spread_over_seeds():
    """On a plain wall with independent noise, the levels of many frames scatter as each frame says."""
    rng = np.random.default_rng(8)
    inner = (slice(3, -3), slice(3, -3))
    found = [seen(surface(rng.gamma(4.0, 0.25, (16, 16)), 0.5, depth=2.0)) for _ in range(60)]
    spread = np.std([level[inner] for level, _ in found], axis=0).mean()
    assert np.mean([error[inner] for _, error in found]) == pytest.approx(spread, rel=0.1)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_extreme_values_stay_numbers(precision):
    frame = textured_room(9)
    rng = np.random.default_rng(9)
    wild = rng.random((frame.height, frame.width)) < 0.1
    for name, value in (("R", 3e38), ("G", -3e38), ("Depth", 3e38), ("Nx", -3e38), ("Emission", 3e38), ("Depth", -1.0)):
        frame.plane(name)[wild & (rng.random(wild.shape) < 0.3)] = value
    level, error = seen(frame, precision=precision)
    assert np.isfinite(level).all() and np.isfinite(error).all()


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_more_light_than_squares_can_hold_counts_as_the_most(precision):
    frame = surface(np.ones((9, 9)), 0.5)
    frame.planes[:3, 4, 4] = 3e38
    level, error = seen(frame, precision=precision)
    expected, expected_error, _ = smoothed_level(frame, config_of())
    np.testing.assert_allclose(level, expected, rtol=0, atol=1e-5)
    np.testing.assert_allclose(error, expected_error, rtol=1e-3, atol=1e-5)
    assert level.max() < np.log(1e12) and (error[4, 1:8] > 0.1).all()


def test_the_window_is_the_methods_own_unless_chosen():
    assert [DetectorConfig(method=m).side for m in ("irradiance", "esim-ad", "wlr-esim")] == [7, 13, 13]
    assert DetectorConfig(method="irradiance", window=9).side == 9
    frame = textured_room(10)
    np.testing.assert_array_equal(seen(frame)[0], seen(frame, window=7)[0])
    with pytest.raises(InputError, match="`window` must be an odd number from 3 to 21, got 0"):
        DetectorConfig(window=0)


@pytest.mark.parametrize("name", ["Albedo.G", "Nz", "Depth"])
def test_missing_planes_are_named(name):
    names = tuple(n for n in SURFACE if n != name)
    with pytest.raises(InputError, match=f"method irradiance needs the plane '{name}'"):
        Detector(config_of(), 4, 4, names)
