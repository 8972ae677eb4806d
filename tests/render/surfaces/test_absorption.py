"""Beer's law: light is dimmed by exp(−absorption·way) within glass, and nowhere else."""

from typing import get_args

import numpy as np
import pytest
import warp as wp

from clsim.render import SceneData
from clsim.render.accel.geometry import Surface
from clsim.render.surfaces.absorption import absorption_towards, dimmed
from clsim.render.surfaces.materials import Materials
from clsim.scene import Material
from clsim.scene.world import Kind
from tests.render import hand_worlds as hw

ABSORPTION, WAY_M = (0.1, 0.5, 2.0), 0.7
SOLID = ("dielectric", "disney")


@wp.kernel(enable_backward=False)
def crossed(
    materials: Materials,
    sides: wp.array[bool],
    toward: wp.array[wp.vec3],
    here: wp.vec3,
    out: wp.array2d[wp.vec3],
):
    i, material = wp.tid()
    point = Surface()
    point.normal = wp.vec3(0.0, 0.0, 1.0)
    point.front = sides[i]
    point.material = material
    out[i, material] = dimmed(absorption_towards(materials, point, toward[i], here), wp.static(WAY_M))


def test_a_way_into_solid_glass_is_dimmed_by_it_and_one_out_of_it_by_nothing():
    """What is scattered back stays where it was; so does what passes a pane or any other surface, which is no solid."""
    kinds = sorted(get_args(Kind))
    materials = tuple(Material(kind=kind, transmission=1.0, absorption=ABSORPTION) for kind in kinds)
    data = SceneData(hw.world(hw.box((-1, -1, -1), (1, 1, 1)), materials=materials))
    cases = [(front, (0.6, 0.0, z)) for front in (True, False) for z in (0.8, -0.8)]
    here = (0.3, 0.2, 0.1)
    found = wp.zeros((len(cases), len(kinds)), dtype=wp.vec3, device="cpu")
    given = [wp.array([front for front, _ in cases], dtype=bool, device="cpu")]
    given.append(wp.array([way for _, way in cases], dtype=wp.vec3, device="cpu"))
    inputs = [data.scene.materials, *given, wp.vec3(*here)]
    wp.launch(crossed, found.shape, inputs=inputs, outputs=[found], device="cpu")
    for (front, (_, _, z)), row in zip(cases, found.numpy(), strict=True):
        for kind, left in zip(kinds, row, strict=True):
            beyond = (ABSORPTION if front else (0.0, 0.0, 0.0)) if kind in SOLID else here
            expected = np.exp(-WAY_M * np.array(here if z > 0 else beyond))
            np.testing.assert_allclose(left, expected, rtol=1e-5, err_msg=f"{kind}, front {front}, z {z}")


@pytest.mark.slow
@pytest.mark.parametrize("kind", SOLID)
def test_light_through_a_slab(kind):
    """Two metres of glass that hardly refracts, before a sky of 1."""
    glass = Material(
        kind=kind, color=(1, 1, 1), ior=1.0001, transmission=1.0, absorption=ABSORPTION, alpha=0.0, clearcoat_alpha=0.1
    )
    near = hw.quad((-9, -9, -1), (18, 0, 0), (0, 18, 0))
    far = hw.quad((9, -9, -3), (-18, 0, 0), (0, 18, 0))
    world = hw.world(near, far, materials=(glass,), environment=(1, 1, 1), view=hw.camera(np.eye(4), 4, 4, fov_deg=1.0))
    seen, _ = hw.mean_and_error(hw.render(world, spp=64))
    np.testing.assert_allclose(seen, np.exp(-2 * np.array(ABSORPTION)), rtol=2e-3)
