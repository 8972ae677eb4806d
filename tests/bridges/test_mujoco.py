"""MuJoCo's models seen by clsim, against MuJoCo's own rays."""

import math

import numpy as np
import pytest

import clsim
from clsim.errors import InputError
from clsim.frames import Frame
from clsim.scene.driven import placed
from clsim.scene.pictures.images import decode_srgb

mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")

from clsim.bridges.mujoco import MujocoScene  # noqa: E402

MODEL = """
<mujoco>
  <visual><headlight ambient=".1 .1 .1"/></visual>
  <asset>
    <texture name="grid" type="2d" builtin="checker" rgb1=".9 .9 .9" rgb2=".1 .1 .1" width="64" height="64"/>
    <material name="grid" texture="grid" texrepeat="2 2" texuniform="true"/>
    <material name="red" rgba=".8 .1 .1 1"/>
    <mesh name="wedge" vertex="0 0 0  .5 0 0  0 .5 0  0 0 .5"/>
    <hfield name="hill" nrow="3" ncol="4" size=".4 .3 .2 .1" elevation="0 0 0 0  0 1 .5 0  0 0 0 0"/>
  </asset>
  <worldbody>
    <light name="sun" directional="true" pos="0 0 4" dir="0 0 -1" diffuse=".6 .6 .6"/>
    <camera name="eye" pos="0 -3 1.4" xyaxes="1 0 0 0 .2 1" fovy="50"/>
    <geom name="floor" type="plane" size="4 3 .1" material="grid"/>
    <geom name="wall" type="box" pos="0 1.4 .6" size="1.5 .05 .6" rgba=".5 .5 .5 1"/>
    <geom name="hill" type="hfield" hfield="hill" pos="-.9 -.6 .1"/>
    <geom name="unseen" type="sphere" size="1" group="3" contype="0" conaffinity="0"/>
    <geom name="clear" type="sphere" size="1" rgba="0 0 0 0" contype="0" conaffinity="0"/>
    <body name="robot/arm" pos="0 .4 1.7">
      <joint name="hinge" type="hinge" axis="0 1 0" damping=".1"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.7" size=".06" material="red"/>
      <geom type="ellipsoid" pos="0 0 -.8" size=".3 .15 .1" rgba=".2 .4 .8 1"/>
      <body name="tip" pos="0 0 -.9"><joint type="ball"/><geom type="cylinder" size=".12 .1" rgba=".1 .7 .2 1"/></body>
    </body>
    <body pos=".9 -.3 .5"><freejoint/><geom type="mesh" mesh="wedge"/></body>
    <body name="ghost" mocap="true" pos=".8 .2 1.2"><geom type="sphere" size=".15" contype="0" conaffinity="0"/></body>
  </worldbody>
</mujoco>
"""
SIZE = (48, 36)


def load(text: str = MODEL) -> tuple[object, object]:
    model = mujoco.MjModel.from_xml_string(text)
    return model, mujoco.MjData(model)


def rays(model: object, data: object) -> tuple[np.ndarray, np.ndarray]:
    """Return distance and geom ``[H, W]`` that MuJoCo finds along the pixels' middles; −1 where there is none."""
    (width, height), up = SIZE, math.tan(math.radians(float(model.cam_fovy[0])) / 2)
    across, down = np.meshgrid((np.arange(width) + 0.5) / width * 2 - 1, (np.arange(height) + 0.5) / height * 2 - 1)
    towards = np.stack([across * up * width / height, -down * up, -np.ones_like(across)], axis=2)
    towards /= np.linalg.norm(towards, axis=2, keepdims=True)
    towards = towards @ data.cam_xmat[0].reshape(3, 3).T
    groups = np.array([1, 1, 1, 0, 0, 0], np.uint8)
    distance, geoms = np.full((height, width), -1.0), np.full((height, width), -1)
    for y, x in np.ndindex(height, width):
        geom = np.zeros(1, np.int32)
        found = mujoco.mj_ray(model, data, data.cam_xpos[0], towards[y, x], groups, 1, -1, geom)
        distance[y, x] = found if isinstance(found, float) else found[0]
        geoms[y, x] = geom[0]
    return distance, geoms


def agree(frame: Frame, model: object, data: object) -> None:
    """Compare depths within objects: at edges a pixel shows two."""
    distance, geoms = rays(model, data)
    assert len(np.unique(geoms)) >= 9, "all are in the picture"
    inside = np.zeros(geoms.shape, bool)
    middle = geoms[1:-1, 1:-1]
    around = [
        geoms[1 + dy : geoms.shape[0] - 1 + dy, 1 + dx : geoms.shape[1] - 1 + dx]
        for dy in (-1, 0, 1)
        for dx in (-1, 0, 1)
    ]
    inside[1:-1, 1:-1] = np.all([middle == each for each in around], axis=0) & (middle >= 0)
    error = np.abs(frame.plane("Depth")[inside] / distance[inside] - 1)
    assert inside.sum() > 500 and np.median(error) < 2e-3 and (error < 0.02).mean() > 0.97
    assert (frame.plane("Coverage")[1:-1, 1:-1][np.all([each < 0 for each in around], axis=0)] == 0).all()


@pytest.mark.slow
def test_depth_is_what_mujocos_rays_find_at_rest_and_after_a_swing() -> None:
    model, data = load()
    data.qpos[0] = 0.4
    scene = MujocoScene(model, data, camera="eye", resolution=SIZE)
    assert not scene.world.warnings
    with clsim.Simulator(scene.world, clock="caller", quality="draft") as run:
        scene.follow(run)
        assert len(run.step(scene.time_us)) == 0
        scene.follow(run)  # no time has passed: nothing to say
        agree(run.frame(), model, data)
        data.mocap_pos[0] = (0.4, 0.2, 1.5)
        fired = 0
        for _ in range(4):
            for _ in range(25):
                mujoco.mj_step(model, data)
                scene.follow(run)
            fired += len(run.step(scene.time_us))
        assert run.time_us == 200_000 and fired > 500
        agree(run.frame(), model, data)
        scene.follow(run)  # no time has passed: nothing to say
        mujoco.mj_resetData(model, data)
        data.qpos[0] = 0.4
        run.reset()
        scene.follow(run)
        run.step(scene.time_us)
        assert run.time_us == 0
        agree(run.frame(), model, data)


@pytest.mark.slow
def test_brightness_is_colour_times_light() -> None:
    text = MODEL.replace('rgba=".5 .5 .5 1"/>', 'rgba=".5 .5 .5 1" euler="90 0 0"/>').replace("0 -3 1.4", "0 1.4 3")
    text = text.replace("1 0 0 0 .2 1", "1 0 0 0 1 0").replace('pos="0 .4 1.7"', 'pos="9 9 9"')
    model, data = load(text)
    scene = MujocoScene(model, data, resolution=SIZE)
    with clsim.Simulator(scene.world, clock="caller", method="esim", spp=64, first_hit_rays=0) as run:
        run.step(0)
        middle = run.frame().planes[:3, 10:26, 14:34].mean(axis=(1, 2))
    # A surface that faces the sun: its colour, decoded, times diffuse and ambient light.
    assert middle == pytest.approx(float(decode_srgb(0.5)) * 0.7, rel=0.02)


def test_names_textures_and_what_is_left_out() -> None:
    model, data = load()
    world = MujocoScene(model, data, camera=0, resolution=SIZE).world
    assert tuple(placed(world)) == (
        "camera", "world", "world/floor", "world/wall", "world/hill", "robot:arm", "robot:arm/geom5", "robot:arm/geom6",
        "tip", "tip/geom7", "body3", "body3/geom8", "ghost", "ghost/geom9", "light:sun",
    )  # fmt: skip
    assert world.camera.motion.pose(0.0)[:3, 3] == pytest.approx([0.0, 1.4, 3.0])
    floor = world.materials[int(world.meshes[0].material_ids[0])]
    assert floor.texture == 0 and world.textures[0].uv_matrix == ((1.0, 0.0, 4.0), (0.0, 1.0, 3.0))
    assert world.environment == pytest.approx((0.1, 0.1, 0.1))
    (sun,) = world.punctual_lights
    assert sun.kind == "directional" and sun.intensity == pytest.approx((0.6 * math.pi,) * 3)
    assert sun.motion.pose(0.0)[:3, 2] == pytest.approx([0.0, 1.0, 0.0]), "it shines down"
    model, data = load(MODEL.replace('<light name="sun"', '<light name="sun" active="false"').replace("</asset>", """
        <texture type="skybox" builtin="flat" rgb1="0 0 0" width="8" height="8"/><material name="m" reflectance=".3"/>
        </asset>"""))  # fmt: skip
    world = MujocoScene(model, data, resolution=SIZE).world
    assert [light.name for light in world.punctual_lights] == ["headlight"]
    assert world.warnings == (
        "mujoco: the model has a skybox, which clsim leaves out",
        "mujoco: the model has reflectance, which clsim leaves out",
    )


def test_a_camera_that_is_not_there() -> None:
    model, data = load()
    for camera in ("ear", 1):
        with pytest.raises(InputError, match=r"`camera` is .*, expected one of the model's: eye"):
            MujocoScene(model, data, camera=camera)
