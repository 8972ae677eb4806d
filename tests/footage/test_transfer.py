"""Transfer functions, against points of the standards and their forward equations."""

from __future__ import annotations

import numpy as np
import pytest

from clsim.footage.transfer import decode, quantisation_floor
from tests.footage.clips import encode


@pytest.mark.parametrize(
    ("transfer", "stored", "light"),
    [
        ("srgb", 0.5, 0.214041),  # IEC 61966-2-1
        ("bt709", 0.5, 0.259589),  # ITU-R BT.709
        ("pq", 0.508078, 100 / 203),  # ITU-R BT.2100, table: 100 cd/m² at 50.8 %
        ("pq", 1.0, 10000 / 203),
        ("hlg", 0.5, 1 / 12),  # ITU-R BT.2100
        ("hlg", 0.75, 0.264963),  # ITU-R BT.2408: reference white at 75 %
        ("hlg", 1.0, 1.0),
        ("linear", 1.7, 1.7),
        ("as-is", 0.3, 0.3),
        ("srgb", -0.1, 0.0),
    ],
)
def test_known_points(transfer, stored, light):
    values = np.array([stored], np.float32)
    decode(values, transfer)
    assert values[0] == pytest.approx(light, rel=3e-5)


@pytest.mark.parametrize("transfer", ["srgb", "bt709", "pq", "hlg"])
def test_undoes_the_forward_equation(transfer):
    light = np.geomspace(1e-4, 1.0, 400)
    values = encode(light, transfer).astype(np.float32)
    decode(values, transfer)
    np.testing.assert_allclose(values, light, rtol=2e-4)


@pytest.mark.parametrize(("transfer", "steps"), [("srgb", 255), ("bt709", 219), ("pq", 1023), ("linear", 65535)])
def test_above_the_floor_no_step_is_an_event(transfer, steps):
    floor = quantisation_floor(transfer, steps, 0.2)
    light = np.arange(steps + 1, dtype=np.float32) / np.float32(steps)
    decode(light, transfer)
    rises = np.diff(np.log(np.maximum(light, floor).astype(np.float64)))
    assert rises.max() <= 0.2 + 1e-6
    below = light[light < floor][-1]
    assert np.log(floor / below) > 0.2
