"""A small scene to be driven: a box, a lamp and a camera with names. All tests share its kernel."""

from pathlib import Path
from typing import Any

import numpy as np

import clsim

STILL = """
fps = 200
[camera]
resolution = [32, 24]
position = [0.0, 0.4, 3.0]
[environment]
radiance = [0.2, 0.2, 0.2]
[materials.floor]
checker = { color_a = [0.8, 0.8, 0.8], color_b = [0.1, 0.1, 0.1], squares_per_m = 3.0 }
[[objects]]
name = "floor"
shape = "quad"
size = [8.0, 8.0]
position = [0.0, -0.5, 0.0]
material = "floor"
[[objects]]
name = "box"
shape = "box"
size = [0.8, 0.8, 0.8]
BOX
[[sphere_lights]]
name = "lamp"
radius_m = 0.3
radiance = [20.0, 20.0, 20.0]
position = [1.5, 2.5, 1.5]
"""
KEYS = (
    (0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),
    (0.012, (0.1, 0.0, 0.0), (0.0, 0.28, 0.0, 0.96)),
    (0.03, (0.3, 0.15, 0.0), (0.0, 0.6, 0.0, 0.8)),
    (0.04, (0.35, 0.15, 0.1), (0.36, 0.48, 0.64, 0.48)),
)
"""Time [s], position and quaternion of the box."""


def scene(folder: Path, box: str = "position = [0.0, 0.0, 0.0]") -> str:
    """Write the scene, with those keys of the box, and return its file."""
    path = folder / "stage.toml"
    path.write_text(STILL.replace("BOX", box))
    return str(path)


def simulator(folder: Path, **options: Any) -> clsim.Simulator:
    """Return a simulator of the scene in which the box can be moved, whose kernel is that of a box that moves."""
    run = clsim.Simulator(scene(folder), **options)
    run.set_pose("box", np.eye(4), 0)
    return run


def keyframed() -> str:
    """Return the keys of the box on its way."""
    rows = ", ".join(f"{{ time_s = {t!r}, position = {list(p)}, quaternion = {list(q)} }}" for t, p, q in KEYS)
    return f"keyframes = [{rows}]"
