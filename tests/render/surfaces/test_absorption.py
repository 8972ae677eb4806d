"""Beer's law: light is dimmed by exp(−absorption·way) within glass, and nowhere else."""

import numpy as np
import pytest

from clsim.scene import Material
from tests.render import hand_worlds as hw

pytestmark = pytest.mark.slow
ABSORPTION = (0.1, 0.5, 2.0)


@pytest.mark.parametrize("kind", ["dielectric", "disney"])
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
