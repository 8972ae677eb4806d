"""Patches lie in the picture, and what is inside of them is far enough from their edges."""

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from clsim.frames.patches import Patches


@given(st.integers(1, 700), st.integers(1, 500), st.integers(1, 40), st.floats(0.01, 0.5))
@example(24, 30, 8, 0.1)  # one just fits in
def test_patches_are_of_the_picture_and_of_about_the_share_that_is_asked_for(width, height, margin, share):
    patches = Patches.over(width, height, margin, share)
    if patches is None:
        assert min(width, height) < 2 * margin + 8
        return
    pixels = patches.pixels(width).reshape(-1, patches.side, patches.side)
    y, x = np.divmod(pixels, width)
    for (left, top), columns, rows in zip(patches.corners, x, y, strict=True):
        assert 0 <= left <= width - patches.side and 0 <= top <= height - patches.side
        np.testing.assert_array_equal(columns, np.broadcast_to(left + np.arange(patches.side), columns.shape))
        np.testing.assert_array_equal(rows.T, np.broadcast_to(top + np.arange(patches.side), rows.shape))
    inside = patches.inside().reshape(pixels.shape)
    assert inside.sum() == len(pixels) * (patches.side - 2 * margin) ** 2
    assert inside[:, margin, margin].all() and not inside[:, margin - 1].any() and not inside[:, :, -margin].any()
    assert len(pixels) == 1 or 0.7 * share < pixels.size / (width * height) < 1.4 * share


def test_many_patches_are_spread_over_the_picture():
    patches = Patches.over(346, 260, 8, 0.125)
    assert patches is not None and len(patches.corners) > 8
    x, y = np.array(patches.corners).T
    for places, size in ((x, 346), (y, 260)):
        assert np.ptp(places) > 0.6 * size and np.diff(np.sort(places)).max() < 0.25 * size


def test_many_patches_reach_all_four_edges():
    """Noise at an edge is measured as it is anywhere else."""
    patches = Patches.over(72, 60, 0, 2.0)
    assert patches is not None and len(patches.corners) > 100
    for places, size in zip(np.array(patches.corners).T, (72, 60), strict=True):
        assert (places.min(), places.max()) == (0, size - patches.side)
