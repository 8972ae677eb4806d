"""The regression against oracles that share no code with it."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from clsim.detect.config import DetectorConfig
from clsim.detect.float64.fit import fit_pixels, gather, solve_windows, tap_offsets
from clsim.detect.float64.observation import feature_names, log_brightness, observe, scaled_luminance
from tests.detect.reference_scenes import FEATURES, make_frame, random_frames


def naive_fit(frames, x, y, config):
    """One pixel's α and raw β, by loops and an SVD least squares over the ridge-augmented system."""
    rows, brightness = [], []
    for frame in frames:
        reach = config.side // 2
        for dy, dx in itertools.product(range(-reach, reach + 1), repeat=2):
            u, v = x + dx, y + dy
            if dy % config.stride or dx % config.stride or not (0 <= u < frame.width and 0 <= v < frame.height):
                continue
            if not np.isfinite(frame.planes[:, v, u]).all():
                continue
            values = [float(frame.plane(name)[v, u]) for name in FEATURES]
            if values[-1] == 0:
                values[0] = np.nan
            rows.append([u, v, *values])
            rgb = [float(frame.plane(name)[v, u]) for name in "RGB"]
            brightness.append(np.log(max(0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2], config.floor)))
    samples, brightness = np.array(rows), np.array(brightness)
    centre = np.array([x, y, *(float(frames[-1].plane(name)[y, x]) for name in FEATURES)])
    farthest = np.nanmax(samples[:, 2]) if np.isfinite(samples[:, 2]).any() else 0.0
    lo, hi = np.nanmin(np.nan_to_num(samples, nan=farthest), axis=0), np.nan_to_num(samples, nan=farthest).max(axis=0)
    samples = np.where(np.isnan(samples), farthest, samples)
    if centre[-1] == 0:
        centre[2] = farthest
    scale = np.array([0 if b - a <= 1e-6 * max(abs(a), abs(b)) else 1 / (b - a) for a, b in zip(lo, hi, strict=True)])
    scaled = (samples - centre) * scale
    t = scaled / config.bandwidth_h
    weights = np.exp(-t * t / 2) if config.kernel == "gaussian" else np.maximum(0.75 * (1 - t * t), 1e-8)
    weights = weights.prod(axis=1) / weights.prod(axis=1).sum()
    variance = weights @ (scaled - weights @ scaled) ** 2
    design = np.vstack([
        np.sqrt(weights)[:, None] * np.column_stack([np.ones(len(scaled)), scaled]),
        np.column_stack([np.zeros(10), np.diag(np.sqrt(config.ridge * variance + 1e-12))]),
    ])  # fmt: skip
    solution = np.linalg.lstsq(design, np.concatenate([np.sqrt(weights) * brightness, np.zeros(10)]), rcond=1e-15)[0]
    return solution[0], solution[1:] * scale


@pytest.mark.parametrize(
    "options",
    [
        {"window": 5},
        {"window": 7, "stride": 2, "history": 3},
        {"window": 9, "stride": 3},
        {"window": 5, "kernel": "epanechnikov", "bandwidth_h": 1.5},
        {"window": 3, "ridge": 1e-2},
    ],
)
def test_agrees_with_a_naive_solver(options):
    config = DetectorConfig(**options)
    frames = random_frames(3, count=config.history)
    frames[-1].planes[3, 2:4, 4] = np.nan
    frames[-1].planes[0, 0, :] = np.inf
    planes = feature_names(config, frames[0].names)
    history = [observe(frame, planes, config) for frame in frames]
    pixels = np.flatnonzero(history[-1].valid.ravel())
    fit = fit_pixels(history, pixels, config)
    for i in range(0, len(pixels), 7):
        alpha, slope = naive_fit(frames, pixels[i] % frames[0].width, pixels[i] // frames[0].width, config)
        assert fit.alpha[i] == pytest.approx(alpha, abs=1e-7)
        spread = fit.hi[i] - fit.lo[i]
        np.testing.assert_allclose(fit.slope[i] * spread, slope * spread, atol=1e-5)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    ridge=st.sampled_from([0.0, 1e-8, 1e-5, 1e-2, 1.0]),
    kernel=st.sampled_from(["gaussian", "epanechnikov"]),
)
def test_delta_r_closed_form_equals_the_brute_force_residual(seed, ridge, kernel):
    """ΔR = (βᵀδ)² exactly, because the ridge spares the intercept."""
    config = DetectorConfig(window=5, ridge=ridge, kernel=kernel)
    old, new = random_frames(seed, count=2, misses=False)
    planes = feature_names(config, old.names)
    pixels = np.arange(0, old.width * old.height, 5)
    windows = gather([observe(old, planes, config)], pixels, config.side, config.stride)
    fit = solve_windows(windows, config)
    moved_to = observe(new, planes, config).features.reshape(-1, 10)[pixels]
    scale = np.where(fit.hi - fit.lo > 1e-6 * np.maximum(np.abs(fit.lo), np.abs(fit.hi)), fit.hi - fit.lo, np.inf)
    t = (windows.x - windows.centre[:, None]) / scale[:, None] / config.bandwidth_h
    weights = np.exp(-t * t / 2) if kernel == "gaussian" else np.maximum(0.75 * (1 - t * t), 1e-8)
    weights = weights.prod(axis=2) * windows.mask
    for i in range(len(pixels)):
        w = weights[i] / weights[i].sum()
        kept = windows.y[i] - fit.alpha[i] - (windows.x[i] - windows.centre[i]) @ fit.slope[i]
        moved = windows.y[i] - fit.alpha[i] - (windows.x[i] - moved_to[i]) @ fit.slope[i]
        assert fit.residual[i] == pytest.approx(w @ kept**2, rel=1e-9, abs=1e-12)
        closed = (fit.slope[i] @ (moved_to[i] - windows.centre[i])) ** 2
        assert abs(w @ moved**2 - w @ kept**2) == pytest.approx(closed, rel=1e-8, abs=1e-10)


def test_constant_features_have_no_slope_and_no_effect():
    frames = random_frames(1, count=1, misses=False)
    with_constant = DetectorConfig(window=5, features=("Depth", "Coverage"))
    without = DetectorConfig(window=5, features=("Depth",))
    fits = []
    for config in (with_constant, without):
        history = [observe(frames[0], feature_names(config, frames[0].names), config)]
        fits.append(fit_pixels(history, np.arange(99), config))
    np.testing.assert_allclose(fits[0].alpha, fits[1].alpha, atol=1e-12)
    assert not fits[0].slope[:, 3].any()


@pytest.mark.parametrize("sky_depth", [0.0, 1e10])
def test_what_a_miss_says_about_depth_does_not_matter(sky_depth):
    frame = random_frames(5, count=1)[0]
    config = DetectorConfig(window=5)
    planes = feature_names(config, frame.names)
    expected = fit_pixels([observe(frame, planes, config)], np.arange(99), config)
    changed = frame.copy()
    misses = frame.plane("Coverage") == 0
    assert 5 < misses.sum() < 60
    changed.plane("Depth")[misses] = sky_depth
    fit = fit_pixels([observe(changed, planes, config)], np.arange(99), config)
    np.testing.assert_array_equal(fit.alpha, expected.alpha)
    np.testing.assert_array_equal(fit.hi, expected.hi)
    assert fit.hi[:, 2].max() < 10


def test_a_linear_scene_is_reproduced_exactly():
    ys, xs = np.mgrid[0:8, 0:9].astype(float)
    frame = make_frame(0.02 * xs - 0.01 * ys, Depth=1 + xs)
    config = DetectorConfig(window=5, ridge=0.0)
    history = [observe(frame, ("Depth",), config)]
    fit = fit_pixels(history, np.arange(72), config)
    np.testing.assert_allclose(fit.alpha, history[0].brightness.ravel(), atol=1e-6)
    assert fit.residual.max() < 1e-12


def test_responses():
    def respond(rgb, **options):
        config = DetectorConfig(**options)
        return log_brightness(scaled_luminance(rgb, config), config)

    rgb = np.full((3, 3), [0.0, 10 / 255, 0.5])
    assert respond(rgb, floor=1e-3)[0] == pytest.approx(np.log(1e-3))
    lin_log = respond(rgb, response="lin-log")
    np.testing.assert_allclose(lin_log, [0, 10 * np.log(20) / 20, np.log(127.5)], atol=1e-12)
    green = np.array([[0.0], [1.0], [0.0]])
    assert respond(green, luminance="rec601")[0] == pytest.approx(np.log(0.587))
    assert respond(green, scale=2)[0] == pytest.approx(np.log(2 * 0.7152))


def test_taps_always_include_the_centre():
    assert tap_offsets(13, 3).tolist() == [-6, -3, 0, 3, 6]
    assert tap_offsets(5, 3).tolist() == [0]
