"""Standard errors of what is fitted under a lamp: they say how far fits of other recordings are apart."""

import math

import numpy as np
import pytest

from clsim.events import empty_batch
from clsim.sensor.fit.flicker import fit_flicker

PIXELS, SECONDS, LAMP_HZ, CONTRAST = 300, 1.0, 5.0, 0.6
ON, OFF, REST_S = (0.2, 0.01), (0.25, 0.03), 300e-6
"""Thresholds, each with its spread over the pixels, and the rest."""
JITTER_S = 20e-6


def lamp(seed):
    """Return what pixels fire in a sine's light, by its closed form, with stamps that jitter."""
    draw = np.random.default_rng(seed)
    on, off = (draw.normal(mean, spread, PIXELS) for mean, spread in (ON, OFF))
    turn, found = 2 * math.pi, []
    begin = draw.uniform(0, 0.2, PIXELS)  # when the level that a pixel compares with is taken
    while (alive := begin < SECONDS).any():
        phase = turn * LAMP_HZ * begin
        level = np.log1p(CONTRAST * np.sin(phase))
        heights = [np.expm1(goal) / CONTRAST for goal in (level + on, level - off)]
        up, down = (np.where(np.abs(height) <= 1, np.arcsin(np.clip(height, -1, 1)), np.nan) for height in heights)
        waits = [(first - phase) % turn for first in (up, math.pi - down)]
        rises = np.nan_to_num(waits[0], nan=np.inf) < np.nan_to_num(waits[1], nan=np.inf)
        at = begin + np.fmin(*waits) / (turn * LAMP_HZ)
        part = empty_batch(int(alive.sum()))
        part["t"] = np.rint((at + draw.normal(1, JITTER_S, PIXELS)) * 1e6)[alive]
        part["x"], part["y"], part["on"] = np.flatnonzero(alive), 0, rises[alive]
        found.append(part)
        begin = at + REST_S
    return np.sort(np.concatenate(found), order="t")


@pytest.mark.slow
def test_errors_of_thresholds_and_rest_are_the_scatter_of_other_recordings():
    fits = [fit_flicker([lamp(seed)], PIXELS, 1, CONTRAST) for seed in range(12)]
    for name, true in (("on", ON[0]), ("off", OFF[0]), ("rest_us", REST_S * 1e6)):
        values, errors = np.transpose([getattr(fit, name) for fit in fits])
        assert values.mean() == pytest.approx(true, rel=0.02), name
        assert 0.5 < np.sqrt((errors**2).mean()) / values.std(ddof=1) < 2, name
