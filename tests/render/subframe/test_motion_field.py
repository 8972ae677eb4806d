"""What moves within a step, and over which blocks of the picture it goes: they know the longest way over them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from clsim.render import RenderOptions, SceneData
from clsim.render.device.devices import start_warp
from clsim.render.subframe.motion_field import FRACTIONS, build_pass_over
from clsim.render.subframe.retracer import Retracer, rests
from clsim.scene import PunctualLight, SphereLight, Static
from clsim.scene.motion import Keyframes
from clsim.scene.world import Lens
from tests.render import hand_worlds as hw
from tests.render.motion.test_blur import Glide
from tests.render.motion.test_deform import Swell

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


@pytest.mark.slow  # kernels of their own are compiled
@pytest.mark.usefixtures("ordinary")
@pytest.mark.parametrize("model", ["perspective", "fisheye", "orthographic"])
@pytest.mark.parametrize("goes", [(0.0, 0.0, 0.0), (0.2, 0.1, -0.4)])
def test_ways_are_those_of_all_rays_though_few_are_traced(monkeypatch, model, goes):
    """A thin rod, a ball that swells and a lamp move before a wall, and before a camera that stands or goes."""
    lens = Lens(model=model, view_width_m=4.0 if model == "orthographic" else 0.0)
    view = hw.camera(width=41, height=33, fov_deg=150.0 if model == "fisheye" else 80.0)
    rod, ball = hw.box((-0.004, -1.5, -0.004), (0.004, 1.5, 0.004)), hw.ball(0.4, rings=8, smooth=True)
    world = hw.world(
        hw.quad((-9, -9, -4), (18, 0, 0), (0, 18, 0)),
        rod,
        replace(ball, deformation=Swell(ball, smooth=True)),
        motions=[hw.IDENTITY, Glide((-0.7, 0.0, -1.5), (2.0, 0.3, 0.5)), Glide((0.6, 0.5, -2.0), (0.0, -0.2, 0.1))],
        view=replace(view, motion=Glide((0.0, 0.0, 0.0), goes), lens=lens),
        sphere_lights=(SphereLight(0.05, (1.0, 1.0, 1.0), Glide((0.2, -0.6, -2.5), (-1.0, 0.0, 0.0))),),
    )

    def ways():
        found = []
        for step in ((0.0, 0.05), (0.3, 0.302)):
            retracer = Retracer(SceneData(world, instants=True), RenderOptions(spp=1, max_depth=1))
            found.append(retracer.motion(*step))
            retracer.close()
        return np.array(found)

    few = ways()
    # As if what moves might be anywhere.
    monkeypatch.setattr(SceneData, "moving_boxes", lambda data: (np.full((1, 3), -99.0), np.full((1, 3), 99.0)))
    every = ways()
    np.testing.assert_allclose(few[:, :2], every[:, :2], atol=2e-3)
    # Rays through other places of pixels tell nothing new of what stands, but for a part of a pixel.
    longest = [np.hypot(*np.moveaxis(ways[:, 2], 1, 0)) for ways in (few, every)]
    np.testing.assert_allclose(*longest, atol=0.06 if any(goes) else 2e-3)
    moved = np.hypot(*every[0, 2]) > 0.1
    assert moved.mean() > 0.05 and (any(goes) or moved.mean() < 0.6)
