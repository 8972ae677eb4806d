"""What a world tells of itself."""

import numpy as np
import pytest

from clsim.scene import Camera, Lens, Static, describe, load_world
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


@pytest.mark.parametrize(("corners", "triangles"), [(3, 1), (4, 2)])
@pytest.mark.parametrize("moves", [False, True])
def test_a_glowing_surface_that_moves_is_a_lamp_that_moves_however_few_its_triangles(
    tmp_path, corners, triangles, moves
):
    points = ["v 0 0 0", "v 1 0 0", "v 1 1 0", "v 0 1 0"][:corners]
    (tmp_path / "a.obj").write_text("\n".join([*points, "f " + " ".join(map(str, range(1, corners + 1)))]) + "\n")
    keys = "[{ time_s = 0, position = [0, 0, 0] }, { time_s = 1, position = [1, 0, 0] }]"
    (tmp_path / "a.toml").write_text(
        "[camera]\nposition = [0, 0, 5]\n[materials.glow]\nemission = [1, 1, 1]\n[[objects]]\nfile = 'a.obj'\n"
        "material = 'glow'\n" + (f"keyframes = {keys}\n" if moves else "")
    )
    facts = describe(load_world(str(tmp_path / "a.toml")))
    assert (facts["area_light_triangles"], facts["moving_lights"]) == (triangles, int(moves))
