"""Orthographic cameras of each format: how wide they see, by the format's own definition."""

import re

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.scene import load_world
from tests.scene.gltf.gltf_files import gltf, write_gltf
from tests.scene.mitsuba.mitsuba_files import scene
from tests.scene.usd.usd_files import METRES, mesh, usda


def seen_m(world):
    """Width and height of what the camera sees [m]."""
    camera = world.camera
    fx, fy = camera.focal_px()
    assert camera.lens.model == "orthographic"
    return camera.width / abs(fx), camera.height / fy


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_gltf(tmp_path, scale):
    """Half of the width and of the height, in the camera's own space (glTF 2.0, 3.10.3)."""
    eye = {"camera": 0, "scale": [scale] * 3}
    tree = gltf(nodes=[{"mesh": 0}, eye], scenes=[{"nodes": [0, 1]}])
    tree["cameras"] = [{"type": "orthographic", "orthographic": {"xmag": 1.5, "ymag": 1.0, "zfar": 9, "znear": 0.1}}]
    world = load_world(write_gltf(tmp_path, tree))
    assert seen_m(world) == pytest.approx((3.0 * scale, 2.0 * scale), rel=2e-3)
    assert not any("camera" in warning for warning in world.warnings)


def test_gltf_that_sees_no_area_is_told(tmp_path):
    tree = gltf(nodes=[{"mesh": 0}, {"camera": 0}], scenes=[{"nodes": [0, 1]}])
    tree["cameras"] = [{"type": "orthographic", "orthographic": {"xmag": 0, "ymag": 1.0, "zfar": 9, "znear": 0.1}}]
    assert any("sees no area" in warning for warning in load_world(write_gltf(tmp_path, tree)).warnings)


def test_usd(tmp_path):
    """Apertures are in tenths of the file's unit (UsdGeomCamera)."""
    eye = """def Camera "eye" { token projection = "orthographic"
        float horizontalAperture = 300
        float verticalAperture = 150
        double3 xformOp:translate = (0, 0, 9)
        uniform token[] xformOpOrder = ["xformOp:translate"] }"""
    world = load_world(usda(tmp_path, mesh() + eye, METRES.replace("= 1", "= 0.01")))
    assert seen_m(world) == pytest.approx((0.3, 0.15), rel=2e-3)
    turned = "float xformOp:rotateZ = 90\n float3 xformOp:scale = (2, 3, 1)\n double3"
    order = '["xformOp:translate", "xformOp:rotateZ", "xformOp:scale"]'
    eye = eye.replace("double3", turned).replace('["xformOp:translate"]', order)
    world = load_world(usda(tmp_path, mesh() + eye, METRES, "scaled.usda"))
    assert seen_m(world) == pytest.approx((60, 45), rel=2e-3), "its own space may be scaled"


def test_mitsuba(tmp_path):
    """From −1 to 1 along x, times what its place makes of that."""
    sensor = """<sensor type="orthographic"><transform name="to_world"><scale x="3" y="2"/>
        <lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="60"/><integer name="height" value="40"/></film></sensor>"""
    world = load_world(scene(tmp_path, sensor + '<shape type="sphere"/>'))
    # Along y as far as its film's shape says, times its own scale.
    assert seen_m(world) == pytest.approx((6.0, 2 * 2.0 * 40 / 60))


@pytest.mark.parametrize(("width", "height", "seen"), [(40, 20, (4.0, 2.0)), (20, 40, (2.0, 4.0))])
def test_pbrt(tmp_path, width, height, seen):
    """From −1 to 1 along the shorter side (pbrt-v4, screenwindow)."""
    path = tmp_path / "s.pbrt"
    path.write_text(
        f'Film "rgb" "integer xresolution" {width} "integer yresolution" {height}\nLookAt 0 0 5  0 0 0  0 1 0\n'
        'Camera "orthographic"\nWorldBegin\nShape "sphere"\n'
    )
    assert seen_m(load_world(path)) == pytest.approx(seen)


@pytest.mark.parametrize(
    ("camera", "lens", "problem"),
    [
        ("", 'model = "orthographic"', "camera.lens: is orthographic and has no view_width_m"),
        ("fov_deg = 40", 'model = "orthographic"\nview_width_m = 2.0', "has fov_deg and an orthographic lens"),
        ("", "view_width_m = 2.0", "camera.lens.view_width_m: expected it of an orthographic model only"),
    ],
)
def test_toml_that_contradicts_itself(tmp_path, camera, lens, problem):
    path = tmp_path / "s.toml"
    path.write_text(
        f'[camera]\nposition = [0, 0, 5]\n{camera}\n[camera.lens]\n{lens}\n[[objects]]\nshape = "quad"\nsize = [1, 1]\n'
    )
    with pytest.raises(InputError, match=re.escape(problem)):
        load_world(path)


def test_toml(tmp_path):
    path = tmp_path / "s.toml"
    path.write_text(
        "[camera]\nposition = [0, 0, 5]\nresolution = [40, 30]\n"
        '[camera.lens]\nmodel = "orthographic"\nview_width_m = 2.0\n'
        '[materials.grey]\ncolor = [0.5, 0.5, 0.5]\n[[objects]]\nshape = "sphere"\nradius_m = 0.5\nmaterial = "grey"\n'
    )
    world = load_world(path)
    assert seen_m(world) == pytest.approx((2.0, 1.5))
    assert np.array_equal(world.camera.motion.pose(0.0)[:3, 3], (0.0, 0.0, 5.0))
