"""Parity with v2e and OpenEB on the same clip, by their published equations, noise left out."""

from __future__ import annotations

import numpy as np
import pytest

import clsim
from tests.footage.clips import HEIGHT, WIDTH

_FRAMES, _STEP_US = 25, 10_000
_ON, _OFF = 0.2, 0.2137
"""Unlike, or a pixel that returns to a value would be at a threshold exactly, where rounding decides."""


@pytest.fixture(scope="module")
def clip():
    rng = np.random.default_rng(7)
    base = rng.uniform(0, 200, (HEIGHT, WIDTH))  # black too, where what is added to light counts
    sway = rng.uniform(0.3, 1.5, (HEIGHT, WIDTH))
    turn = rng.uniform(0, 6.28, (HEIGHT, WIDTH))
    return [np.clip(base * np.exp(sway * np.sin(0.35 * k + turn)), 0, 255).astype(np.uint8) for k in range(_FRAMES)]


def v2e_counts(frames):
    """Hu, Liu and Delbruck 2021: lin-log brightness, and floor(difference / threshold) events a frame."""

    def lin_log(luma):
        value = luma.astype(np.float64)
        return np.where(value <= 20, value * np.log(20) / 20, np.log(np.maximum(value, 1)))

    memory = lin_log(frames[0])
    counts = []
    for frame in frames[1:]:
        difference = lin_log(frame) - memory
        fired = np.floor(np.maximum(difference, 0) / _ON) - np.floor(np.maximum(-difference, 0) / _OFF)
        memory += np.where(fired > 0, _ON, _OFF) * fired
        counts.append(fired.astype(int))
    return np.array(counts)


def openeb_events(frames):
    """metavision_core_ml.video_to_event: ln(1e-7 + luma/255), crossings interpolated between frames, as in ESIM."""
    last = np.log(1e-7 + frames[0].astype(np.float64) / 255)
    reference = last.copy()
    found = []
    for k, frame in enumerate(frames[1:]):
        now = np.log(1e-7 + frame.astype(np.float64) / 255)
        for y, x in np.ndindex(now.shape):
            sign, threshold = (1, _ON) if now[y, x] >= last[y, x] else (-1, _OFF)
            if abs(now[y, x] - reference[y, x]) <= threshold:
                continue
            level = reference[y, x] + sign * threshold
            while sign * level > sign * last[y, x] and sign * level <= sign * now[y, x]:
                share = (level - last[y, x]) / (now[y, x] - last[y, x])
                found.append((int((k + share) * _STEP_US), x, y, sign > 0))
                reference[y, x] = level
                level += sign * threshold
        last = now
    return sorted(found)


def test_v2e_fires_the_same_events_in_each_frame(clip):
    expected = v2e_counts(clip)
    mine = np.zeros_like(expected)
    times = [k * _STEP_US for k in range(_FRAMES)]
    for k, events in enumerate(clsim.events_from(clip, times, like="v2e", threshold_on=_ON, threshold_off=_OFF)):
        if k:
            np.add.at(mine[k - 1], (events["y"], events["x"]), np.where(events["on"], 1, -1))
    assert np.abs(expected).sum() > 5000
    np.testing.assert_array_equal(mine, expected)


def test_openeb_fires_the_same_events_at_the_same_times(clip):
    expected = openeb_events(clip)
    times = [k * _STEP_US for k in range(_FRAMES)]
    mine = sorted(
        e
        for events in clsim.events_from(clip, times, like="openeb", threshold_on=_ON, threshold_off=_OFF)
        for e in events.tolist()
    )
    assert len(expected) > 5000
    by_pixel = {}
    for t, x, y, on in expected:
        by_pixel.setdefault((x, y), []).append((t, on))
    seen = {}
    for t, x, y, on in mine:
        seen.setdefault((x, y), []).append((t, on))
    signs, expected_signs = ({pixel: [on for _, on in each] for pixel, each in d.items()} for d in (seen, by_pixel))
    assert signs == expected_signs
    for pixel, events in by_pixel.items():
        # OpenEB cuts times to whole µs, clsim rounds them; levels are float32 here.
        assert np.abs(np.array([t for t, _ in events]) - [t for t, _ in seen[pixel]]).max() <= 3


@pytest.mark.parametrize(
    ("channel", "weight", "codes"), [(0, 0.299, (20, 60)), (1, 0.587, (10, 30)), (2, 0.114, (50, 150))]
)
def test_v2e_sees_the_luma_of_bt_601(channel, weight, codes):
    """Below 20, brightness is ln(20) / 20 times luma."""
    frames = np.zeros((2, HEIGHT, WIDTH, 3), np.uint8)
    frames[..., channel] = np.reshape(codes, (2, 1, 1))
    found = sum(map(len, clsim.events_from(frames, [0, _STEP_US], like="v2e", threshold_on=_ON)))
    assert found == WIDTH * HEIGHT * int(weight * (codes[1] - codes[0]) * np.log(20) / 20 / _ON)
