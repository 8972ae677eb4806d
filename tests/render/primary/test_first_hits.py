"""Primary rays: areas at straight edges and means of flat textures, against closed forms and plain rays."""

from __future__ import annotations

import numpy as np
import pytest

from clsim.bench.edge import edge_scene
from clsim.bench.tradeoff.measure import render_each
from clsim.bench.tradeoff.reference_cache import log_brightness
from clsim.render import RenderOptions
from tests.render import hand_worlds as hw
from tests.render.primary.test_steered import Run, textured_world

pytestmark = pytest.mark.usefixtures("ordinary")

SIZE = (32, 24)
COUNTED = 7
"""Primary rays too few for corners to be sampled: shares are those of the rays."""


@pytest.mark.parametrize("kind", [pytest.param("geometric", marks=pytest.mark.slow), "albedo"])
def test_the_share_of_a_straight_edge_is_its_area(kind):
    """24 rays place it to a hundredth of a pixel, where counting rays is wrong by a tenth."""
    scene = edge_scene(kind, 100.0, *SIZE, 60.0)

    def errors(rays):
        found = []

        def take(frame):
            true = scene.edge.luminance(*SIZE, frame.time_us / 1e6)
            crossed = (true > true.min() + 1e-3) & (true < true.max() - 1e-3)
            error = np.exp(log_brightness(frame, scene.world.sensor)) - true
            found.extend(np.abs(error[crossed]) / np.ptp(true))

        options = RenderOptions(spp=1, first_hit_rays=rays, fps=60.0, frames=4, sampler="sobol")
        render_each(scene.world, options, take)
        assert len(found) > 100
        return np.array(found)

    placed, counted = errors(24), errors(COUNTED)
    assert np.median(placed) < 0.01 and placed.max() < 0.04
    assert np.median(counted) > 3 * np.median(placed)


def test_a_checkered_floor_has_its_mean_colour():
    """Down to where squares are smaller than pixels, and in perspective."""
    reference = hw.render(textured_world(), spp=4096)
    floor = (reference.plane("Coverage") == 1) & (reference.plane("Ny") > 0.999)
    few, counted = (
        np.abs(
            Run(textured_world(), spp=1, first_hit_rays=rays).fill(0).plane("Albedo.G") - reference.plane("Albedo.G")
        )
        for rays in (24, COUNTED)
    )
    assert floor.sum() > 30
    assert np.median(few[floor]) < 0.2 * np.median(counted[floor])
