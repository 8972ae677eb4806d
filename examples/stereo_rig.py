"""A stereo pair of event cameras, 12 cm apart, that moves through a scene.

Both see the same scene at the same times. What is near lies farther to the left in the right camera's picture.
"""

from dataclasses import replace

import numpy as np
from pictures import events_picture, grey_picture, save

import clsim
from clsim.scene.motion import compose
from clsim.scene.world import Mount

world = clsim.load_scene("two-boxes", resolution=(173, 130))
right = compose((0.12, 0.0, 0.0), np.eye(3))  # 12 cm to the right of the left one
world = replace(world, rig=(Mount("left", np.eye(4)), Mount("right", right)))

events = {"left": [], "right": []}
with clsim.RigSimulator(world, fps=240.0, quality="draft", truth="depth") as rig:
    for step in range(1, 9):
        for name, batch in rig.step(until_us=4_167 * step).items():
            events[name].append(batch.copy())
    camera = rig.cameras["left"]
    depth_m = rig.truth("left", "depth")["depth"]

events = {name: np.concatenate(batches) for name, batches in events.items()}
focal_px, _ = camera.focal_px()
disparity_px = focal_px * 0.12 / depth_m
for name, seen in events.items():
    print(name, "fired", len(seen), "events")
print(f"disparity: up to {disparity_px.max():.1f} pixels")

save(
    {name: events_picture(seen, 173, 130) for name, seen in events.items()}
    | {"disparity of the left camera": grey_picture(disparity_px)},
    "stereo_rig.png",
    columns=3,
)
