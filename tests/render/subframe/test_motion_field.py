"""What moves within a step, and over which blocks of the picture it goes: they know the longest way over them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from clsim.render.device.devices import start_warp
from clsim.render.subframe.motion_field import FRACTIONS, build_pass_over
from clsim.render.subframe.retracer import rests
from clsim.scene import PunctualLight, SphereLight, Static
from clsim.scene.motion import Keyframes
from tests.render import hand_worlds as hw

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


@pytest.mark.parametrize("who", ["box", "camera", "lamp", "point"])
def test_a_step_in_which_anything_goes_and_comes_back_is_no_rest(who):
    """Whoever it is; it stands still, goes to and fro, and stands still again."""
    there, turn = (0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0)
    places = (there, there, (0.5, 1.0, 0.0), there, there)
    goes, stands = Keyframes((0.0, 1.0, 1.5, 2.0, 3.0), places, (turn,) * 5), Static(np.eye(4))
    motions = {name: goes if name == who else stands for name in ("box", "camera", "lamp", "point")}
    world = hw.world(
        hw.box((-1, -1, -1), (1, 1, 1)),
        motions=[motions["box"]],
        view=replace(hw.camera(), motion=motions["camera"]),
        sphere_lights=(SphereLight(0.1, (1.0, 1.0, 1.0), motions["lamp"]),),
        punctual_lights=(PunctualLight("point", (1.0, 1.0, 1.0), motions["point"]),),
    )
    steps = [(0.0, 1.0), (1.0, 1.5), (1.5, 2.0), (1.0, 2.0), (0.75, 2.25), (2.0, 3.0), (4.0, 5.0)]
    assert [rests(world, *step) for step in steps] == [True, False, False, False, False, True, True]
