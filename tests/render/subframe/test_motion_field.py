"""Blocks of the picture over which something goes: they know the longest way that leads over them."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from clsim.render.device.devices import start_warp
from clsim.render.subframe.motion_field import FRACTIONS, build_pass_over

COLUMNS, ROWS = 12, 9


@pytest.mark.parametrize("spacing_px", [1, 2])
def test_blocks_know_the_longest_way_that_leads_over_them(spacing_px):
    """From block to block, from its start to where it ends or leaves the picture; no other block knows it."""
    start_warp()
    random = np.random.default_rng(7)
    ways = random.normal(0, 1.2 * spacing_px, (3, ROWS * COLUMNS, 2)).astype(np.float32)
    ways[:, random.permutation(ROWS * COLUMNS)[:90]] = 0.0
    ways[:, 5::40] *= 5.0
    longest = wp.zeros(ROWS * COLUMNS, dtype=wp.int64, device="cpu")
    given = [wp.array(ways, dtype=wp.vec2, device="cpu"), COLUMNS, ROWS, float(spacing_px)]
    wp.launch(build_pass_over(), ways.shape[:2], inputs=given, outputs=[longest], device="cpu")
    keys = longest.numpy()
    lengths = np.hypot(*ways.reshape(-1, 2).T)
    least, most = np.zeros(ROWS * COLUMNS), np.zeros(ROWS * COLUMNS)
    for number, way in enumerate(ways.reshape(-1, 2)):
        block = number % (ROWS * COLUMNS)
        for found, shares in ((least, (0.0, 1.0)), (most, np.linspace(0.0, 1.0, 200))):
            places = np.array((block % COLUMNS, block // COLUMNS)) + 0.5 + np.outer(shares, way / spacing_px)
            x, y = np.floor(places[((places >= 0) & (places < (COLUMNS, ROWS))).all(axis=1)]).astype(int).T
            np.maximum.at(found, y * COLUMNS + x, lengths[number])
    told = (keys >> 32) / FRACTIONS
    assert (told >= least - 1 / FRACTIONS).all() and (told <= most + 1e-6).all()
    assert (told > least + 0.1).any(), "between its ends"
    np.testing.assert_allclose(told, lengths[keys & 0xFFFFFFFF], atol=1 / FRACTIONS)
