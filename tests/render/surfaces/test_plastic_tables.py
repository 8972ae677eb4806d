"""What a smooth coat lets through, against the laws of Snell and Fresnel; no kernel runs here."""

import numpy as np
import pytest

from clsim.render.surfaces.plastic_tables import TABLE_SIZE, coat


@pytest.mark.parametrize("ior", [1.1, 1.33, 1.5, 2.4])
def test_a_smooth_coat_lets_through_what_fresnel_says_at_each_angle(ior: float) -> None:
    """By angles: sin²(i − t) / sin²(i + t) is reflected of one polarisation, tan² / tan² of the other."""
    passing, _ = coat(0.0, ior)
    cosines = np.linspace(0.0, 1.0, TABLE_SIZE)
    i = np.arccos(cosines[1:-1])
    t = np.arcsin(np.sin(i) / ior)
    across, along = (np.sin(i - t) / np.sin(i + t)) ** 2, (np.tan(i - t) / np.tan(i + t)) ** 2
    np.testing.assert_allclose(passing[1:-1], 1.0 - (across + along) / 2, atol=1e-6)
    assert passing[0] == pytest.approx(0.0, abs=1e-4)
    assert passing[-1] == pytest.approx(1.0 - ((ior - 1) / (ior + 1)) ** 2)


@pytest.mark.parametrize("ior", [1.1, 1.33, 1.5, 2.4])
def test_as_much_diffuse_light_leaves_a_coat_as_enters_it(ior: float) -> None:
    """Radiance is ior² as large inside: (1 − inner) · ior² = 1 − outer, or a dark room would not stay even."""
    passing, inner = coat(0.0, ior)
    cosines = np.linspace(0.0, 1.0, TABLE_SIZE)
    each = 2.0 * cosines * passing
    entering = float((each[1:] + each[:-1]).mean() / 2)
    assert (1.0 - inner) * ior**2 == pytest.approx(entering, rel=0.005)
