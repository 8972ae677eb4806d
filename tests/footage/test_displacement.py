"""How far pictures move, against pictures that were shifted by a known amount."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import fourier_shift, gaussian_filter

from clsim.footage.displacement import Displacement


def shifted(shift_px, noise=0.005, seed=0):
    rng = np.random.default_rng(seed)
    base = gaussian_filter(rng.standard_normal((128, 160)), 1.5, mode="wrap")
    spectrum = np.fft.fft2(base / base.std())
    down, right = 0.6 * shift_px, 0.8 * shift_px
    for k in range(2):
        moved = np.fft.ifft2(fourier_shift(spectrum, (k * down, k * right))).real
        yield (np.exp(0.3 * moved) + noise * rng.standard_normal(moved.shape)).astype(np.float32)


@pytest.mark.parametrize("shift_px", [0.0, 0.25, 0.5, 0.9, 1.2, 2.25, 6.0])
def test_shifts_are_found(shift_px):
    measure = Displacement(160, 128)
    before, after = (measure.add(picture) for picture in shifted(shift_px))
    assert before is None
    assert 0.93 * shift_px <= after <= 1.13 * shift_px + 0.02
    assert (measure.pairs, measure.fast_pairs) == (1, int(shift_px > 1.0))


def test_flicker_is_no_motion():
    measure = Displacement(160, 128)
    picture = next(iter(shifted(0.0)))
    assert measure.add(picture) is None
    assert measure.add(picture * 1.7) < 0.01


def test_noise_is_lost_and_not_motion():
    measure = Displacement(64, 64)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        measure.add(np.exp(0.1 * rng.standard_normal((64, 64))).astype(np.float32))
    assert (measure.pairs, measure.lost_pairs) == (0, 2)


def test_nothing_to_see_is_nothing_measured():
    measure = Displacement(5, 3)
    for _ in range(2):
        assert measure.add(np.ones((3, 5), np.float32)) is None
    assert (measure.pairs, measure.lost_pairs) == (0, 0)


def test_a_small_part_of_the_picture_that_goes_fast_counts():
    """What two blocks of five do is told, and not what most of them do."""
    measure = Displacement(160, 128)
    before, after = shifted(3.0)
    still = before.copy()
    still[:, 32:96] = after[:, 32:96]
    measure.add(before)
    assert 2.7 < measure.add(still) < 3.4 and measure.fast_pairs == 1


def test_a_picture_no_larger_than_a_block_is_measured():
    measure = Displacement(24, 16)
    before, after = (measure.add(picture[40:56, 60:84]) for picture in shifted(0.4))
    assert before is None and 0.3 < after < 0.5 and measure.lost_pairs == 0


def test_a_picture_lower_than_a_block_is_measured_along_its_width():
    measure = Displacement(160, 16)
    before = next(iter(shifted(0.0)))[40:56]
    measure.add(before)
    assert 2.9 < measure.add(np.roll(before, -3, axis=1)) < 3.1 and measure.lost_pairs == 0


def test_the_fastest_pair_is_told_whatever_follows():
    measure = Displacement(160, 128)
    before, after = shifted(3.0)
    for picture in (before, after, after):
        measure.add(picture)
    assert measure.pairs == 2 and 2.7 < measure.as_dict()["largest_px"] < 3.4
