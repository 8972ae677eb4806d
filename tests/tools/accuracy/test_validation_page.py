"""What the page of validation says of two pictures, in closed form."""

import numpy as np
import pytest

from tools.accuracy.validation_page import measure


def test_a_factor_is_a_ratio_and_a_difference_without_a_floor():
    theirs = np.full((2, 8, 12, 3), 2.0)
    found = measure(theirs * [1.1, 1.0, 0.9], theirs)
    np.testing.assert_allclose(found.ratio, [1.1, 1.0, 0.9])
    assert found.difference == pytest.approx(np.sqrt((0.01 + 0.01) / 3))
    assert found.floor == 0.0


def test_equal_renderers_differ_by_their_noise():
    """Noise of s a pixel is s/4 a block, of the mean of two seeds s/√32, of the difference of two renderers s/4."""
    rng = np.random.default_rng(5)
    own, theirs = (1.0 + 0.2 * rng.standard_normal((2, 200, 200, 3)) for _ in range(2))
    found = measure(own, theirs)
    assert found.floor == pytest.approx(0.05, rel=0.03)
    assert found.difference == pytest.approx(0.05, rel=0.03)
