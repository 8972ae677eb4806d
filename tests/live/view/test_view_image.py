import math

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.frames.tonemap import ToneMap
from clsim.live.view import colormaps
from clsim.live.view.accumulate import EventWindow, colour_indices, signed_image
from tests.live.view.view_events import random_events

WIDTH, HEIGHT = 7, 5


def test_sums_are_those_of_a_plain_loop() -> None:
    events = random_events(500, WIDTH, HEIGHT)
    for decay_us in (None, 200_000.0):
        expected = [[0.0] * WIDTH for _ in range(HEIGHT)]
        for t, x, y, on in events.tolist():
            weight = 1.0 if decay_us is None else math.exp(-(1_000_000 - t) / decay_us)
            expected[y][x] += weight if on else -weight
        image = signed_image(events, WIDTH, HEIGHT, end_us=1_000_000, decay_us=decay_us)
        np.testing.assert_allclose(image, expected, rtol=1e-12, atol=1e-12)


def test_a_window_selects_what_a_mask_selects_whatever_the_batches() -> None:
    events = random_events(3000, WIDTH, HEIGHT, seed=1)
    window = EventWindow()
    position = 0
    for begin_us, end_us in ((0, 10), (100_000, 133_000), (120_000, 153_000), (500_000, 900_000), (900_000, 900_000)):
        while position < len(events) and events["t"][max(position - 1, 0)] < end_us:
            window.push(events[position : position + 170])
            position += 170
        inside = (events["t"] >= begin_us) & (events["t"] < end_us)
        assert np.array_equal(window.select(begin_us, end_us), events[inside])


def test_a_window_forgets_what_has_passed() -> None:
    window = EventWindow()
    for k in range(100):
        window.push(random_events(10, WIDTH, HEIGHT, begin_us=k * 1000, end_us=(k + 1) * 1000))
        window.select(k * 1000 - 2000, k * 1000)
    assert len(window._batches) <= 4


def test_indices_are_symmetric_and_nothing_is_in_the_middle() -> None:
    indices = colour_indices(np.array([0.0, 2.0, -2.0, 9.0, -9.0, 1.0, -1.0]), 2.0).tolist()
    assert indices == [128, 255, 1, 255, 1, 192, 64]


@pytest.mark.parametrize("theme", ["dark", "light"])
@pytest.mark.parametrize("name", colormaps.NAMES)
@pytest.mark.parametrize("vision", ["normal", "deuteranopia", "protanopia"])
def test_on_off_and_nothing_are_told_apart_by_every_eye(name: str, theme: colormaps.Theme, vision: str) -> None:
    table = colormaps.lut(name, theme)
    seen = lab(simulate(table / 255.0, vision))
    for strength in (43, 85, 127):  # a third, two thirds and all of the range
        off, nothing, on = seen[128 - strength], seen[128], seen[128 + strength]
        for a, b in ((off, on), (off, nothing), (on, nothing)):
            assert np.linalg.norm(a - b) > 15  # CIE76; about 2.3 is just noticeable
    for side in (seen[128:], seen[128:0:-1]):  # more events are never less bright (or, on a light ground, less dark)
        steps = np.diff(side[:, 0]) * np.sign(side[-1, 0] - side[0, 0])
        assert steps.min() > -0.3


def simulate(rgb: np.ndarray, vision: str) -> np.ndarray:
    """What a dichromat sees: Machado, Oliveira and Fernandes, TVCG 2009, severity 1."""
    matrices = {
        "normal": np.eye(3),
        "deuteranopia": [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ],
        "protanopia": [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ],
    }
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return np.clip(linear @ np.array(matrices[vision]).T, 0, 1)


def lab(linear: np.ndarray) -> np.ndarray:
    """CIE L*a*b* (D65) of linear Rec. 709."""
    to_xyz = np.array(
        [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
    )
    xyz = linear @ to_xyz.T / to_xyz.sum(axis=1)
    f = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], axis=1)


def test_an_unknown_colour_map_is_named() -> None:
    with pytest.raises(InputError, match=r"blue-orange.*'rainbow'"):
        colormaps.lut("rainbow")


def test_tone_mapping_is_bright_monotone_and_survives_bad_pixels() -> None:
    linear = np.linspace(0, 50, 300, dtype=np.float32).reshape(10, 30, 1)
    image = ToneMap()(linear)
    assert image.dtype == np.uint8 and image[0, 0, 0] == 0 and image[-1, -1, 0] >= 230
    assert (np.diff(image.ravel().astype(int)) >= 0).all()
    linear[0, 1], linear[0, 2] = np.nan, np.inf
    spoilt = ToneMap()(linear)
    assert spoilt[0, 1, 0] == 0 and spoilt[0, 2, 0] == 255
    assert np.abs(spoilt[1:].astype(int) - image[1:]).max() <= 1
