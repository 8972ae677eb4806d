"""Regressions that choose their bandwidth."""

from dataclasses import replace

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detect.float64.bandwidth import curvature, solve_optimised, solve_tsvd, subspace
from clsim.detect.float64.fit import gather, solve_windows
from clsim.detect.float64.observation import add_variances, feature_names, observe
from clsim.detect.reference import ReferenceDetector
from clsim.errors import InputError
from clsim.frames import Frame
from tests.detect.reference_scenes import FEATURES, make_frame, random_frames, run


def with_variances(frame, radiance=0.0, feature=0.0):
    """The frame with constant variance planes."""
    names = [n for n in frame.names if n in FEATURES]
    extra = [f"Variance.{n}" for n in ("R", "G", "B", *names)]
    values = [radiance] * 3 + [feature] * len(names)
    planes = np.stack([*frame.planes, *(np.full(frame.planes[0].shape, v, np.float32) for v in values)])
    return Frame(planes, (*frame.names, *extra), frame.time_us, frame.index)


def windows_of(frame, config):
    planes = feature_names(config, frame.names)
    o = observe(frame, planes, config)
    add_variances(o, frame, planes, config)
    return gather([o], np.flatnonzero(o.valid.ravel()), config.side, config.stride)


def test_without_noise_nothing_is_truncated_and_the_fit_is_the_plain_one():
    """The Gaussian does not care how feature space is rotated."""
    config = DetectorConfig(window=7, ridge=0.0)
    frame = with_variances(random_frames(1, count=1)[0])
    plain, reduced = (solve(windows_of(frame, config), config) for solve in (solve_windows, solve_tsvd))
    # In nearly collinear windows the ridge's absolute 1e-12 acts along other axes.
    np.testing.assert_allclose(reduced.alpha, plain.alpha, atol=2e-4)
    assert np.median(np.abs(reduced.alpha - plain.alpha)) < 1e-9
    spread = plain.hi - plain.lo
    assert np.median(np.abs((reduced.slope - plain.slope) * spread)) < 1e-6
    np.testing.assert_allclose(reduced.residual, plain.residual, atol=1e-4)


def test_more_noise_leaves_fewer_directions_and_at_last_the_mean():
    config = DetectorConfig(window=7)
    frame = random_frames(1, count=1, misses=False)[0]
    ranks = []
    for variance in (0.0, 1e-4, 1e-2, 1e3):
        _, basis, _ = subspace(windows_of(with_variances(frame, feature=variance), config))
        ranks.append((basis**2).sum() / len(basis))
    assert ranks[0] > 8.5 and ranks[-1] == 0, "nine features vary, coverage does not"
    assert (np.diff(ranks) < 0).all()
    windows = windows_of(with_variances(frame, feature=1e3), config)
    fit = solve_tsvd(windows, config)
    mean = np.array([y[mask].mean() for y, mask in zip(windows.y, windows.mask, strict=True)])
    np.testing.assert_allclose(fit.alpha, mean, atol=1e-12)
    assert not fit.slope.any()


def curved(amount, noise=0.0):
    """One row of pixels: pixel x is the only direction; L = ½·amount·(x/12)²."""
    xs = np.arange(41.0)[None, :] - 20
    noisy = np.random.default_rng(0).normal(0, 1, xs.shape) * noise
    return xs, make_frame(0.5 * amount * (xs / 12) ** 2 + noisy)


def test_curvature_of_a_parabola():
    config = DetectorConfig(window=13, ridge=0.0)
    _, frame = curved(6.0)
    windows = windows_of(with_variances(frame), config)
    z, basis, _ = subspace(windows)
    second = curvature(z, windows, config)[6:-6]
    kept = (basis**2).sum(axis=1)[6:-6] > 0.5
    assert kept.sum(axis=1).tolist() == [1] * 29
    np.testing.assert_allclose(second[kept], 6.0, rtol=1e-4)


def test_a_curved_scene_without_noise_gets_a_narrow_kernel():
    config = DetectorConfig(window=13)
    xs, frame = curved(20.0)
    windows = windows_of(with_variances(frame), config)
    truth = 10.0 * (xs[0] / 12) ** 2
    plain = np.abs(solve_windows(windows, config).alpha - truth)[6:-6]
    chosen = np.abs(solve_optimised(windows, config).alpha - truth)[6:-6]
    assert chosen.max() < 0.1 * plain.min()


def test_a_flat_noisy_scene_gets_a_wide_kernel():
    config = DetectorConfig(window=13)
    _, frame = curved(0.0, noise=0.2)
    narrow = solve_optimised(windows_of(with_variances(frame, radiance=1e-9), config), config)
    wide = solve_optimised(windows_of(with_variances(frame, radiance=0.04), config), config)
    assert wide.alpha.std() < 0.8 * narrow.alpha.std()
    # The width is chosen in shares of that of the options: with next to none a pixel has its own brightness.
    alone = replace(config, bandwidth_h=1e-3)
    windows = windows_of(with_variances(frame, radiance=0.04), alone)
    own = np.log(frame.plane("R")[0])
    np.testing.assert_allclose(solve_optimised(windows, alone).alpha, own, atol=1e-5)


@pytest.mark.parametrize("bandwidth", ["tsvd", "optimised"])
@pytest.mark.parametrize("gate", ["delta-r", "radiance"])
def test_detectors_run_with_chosen_bandwidths(bandwidth, gate):
    frames = [with_variances(f, radiance=1e-3, feature=1e-4) for f in random_frames(4, count=3)]
    config = DetectorConfig(window=5, gate=gate, threshold_on=0.1, threshold_off=0.1, bandwidth=bandwidth)
    detector = ReferenceDetector(config, 11, 9, frames[0].names)
    fixed = ReferenceDetector(replace(config, bandwidth="fixed"), 11, 9, frames[0].names)
    events, plain = run(detector, frames), run(fixed, frames)
    assert len(events) > 0 and np.isfinite(detector.level).all()
    assert np.abs(detector.level - fixed.level).max() > 1e-3 and len(plain) != len(events)


def test_luminance_variance_is_taken_where_it_is_given():
    config = DetectorConfig()
    frame = with_variances(make_frame(np.full((3, 3), np.log(0.5))), radiance=0.01)
    windows = windows_of(frame, config)
    np.testing.assert_allclose(windows.y_variance[windows.mask], 0.01 / 0.25, rtol=1e-5)
    # Scaled light has its square; the logarithm rises no more steeply than at the floor, which is of scaled light.
    for options, expected in (({"regress": "linear", "scale": 3.0}, 0.09), ({"scale": 0.5, "floor": 0.4}, 0.01 / 0.64)):
        windows = windows_of(frame, DetectorConfig(**options))
        np.testing.assert_allclose(windows.y_variance[windows.mask], expected, rtol=1e-5)
    named = Frame(
        np.concatenate([frame.planes, np.full((1, 3, 3), 0.004, np.float32)]), (*frame.names, "Variance.Luminance")
    )
    windows = windows_of(named, config)
    np.testing.assert_allclose(windows.y_variance[windows.mask], 0.004 / 0.25, rtol=1e-5)


def test_what_is_missing_is_named():
    frame = random_frames(1, count=1)[0]
    detector = ReferenceDetector(DetectorConfig(bandwidth="tsvd"), 11, 9, frame.names)
    with pytest.raises(InputError, match=r"'Variance\.R'"):
        detector.step(frame)
    with pytest.raises(InputError, match="`gate` published needs `bandwidth` fixed, got tsvd"):
        DetectorConfig(gate="published", bandwidth="tsvd")
