"""Pictures of any renderer become events: here a spinning wheel that numpy draws, 2,000 pictures a second.

Show the pixels linear light, and show it often: an edge should move by less than a pixel from picture to picture.
"""

import numpy as np
from pictures import events_picture, grey_picture, save

import clsim

WIDTH, HEIGHT, STEP_US = 173, 130, 500
y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
radius = np.hypot(x - WIDTH / 2, y - HEIGHT / 2)
angle = np.arctan2(y - HEIGHT / 2, x - WIDTH / 2)


def render(time_s):
    """Return luminance [H, W]: eight spokes, 5 turns a second, with edges a pixel wide."""
    spokes = np.sin(8 * (angle - 2 * np.pi * 5 * time_s))
    edge = (spokes * radius / 8).clip(-0.5, 0.5) + 0.5
    return np.where(radius < 60, 0.2 + 0.8 * edge, 0.5)


batches = []
with clsim.Simulator.from_radiance(WIDTH, HEIGHT, threshold=0.25) as pixels:
    for t_us in range(0, 20_000, STEP_US):
        batches.append(pixels.push(render(1e-6 * t_us), t_us).copy())
events = np.concatenate(batches)
print(len(events), "events in 20 ms")

last = events[events["t"] > 15_000]
times = np.full((HEIGHT, WIDTH), np.nan)
times[events["y"], events["x"]] = events["t"]
panels = {
    "a picture": grey_picture(render(0.02), 0, 1),
    "events of the last 5 ms": events_picture(last, WIDTH, HEIGHT),
    "time of each pixel's last event": grey_picture(times),
}
save(panels, "any_renderer.png", columns=3)
