"""The method of Tsuji et al. (ICIP 2023) on noisy frames, beside plain ESIM on the same frames.

Frames with 8 paths a pixel and new random numbers in each are written as EXR files. Then events are found in them: by
the brightness of each pixel alone (esim), and by a regression over a window (esim-ad), which takes the noise out.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from pictures import events_picture, light_picture, save

import clsim


def run(*arguments):
    """Run a command of clsim."""
    subprocess.run([sys.executable, "-m", "clsim", *map(str, arguments)], check=True)


SCENE = ("two-boxes", "--resolution", "173x130", "--fps", "120", "--frame-count", "6")
with tempfile.TemporaryDirectory() as folder:
    frames, clean = Path(folder) / "frames", Path(folder) / "clean.npz"
    run("render", *SCENE, "--method", "esim-ad", "--noise", "independent", "--spp", "8", "--out", frames)
    run("live", *SCENE, "--out", clean, "--view", "none")
    panels = {}
    for method, options in {"esim": (), "esim-ad": ("--gate", "delta-r")}.items():
        events = Path(folder) / f"{method}.npz"
        run("detect", frames, "--method", method, *options, "--out", events)
        run("score", events, clean, "--within", "10ms")
        panels[f"8 noisy paths, {method}"] = events_picture(clsim.open(events).read(), 173, 130)
    panels["what clsim live sees"] = events_picture(clsim.open(clean).read(), 173, 130)

with clsim.Simulator("two-boxes", resolution=(173, 130), method="esim-ad", noise="independent", spp=8) as simulator:
    simulator.step(until_us=0)
    panels = {"a frame of 8 paths": light_picture(simulator.frame())} | panels
save(panels, "paper_method.png")
