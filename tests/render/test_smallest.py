"""The narrowest thing of a world, in closed form, and pixels into which no ray need look for what is narrower."""

from __future__ import annotations

from dataclasses import replace

import hand_worlds as hw
import numpy as np
import pytest
from test_steered import Run, textured_world

from clsim.render.placement import place
from clsim.render.smallest import smallest_width
from clsim.scene import SphereLight, Static
from clsim.scene.motion import Keyframes

SCALED = np.diag([2.0, 2.0, 2.0, 1.0])
MOVING = Keyframes((0.0, 1.0), ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), ((0.0, 0.0, 0.0, 1.0),) * 2)


def width_of(world):
    return smallest_width(place(world), world.sphere_lights)


@pytest.mark.parametrize(
    ("mesh", "motion", "expected"),
    [
        (hw.quad((0, 0, 0), (3, 0, 0), (0, 4, 0)), Static(np.eye(4)), 2.4),
        (hw.quad((0, 0, 0), (3, 0, 0), (0, 4, 0)), Static(SCALED), 4.8),
        (hw.quad((0, 0, 0), (3, 0, 0), (0, 4, 0)), MOVING, 2.4),
        (hw.quad((0, 0, 0), (3, 0, 0), (0, 0, 0)), Static(np.eye(4)), np.inf),
        (hw.box((0, 0, 0), (1.0, 1.0, 1e-3)), Static(np.eye(4)), 1e-3),
    ],
    ids=["quad", "scaled", "moving", "without area", "sheet"],
)
def test_it_is_the_lowest_height_of_a_triangle(mesh, motion, expected):
    assert width_of(hw.world(mesh, motions=[motion])) == pytest.approx(expected, rel=1e-6)


def test_it_is_no_more_than_a_lamps_diameter():
    lamp = SphereLight(0.25, (1.0, 1.0, 1.0), Static(np.eye(4)))
    assert width_of(hw.world(hw.box((0, 0, 0), (1, 1, 1)), sphere_lights=(lamp,))) == 0.5


def test_no_ray_looks_for_what_cannot_be_there():
    """A crumb behind the camera makes rays look everywhere; that costs rays, and shows nothing else."""
    scene = textured_world()
    floor, _, lamp = scene.meshes
    still, camera = scene.instances[0], replace(scene.camera, width=36, height=30)

    def seen(*meshes):
        instances = tuple(replace(still, mesh=number) for number in range(len(meshes)))
        run = Run(replace(scene, meshes=meshes, instances=instances, camera=camera), spp=1)
        return run.fill(0), run.spent[1]

    crumb = hw.quad((0, 50.0, 0), (1e-3, 0, 0), (0, 1e-3, 0))
    (plain, few), (sought, many) = seen(floor, lamp), seen(floor, lamp, crumb)
    whole = plain.plane("Samples") < sought.plane("Samples")
    assert whole.mean() > 0.2
    assert whole[plain.plane("Coverage") == 0].mean() > 0.9
    assert many - few == (sought.plane("Samples") - plain.plane("Samples")).sum()
    for name in ("G", "Albedo.G", "Depth", "Ny"):
        np.testing.assert_allclose(plain.plane(name)[whole], sought.plane(name)[whole], rtol=1e-3)
