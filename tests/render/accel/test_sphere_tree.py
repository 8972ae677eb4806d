"""Many sphere lights: rays find them by a tree, and see what they see without one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.frames import Frame, page_aligned
from clsim.render import PathTracer, RenderOptions
from clsim.render.features import scene_features
from clsim.scene import SphereLight, Static
from clsim.scene.motion import Keyframes
from tests.render import hand_worlds as hw

COUNT = 40
STAYS = (0.0, 0.0, 0.0, 1.0)


def swarm(moving):
    """Spheres of all sizes over a floor; some go past each other."""
    rng = np.random.default_rng(3)
    lamps = []
    for k in range(COUNT):
        place, radius_m = rng.uniform((-1.5, 0.1, -1.5), (1.5, 1.5, 1.5)), rng.uniform(0.01, 0.2)
        motion = Static(hw.translation(*place))
        if moving and k % 2:
            way = rng.uniform(-2.0, 2.0, 3)
            motion = Keyframes((0.0, 0.1), (tuple(place), tuple(place + way)), (STAYS, STAYS))
        lamps.append(SphereLight(radius_m, tuple(rng.uniform(0.5, 5.0, 3)), motion))
    floor = hw.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4))
    view = hw.camera(hw.look_from((0.3, 1.8, 4.0), (0, 0.6, 0)), 32, 24)
    return replace(hw.world(floor, view=view), sphere_lights=tuple(lamps))


def pictures(world):
    tracer = PathTracer(world, RenderOptions(spp=4))
    frame = Frame(page_aligned((len(tracer.names), tracer.height, tracer.width)), tracer.names)
    shown = []
    try:
        for index, time_us in enumerate((0, 40_000, 90_000)):
            tracer.fill_at(index, time_us, frame)
            shown.append(frame.planes.copy())
    finally:
        tracer.close()
    return np.stack(shown)


@pytest.mark.slow  # kernels of their own are compiled
@pytest.mark.parametrize(("moving", "shutter_s"), [(False, 0.0), (True, 0.0), (True, 0.05)])
def test_what_is_seen_of_many_spheres_is_what_each_of_them_shows(monkeypatch, moving, shutter_s):
    """To the bit: in pictures, shadows and mirrors, as they stand, move and blur."""
    world = swarm(moving)
    world = replace(world, camera=replace(world.camera, shutter_s=shutter_s))
    by_tree = pictures(world)
    monkeypatch.setattr(scene_features, "_SPHERES_OF_A_TREE", COUNT + 1)
    np.testing.assert_array_equal(by_tree, pictures(world))
    assert np.ptp(by_tree[:, 0]) > 0.5
