"""Worlds that are built in Python fire what those of files fire."""

from dataclasses import replace

import numpy as np

import clsim
from clsim.scene import Camera, Material, SphereLight, Static
from clsim.scene.driven import placed
from clsim.scene.motion import compose
from tests.simulator.stage import scene, simulator


def test_what_a_file_says_can_be_said_in_python(tmp_path) -> None:
    """The same scene, both ways, fires the same bits."""
    loaded = clsim.load_scene(scene(tmp_path))
    made = clsim.WorldBuilder(Camera(32, 24, 50.0, Static(compose((0.0, 0.4, 3.0), np.eye(3)))), "lab")
    (floor, _), (quad, shape) = loaded.instances, loaded.meshes
    checker = made.add_texture(loaded.textures[0])
    made.add("floor", quad, floor.motion, material=replace(loaded.materials[1], texture=checker))
    made.add("box", shape, ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)), material=Material())
    made.add_light("lamp", SphereLight(0.3, (20.0, 20.0, 20.0), Static(np.eye(4))), compose((1.5, 2.5, 1.5), np.eye(3)))
    world = made.world(environment=(0.2, 0.2, 0.2), fps=200.0)
    assert tuple(placed(world)) == ("camera", "floor", "box", "lamp")
    found = []
    with simulator(tmp_path) as by_file, clsim.Simulator(world) as by_hand:
        by_hand.set_pose("box", np.eye(4), 0)
        for run in (by_file, by_hand):
            run.set_pose("box", compose((0.3, 0.0, 0.0), np.eye(3)), 20_000)
            found.append(run.step(20_000).tobytes())
    assert found[0] == found[1] and len(found[0]) > 1000
