"""What a world tells of itself."""

import numpy as np
import pytest

from clsim.scene import Camera, Lens, Static
from clsim.scene.motion import compose
from clsim.scene.world import Mount

PLACE, OFFSET = compose((1, 2, 3), np.eye(3)), compose((0.1, 0, 0), np.eye(3))
RIG = Camera(64, 48, 50.0, Static(PLACE), 0.01, Lens(aperture_radius_m=0.02))


@pytest.mark.parametrize(
    ("own", "changed"),
    [
        ({}, {}),
        ({"resolution": (32, 20)}, {"width": 32, "height": 20}),
        ({"fov_deg": 90.0}, {"fov_deg": 90.0}),
        ({"lens": Lens(model="fisheye")}, {"lens": Lens(model="fisheye")}),
        ({"shutter_s": 0.0}, {"shutter_s": 0.0}),
    ],
)
def test_a_camera_of_a_rig_is_as_the_rig_but_for_what_it_has_of_its_own(own, changed):
    found = Mount("left", OFFSET, **own).camera(RIG)
    for name in ("width", "height", "fov_deg", "shutter_s", "lens"):
        assert getattr(found, name) == changed.get(name, getattr(RIG, name)), name
    np.testing.assert_allclose(found.motion.pose(0.0), PLACE @ OFFSET)
