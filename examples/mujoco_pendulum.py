"""A pendulum of MuJoCo before a DAVIS346: physics in steps of 1 ms, and the camera in steps of 4 ms.

It needs MuJoCo: pip install 'clsim[mujoco]'.
"""

import mujoco
from pictures import events_picture, light_picture, save

import clsim
from clsim.bridges.mujoco import MujocoScene

PENDULUM = """
<mujoco>
  <option timestep="0.001"/>
  <asset>
    <texture name="grid" type="2d" builtin="checker" rgb1=".8 .8 .8" rgb2=".2 .2 .2" width="64" height="64"/>
    <material name="grid" texture="grid" texrepeat="1 1" texuniform="true"/>
  </asset>
  <worldbody>
    <light name="lamp" pos="1 -1 3" dir="-.3 .3 -1"/>
    <camera name="eye" pos="0 -3 1" xyaxes="1 0 0 0 .1 1"/>
    <geom type="plane" size="3 3 .1" material="grid"/>
    <body name="pendulum" pos="0 0 1.8">
      <joint name="hinge" type="hinge" axis="0 1 0" damping=".05"/>
      <geom type="capsule" fromto="0 0 0 0 0 -1" size=".03" rgba=".6 .6 .6 1"/>
      <geom type="sphere" pos="0 0 -1" size=".15" rgba=".8 .1 .1 1"/>
    </body>
  </worldbody>
</mujoco>
"""
model = mujoco.MjModel.from_xml_string(PENDULUM)
data = mujoco.MjData(model)
data.joint("hinge").qpos, data.joint("hinge").qvel = 1.0, -3.0

panels = {}
scene = MujocoScene(model, data, camera="eye", resolution=(173, 130))
with clsim.Simulator(scene.world, clock="caller", quality="draft", sensor="davis346") as simulator:
    scene.follow(simulator)
    simulator.step(scene.time_us)
    for step in range(1, 41):
        for _ in range(4):
            mujoco.mj_step(model, data)
            scene.follow(simulator)  # so that motion between two of the camera's steps is seen too
        events = simulator.step(scene.time_us)
        if step % 20 == 0:
            at_ms = round(1000 * data.time)
            print(f"{at_ms} ms: the pendulum is at {data.qpos[0]:+.2f} rad, {len(events)} events in 4 ms")
            panels[f"rendered, {at_ms} ms"] = light_picture(simulator.frame())
            panels[f"events of 4 ms, {at_ms} ms"] = events_picture(events, 173, 130)

save(panels, "mujoco_pendulum.png")
