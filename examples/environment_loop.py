"""An agent's loop: Gymnasium's pendulum, of which the agent sees events, as voxels in time.

It needs Gymnasium: pip install 'clsim[gymnasium]'.
"""

import gymnasium
import numpy as np
from pictures import grey_picture, save

import clsim
from clsim.bridges.gymnasium import EventObservation
from clsim.scene import Camera, Material, Static
from clsim.scene.motion import compose, euler_quaternion
from clsim.scene.shapes import box

scene = clsim.WorldBuilder(Camera(96, 96, 60.0, Static(compose((0.0, 0.0, 3.0), np.eye(3)))))
rod = compose((0.0, 0.5, 0.0), np.eye(3))  # it hangs on the origin by its end
scene.add_parts("rod", {"body": (box((0.2, 1.0, 0.2)), rod, Material(color=(0.1, 0.1, 0.1)))})
env = gymnasium.make("Pendulum-v1")


def follow(simulator):
    """Show the pendulum as it is now, and return the time since the episode began [µs]."""
    at_us = round(env.get_wrapper_attr("_elapsed_steps") * env.unwrapped.dt * 1e6)
    turn = euler_quaternion((0.0, 0.0, np.degrees(env.unwrapped.state[0])))
    simulator.set_pose("rod", ((0.0, 0.0, 0.0), turn), at_us)
    return at_us


panels = {}
world = scene.world(environment=(0.5, 0.5, 0.5))
with clsim.Simulator(world, clock="caller", fps=200.0, quality="draft") as simulator:
    seeing = EventObservation(env, simulator, follow, form="voxels", bins=5)
    observation, info = seeing.reset(seed=1)
    for step in range(1, 9):
        torque = [2.0 if observation["state"][2] > 0 else -2.0]  # swing it up; a real agent would look at the events
        observation, reward, terminated, truncated, info = seeing.step(np.array(torque, np.float32))
        print(f"step {step}: reward {reward:.2f}, {len(info['events']['t'])} events")
        if step % 2 == 0:
            panels[f"step {step}, sum of the voxels"] = grey_picture(observation["events"].sum(axis=0), -4, 4)

save(panels, "environment_loop.png")
