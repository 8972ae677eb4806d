"""Lenses of MuJoCo's cameras, against the frustum that MuJoCo itself draws."""

import numpy as np
import pytest

from clsim.bridges.mujoco import MujocoScene
from clsim.scene import Camera

mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
SENSOR = 'sensorsize="0.0064 0.0048" resolution="64 48"'


def load(attributes: str) -> tuple[object, object]:
    eye = f'<camera name="eye" pos="0 -3 0" xyaxes="1 0 0 0 0 1" {attributes}/>'
    box = '<light pos="0 -2 3"/><geom type="box" size=".5 .1 .5"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{eye}{box}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def frustum(model: object, data: object, size: tuple[int, int]) -> list[float]:
    """Return left, right, bottom and top of MuJoCo's frustum at a distance of 1."""
    scene, eye = mujoco.MjvScene(model, 100), mujoco.MjvCamera()
    eye.type, eye.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, eye, mujoco.mjtCatBit.mjCAT_ALL, scene)
    one = scene.camera[0]
    half = one.frustum_width or (one.frustum_top - one.frustum_bottom) / 2 * size[0] / size[1]
    edges = one.frustum_center - half, one.frustum_center + half, one.frustum_bottom, one.frustum_top
    return [edge / one.frustum_near for edge in edges]


def test_models_without_cameras_are_seen_as_by_mujocos_viewer() -> None:
    """Where MuJoCo's own free camera stands, and where it looks."""
    body = '<light pos="0 0 3"/><geom type="plane" size="2 2 .1"/><body pos=".3 0 1"><geom size=".1"/></body>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = MujocoScene(model, data, resolution=(60, 40)).world.camera
    scene, eye = mujoco.MjvScene(model, 100), mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, eye)
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, eye, mujoco.mjtCatBit.mjCAT_ALL, scene)
    one, up = scene.camera[0], np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    pose = camera.motion.pose(0.0)
    # The scene has one for each eye, a little apart.
    middle = (np.array(scene.camera[0].pos) + np.array(scene.camera[1].pos)) / 2
    assert pose[:3, 3] == pytest.approx(up @ middle, abs=1e-5)
    assert -pose[:3, 2] == pytest.approx(up @ np.array(one.forward), abs=1e-5)
    assert pose[:3, 1] == pytest.approx(up @ np.array(one.up), abs=1e-5)
    top = one.frustum_top / one.frustum_near
    assert edges(camera)[2:] == pytest.approx([-top, top], abs=1e-6)


def edges(camera: Camera) -> list[float]:
    (fx, fy), (x, y) = camera.focal_px(), camera.lens.principal_point
    cx, cy = camera.width * (0.5 + x), camera.height / 2 + camera.width * y
    return [-cx / fx, (camera.width - cx) / fx, (cy - camera.height) / fy, cy / fy]


@pytest.mark.parametrize("size", [(64, 48), (80, 80)])
@pytest.mark.parametrize(
    "attributes",
    [
        'fovy="51"',
        f'{SENSOR} focal="0.005 0.005"',
        f'{SENSOR} focal="0.005 0.005" principal="0.001 0.0005"',
        f'{SENSOR} focal="0.010 0.005" principal="-0.0007 0.0011"',
        f'{SENSOR} focalpixel="40 55" principalpixel="3 -7"',
    ],
)
def test_frustums_are_mujocos(attributes: str, size: tuple[int, int]) -> None:
    model, data = load(attributes)
    scene = MujocoScene(model, data, camera="eye", resolution=size)
    assert edges(scene.world.camera) == pytest.approx(frustum(model, data, size), abs=1e-6)
    assert not scene.world.warnings


@pytest.mark.parametrize("size", [(64, 48), (80, 80)])
def test_orthographic_frustums_are_mujocos(size: tuple[int, int]) -> None:
    """An orthographic frustum is as wide at any distance: its edges are metres."""
    try:
        model, data = load('fovy="2" projection="orthographic"')
    except ValueError:
        model, data = load('fovy="2" orthographic="true"')
    scene, eye = mujoco.MjvScene(model, 100), mujoco.MjvCamera()
    eye.type, eye.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, eye, mujoco.mjtCatBit.mjCAT_ALL, scene)
    top = scene.camera[0].frustum_top
    world = MujocoScene(model, data, camera="eye", resolution=size).world
    assert world.camera.lens.model == "orthographic"
    assert edges(world.camera) == pytest.approx([-top * size[0] / size[1], top * size[0] / size[1], -top, top])
    assert not world.warnings
