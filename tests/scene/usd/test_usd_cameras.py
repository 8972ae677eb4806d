"""Cameras of USD files, against the sentences of UsdGeomCamera's schema."""

import pytest

from clsim.scene import load_world
from clsim.scene.defaults.framing import RESOLUTION
from tests.scene.usd.usd_files import METRES, TIMED, mesh, placed, usda

CENTIMETRES = METRES.replace("= 1", "= 0.01")


def camera_of(tmp_path, *told, meta=CENTIMETRES, cameras=1):
    text = "".join(f'def Camera "eye{k}" {{\n' + "\n".join(told).replace("#", str(k)) + "\n}\n" for k in range(cameras))
    world = load_world(usda(tmp_path, mesh() + text, meta))
    return world if cameras > 1 else world.camera


def lens(across=36, up=24, focal=18, stop=2, focus=400):
    names = ("horizontalAperture", "verticalAperture", "focalLength", "fStop", "focusDistance")
    return [f"float {name} = {value}" for name, value in zip(names, (across, up, focal, stop, focus), strict=True)]


def test_a_camera_has_its_field_of_view_and_its_place(tmp_path):
    camera = camera_of(tmp_path, *lens(), placed("double3 xformOp:translate = (0, 0, 900)"))
    assert camera.fov_deg == pytest.approx(90)
    assert camera.width / camera.height == pytest.approx(1.5, abs=0.01)
    assert camera.motion.pose(0.0)[:3, 3] == pytest.approx((0, 0, 9))
    assert camera.lens.focus_distance_m == pytest.approx(4.0)
    assert camera.lens.aperture_radius_m == pytest.approx(18 / 10 * 0.01 / 2 / 2)


@pytest.mark.parametrize(("stop", "focus"), [(0, 400), (2, 0)])
def test_all_is_sharp_without_a_stop_or_a_distance_of_focus(tmp_path, stop, focus):
    assert camera_of(tmp_path, *lens(stop=stop, focus=focus)).lens.aperture_radius_m == 0


@pytest.mark.parametrize(("up", "height"), [(1e-3, 1), (1e6, 16384)])
def test_a_picture_however_narrow_has_some_pixels_and_not_too_many(tmp_path, up, height):
    assert camera_of(tmp_path, *lens(up=up)).height == height


def test_a_shifted_aperture_shifts_the_optical_axis_by_its_share_of_the_width(tmp_path):
    shifts = "float horizontalApertureOffset = 2", "float verticalApertureOffset = 3"
    assert camera_of(tmp_path, *lens(20, 10), *shifts).lens.principal_point == pytest.approx((-0.1, 0.15))


def test_an_orthographic_camera_sees_as_far_as_its_apertures_in_its_own_space(tmp_path):
    """They are in tenths of the file's unit: 4 cm times 3 across, 2 cm times 5 up; turned, sides stay sides."""
    turned = placed("float xformOp:rotateZ = 90", "float3 xformOp:scale = (3, 5, 1)")
    camera = camera_of(tmp_path, 'token projection = "orthographic"', *lens(40, 20), turned)
    assert (camera.lens.model, camera.lens.view_width_m) == ("orthographic", pytest.approx(0.12))
    assert (camera.width, camera.height) == (RESOLUTION[0], round(RESOLUTION[0] * 10 / 12))


def test_of_several_cameras_the_first_is_used_as_it_is_at_the_start(tmp_path):
    focal = "float focalLength.timeSamples = { 10: 18, 34: 60 }"
    told = [focal, *(each for each in lens(focus="40#") if "focalLength" not in each)]
    world = camera_of(tmp_path, *told, meta=TIMED, cameras=3)
    assert (world.camera.fov_deg, world.camera.lens.focus_distance_m) == pytest.approx((90, 400))
    assert "scene.usda: has 3 cameras, the first is used" in world.notes
