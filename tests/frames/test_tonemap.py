"""From light to 8 bits: sRGB's curve, and an exposure that follows."""

import numpy as np
import pytest

from clsim.frames.tonemap import ToneMap


def even(level: float) -> np.ndarray:
    return np.full((4, 6, 3), level, np.float32)


@pytest.mark.parametrize("follow", [0.0, None, 1.0])
def test_an_exposure_goes_a_share_of_its_way_in_each_image(follow: float | None) -> None:
    """In stops: from e₀ to e₁ it is at e₁·(e₀/e₁)^((1 − share)^n) after n images; the first sets it at once."""
    shown = ToneMap() if follow is None else ToneMap(follow)
    follow = 0.2 if follow is None else follow  # as viewers have it
    shown(even(0.0))
    assert shown.exposure is None, "nothing is known of a black picture"
    shown(even(2.0))
    start, end = 0.8 / 2.0, 0.8 / 0.05
    for n in range(6):
        assert shown.exposure == pytest.approx(end * (start / end) ** ((1 - follow) ** n))
        shown(even(0.05))


def test_the_95th_percentile_of_the_brightest_channel_is_shown_as_a_linear_eight_tenths() -> None:
    """IEC 61966-2-1: 0.8 of linear light is 231 of 255."""
    picture = np.zeros((10, 10, 3), np.float32)
    picture[..., 1] = np.linspace(1, 100, 100).reshape(10, 10)
    level = np.percentile(np.arange(1.0, 101.0), 95)
    image = ToneMap()(picture)
    linear = np.clip(picture / level * 0.8, 0, 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    assert np.abs(image - 255 * encoded).max() <= 1.5
    assert image[..., 1].max() < 255 and (image[..., 0] == 0).all()


def test_what_is_no_light_is_black_and_endless_light_is_white() -> None:
    picture = np.ones((4, 4, 3), np.float32)
    picture[0, :, 0] = (np.nan, -np.inf, -2.0, np.inf)
    assert ToneMap()(picture)[0, :, 0].tolist() == [0, 0, 0, 255]
