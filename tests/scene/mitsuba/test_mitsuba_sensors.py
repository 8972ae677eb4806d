"""What Mitsuba's sensors show: crop windows, distortion; and merged shapes."""

import numpy as np
import pytest

from clsim.live.outputs.sidecars import about_camera
from clsim.scene.mitsuba.scene import load_mitsuba
from tests.scene.mitsuba.mitsuba_files import complaint, load, scene

LIGHT = '<emitter type="constant"/>'
FILM = '<integer name="width" value="400"/><integer name="height" value="300"/>'
CROP = "".join(
    f'<integer name="crop_{name}" value="{value}"/>'
    for name, value in (("offset_x", 50), ("offset_y", 200), ("width", 300), ("height", 70))
)


def camera(tmp_path, kind, inside="", crop=""):
    film = f'<film type="hdrfilm">{FILM}{crop}</film>'
    place = '<transform name="to_world"><lookat origin="1, 2, 5" target="0, 0, 0" up="0, 1, 0"/></transform>'
    body = f'<sensor type="{kind}">{place}{inside}{film}</sensor>{LIGHT}<shape type="cube"/>'
    world = load_mitsuba(scene(tmp_path, body))
    assert world.warnings == ()
    return world.camera


def pixel(camera, point):
    about = about_camera(camera)
    x, y, z, _ = np.linalg.inv(camera.motion.pose(0.0)) @ (*point, 1.0)
    if camera.lens.model == "orthographic":
        scale, centre = about["pixels_per_m"], about["axis_px"]
        return centre["cx"] + scale["x"] * x, centre["cy"] - scale["y"] * y
    k = about["intrinsics_px"]
    return k["cx"] + k["fx"] * x / -z, k["cy"] - k["fy"] * y / -z


@pytest.mark.parametrize(
    ("kind", "inside"),
    [
        ("perspective", '<float name="fov" value="50"/>'),
        ("perspective", '<float name="fov" value="50"/><float name="principal_point_offset_y" value="0.2"/>'),
        ("thinlens", '<string name="focal_length" value="35mm"/><float name="principal_point_offset_x" value="0.1"/>'),
        ("orthographic", ""),
    ],
)
def test_a_crop_shows_a_part_of_the_same_picture(tmp_path, kind, inside):
    whole, part = (camera(tmp_path, kind, inside, crop) for crop in ("", CROP))
    assert (part.width, part.height) == (300, 70)
    for point in ((0, 0, 0), (0.5, -0.3, 0.2), (-1, 1, 1)):
        np.testing.assert_allclose(np.add(pixel(part, point), (50, 200)), pixel(whole, point), atol=1e-6)


@pytest.mark.parametrize("crop", ['name="crop_width" value="401"', 'name="crop_offset_y" value="1"'])
def test_a_crop_beyond_its_film_is_refused(tmp_path, crop):
    body = f'<sensor type="perspective"><film type="hdrfilm">{FILM}<integer {crop}/></film></sensor>{LIGHT}'
    assert "expected a part of 400×300" in complaint(scene(tmp_path, body))


@pytest.mark.parametrize(("told", "expected"), [("", ()), ('<string name="kc" value="-0.25, 0.09"/>', (-0.25, 0.09))])
def test_radial_distortion_is_that_of_tangents(tmp_path, told, expected):
    """A tangent r appears at r (1 + kc₀ r² + kc₁ r⁴), as OpenCV's k1 and k2 have it (Mitsuba 0.6's manual)."""
    assert camera(tmp_path, "perspective_rdist", told).lens.distortion == expected


def test_merged_shapes_are_those_inside(tmp_path):
    inside = '<shape type="cube"/><shape type="sphere"/>'
    merged, plain = load(tmp_path, f'<shape type="merge">{inside}</shape>'), load(tmp_path, inside)
    assert [len(mesh.triangles) for mesh in merged.meshes] == [len(mesh.triangles) for mesh in plain.meshes]
    assert len(merged.instances) == 2 and merged.warnings == ()
