"""Luminance regressed instead of its log, and fits that give way to the pixel's own value."""

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detect.reference import ReferenceDetector
from clsim.detector import Detector, recorded_detector
from clsim.errors import InputError
from tests.detect.reference_scenes import make_frame, random_frames

SIZE = (24, 20)


def level(detector, frame):
    """The level of each pixel after one frame."""
    detector.step(frame)
    return np.array(detector.level if isinstance(detector, ReferenceDetector) else detector.level())


def both(frame, **options):
    """The levels of one frame by the reference and by the kernels."""
    config = DetectorConfig(**{"method": "wlr-esim", "window": 7, **options})
    size = (frame.width, frame.height, frame.names)
    return [level(each(config, *size), frame) for each in (ReferenceDetector, Detector)]


def coins(variance, mean=1.0):
    """Luminance is mean/5 or mean·9/5 by chance, on a wall without features but the pixels'."""
    side = np.random.default_rng(3).random(SIZE) < 0.5
    return make_frame(np.log(np.where(side, 0.2, 1.8) * mean), Variance_Luminance=np.broadcast_to(variance, SIZE))


def test_the_log_is_taken_of_the_mean():
    """The mean of logs is ln √(.2·1.8) = −.51, which would be the level by regressing logs."""
    inner = (slice(3, -3), slice(3, -3))
    for found in both(coins(0.64), regress="linear"):
        assert abs(found[inner].mean()) < 0.1
    for found in both(coins(0.64), regress="log"):
        assert found[inner].mean() == pytest.approx(-0.51, abs=0.1)


@pytest.mark.parametrize("scale", [1.0, 2.5])
def test_where_samples_are_exact_the_pixel_keeps_its_own_value(scale):
    frame = coins(0.0)
    own = np.log(frame.plane("R") * scale)
    for found in both(frame, regress="linear", shrink=1.5, scale=scale):
        np.testing.assert_allclose(found, own, atol=2e-4)


@pytest.mark.parametrize("variance", [10.0, np.nan, np.inf])
def test_where_all_may_be_noise_the_fit_stays(variance):
    """The residual's variance is .64: below that of the samples, or nothing is known of theirs."""
    frame = coins(variance)
    for found, fit in zip(both(frame, regress="linear", shrink=1.5), both(frame, regress="linear"), strict=True):
        np.testing.assert_allclose(found, fit, atol=1e-5)


@pytest.mark.parametrize("scale", [1.0, 2.5])
def test_the_pixels_share_is_what_noise_leaves_of_the_residual(scale):
    """In luminance: level = fit + (1 − factor·noise/residual)·(own − fit), noise and scale² of the same frame."""
    frame = coins(0.2)
    options = {"regress": "linear", "scale": scale, "window": 13}
    fit, own = np.exp(both(frame, **options)[0]), frame.plane("R") * scale
    for found in both(frame, **options, shrink=1.5):
        share = (np.exp(found) - fit) / (own - fit)
        # R of 169 samples and 2 slopes: .64 but for chance.
        assert np.median(share) == pytest.approx(1 - 1.5 * 0.2 / 0.64, abs=0.05)
        assert share.min() > 0.3 and share.max() < 0.7


@pytest.mark.slow
def test_float32_shrinks_as_float64():
    frame = random_frames(2, count=1, height=17, width=23)[0]
    for method in ("wlr-esim", "esim-ad"):
        expected, found = both(frame, method=method, regress="linear", shrink=1.5)
        assert np.abs(expected - found).max() < 2e-3


def test_a_feature_that_wakes_keeps_the_variance_of_older_frames():
    """With T = 2 the older frame is repacked when a plane begins to vary."""
    frames = random_frames(10, count=3, height=13, width=17)
    for frame in frames[:2]:
        frame.plane("Nx")[...] = 0.5
    config = DetectorConfig(method="wlr-esim", regress="linear", shrink=1.5, history=2, window=5, precision="float64")
    size = (frames[0].width, frames[0].height, frames[0].names)
    kernels, reference = Detector(config, *size), ReferenceDetector(config, *size)
    for frame in frames:
        expected, found = level(reference, frame), level(kernels, frame)
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_luminance_too_large_for_float32_squares_counts_as_the_largest():
    frame = coins(0.0)
    frame.planes[:3, 5, 5] = 3e38
    for found in both(frame, regress="linear"):
        assert 20 < found[5, 5] <= np.log(1e12) + 1e-3
        assert found[12:, 12:].max() < 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"shrink": 1.5}, "`shrink` needs `regress` linear, got log"),
        ({"shrink": -1.0, "regress": "linear"}, "from 0 to 100, got -1"),
        ({"shrink": float("nan"), "regress": "linear"}, "`shrink` must be a finite number, got nan"),
        ({"shrink": 1.0, "regress": "linear", "bandwidth": "tsvd"}, "`shrink` needs `bandwidth` fixed, got tsvd"),
        ({"regress": "linear", "gate": "published"}, "`gate` published needs `regress` log, got linear"),
        ({"regress": "square"}, "regress"),
    ],
    ids=str,
)
def test_options_that_do_not_fit_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        DetectorConfig(**options)


def test_frames_without_the_variance_are_refused():
    config = DetectorConfig(regress="linear", shrink=1.5)
    for each in (Detector, recorded_detector):
        with pytest.raises(InputError, match=r"`shrink` needs the plane 'Variance\.Luminance'"):
            each(config, 8, 8, ("R", "G", "B", "Depth"))
    Detector(DetectorConfig(method="esim", regress="linear", shrink=1.5), 8, 8, ("R", "G", "B"))
