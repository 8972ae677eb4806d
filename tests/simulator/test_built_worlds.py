"""Worlds that are built in Python fire what those of files fire."""

from dataclasses import replace

import numpy as np
import pytest

import clsim
from clsim.errors import InputError
from clsim.scene import Camera, Material, SphereLight, Static
from clsim.scene.driven import placed
from clsim.scene.motion import compose
from clsim.scene.shapes import box
from clsim.scene.world import PunctualLight
from tests.simulator.stage import scene, simulator


def test_lights_without_size_too_are_set_by_their_names() -> None:
    made = clsim.WorldBuilder(Camera(8, 6, 50.0, Static(compose((0.0, 0.0, 9.0), np.eye(3)))), "lab")
    made.add("box", box((1.0, 1.0, 1.0), 0))
    made.add_light("spot", PunctualLight("spot", (9.0, 9.0, 9.0), Static(np.eye(4))))
    with clsim.Simulator(made.world()) as run:
        run.set_light("spot", (3.0, 2.0, 1.0))
        with pytest.raises(InputError, match="no light called 'sun' shines in lab, expected one of: spot"):
            run.set_light("sun", (3.0, 2.0, 1.0))


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


def test_going_back_brings_back_the_light_that_was_set_and_forgets_where_things_went(tmp_path) -> None:
    places = [((x, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)) for x in (0.3, -0.3)]

    def steps(run: clsim.Simulator, way: int) -> bytes:
        run.set_pose("box", places[way], 5_000)
        return run.step(5_000).tobytes()

    found = []
    for others in (0, 1):
        with simulator(tmp_path, clock="caller") as run:
            run.set_light("lamp", (9.0, 9.0, 9.0))
            run.set_pose("box", np.eye(4), 0)
            run.step(0)
            state = run.snapshot()
            for _ in range(others):
                run.set_light("lamp", (40.0, 40.0, 40.0))
                steps(run, 1)
                run.restore(state)
            found.append(steps(run, 0))
    assert found[0] == found[1] and len(found[0]) > 1000
