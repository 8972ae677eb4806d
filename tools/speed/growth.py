"""How cost grows: pixels, triangles, lamps, and things that move.

python -m tools.speed.growth [pixels|triangles|lamps|moving ...]

Each scene is written as a file and run by `clsim live` at ``balanced``, 120 frames a second, 346×260 unless pixels
grow. Printed are CPU time a frame (the difference of two runs, so that starts do not count), what is left of a run for
its start, kernels compiled, and memory at its peak. The camera moves in all.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

FIRST, LAST = 6, 18
"""Frames of the two runs."""
SUMS = ("cpu_s", "first_hit_rays", "paths", "events")
SIZE_M = 100.0
CAMERA = """fps = 120
[camera]
fov_deg = 55.0
keyframes = [
  {{ time_s = 0.0, position = [{0}, {1}, {2}], look_at = [0.0, 0.3, 0.0] }},
  {{ time_s = 2.0, position = [{3}, {1}, {2}], look_at = [0.0, 0.3, 0.0] }},
]
"""
ROOM = """
[environment]
radiance = [0.1, 0.1, 0.12]
[materials.floor]
checker = { color_a = [0.65, 0.6, 0.55], color_b = [0.3, 0.3, 0.32], squares_per_m = 2.0 }
[materials.box]
color = [0.6, 0.3, 0.2]
[[objects]]
shape = "quad"
size = [12.0, 12.0]
material = "floor"
"""


def lamp(place: np.ndarray, radiance: float) -> str:
    """Return the lines of a small sphere that shines."""
    return (
        f"[[sphere_lights]]\nradius_m = 0.06\nposition = {[round(float(x), 3) for x in place]}\n"
        f"radiance = {[round(radiance, 3)] * 3}\n"
    )


def box(place: np.ndarray, size_m: float, way_m: np.ndarray | None) -> str:
    """Return the lines of a box, which goes that way in two seconds."""
    start = [round(float(x), 3) for x in place]
    at = f"position = {start}\n"
    if way_m is not None:
        end = [round(float(x), 3) for x in place + way_m]
        at = f"keyframes = [{{ time_s = 0.0, position = {start} }}, {{ time_s = 2.0, position = {end} }}]\n"
    return f'[[objects]]\nshape = "box"\nsize = {[size_m] * 3}\nmaterial = "box"\n{at}'


def room(lamps: int, moving: int) -> str:
    """Return a floor with 64 boxes, of which some move, in the light of some lamps; it is as bright with any number."""
    rng = np.random.default_rng(0)
    text = CAMERA.format(-2.2, 2.2, 4.6, -1.4) + ROOM
    for k in range(64):
        place = np.array([rng.uniform(-3, 3), 0.15, rng.uniform(-3, 3)])
        angle = rng.uniform(0, 2 * np.pi)
        text += box(place, 0.3, np.array([np.cos(angle), 0.0, np.sin(angle)]) if k < moving else None)
    for _ in range(lamps):
        text += lamp(np.array([rng.uniform(-4, 4), 2.8, rng.uniform(-4, 4)]), 700.0 / lamps)
    return text


def hills(path: Path, triangles: int) -> str:
    """Write hills with rough ground as a PLY of about that many triangles, and return their scene."""
    side = round(np.sqrt(triangles / 2)) + 1
    x, z = np.meshgrid(*[np.linspace(-SIZE_M / 2, SIZE_M / 2, side, dtype=np.float32)] * 2)
    rough = np.random.default_rng(0).random(x.shape, dtype=np.float32) * (0.5 * SIZE_M / side)
    points = np.stack([x, 2.0 * np.sin(0.3 * x) * np.cos(0.2 * z) + rough, z], axis=-1).astype("<f4")
    corner = np.arange(side * side, dtype="<i4").reshape(side, side)[:-1, :-1].ravel()
    faces = np.zeros(2 * len(corner), np.dtype([("count", "u1"), ("corners", "<i4", 3)]))
    faces["count"] = 3
    faces["corners"][0::2] = np.stack([corner, corner + side, corner + 1], axis=1)
    faces["corners"][1::2] = np.stack([corner + 1, corner + side, corner + side + 1], axis=1)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {side * side}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz")
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    path.write_bytes(header.encode() + points.tobytes() + faces.tobytes())
    camera = CAMERA.format(-2.0, 20.0, 60.0, 2.0)
    return f'{camera}[environment.daylight]\nelevation_deg = 30.0\n[[objects]]\nfile = "{path.name}"\n'


def cases(which: str, folder: Path) -> Iterator[tuple[str, str, str]]:
    """Yield what each case of a table is called, its scene and its resolution."""
    if which == "pixels":
        for size in ("173x130", "346x260", "640x480", "1280x720", "1920x1080"):
            yield size, room(4, 4), size
    elif which == "triangles":
        for triangles in (1_000, 10_000, 100_000, 1_000_000, 10_000_000):
            yield f"{triangles:,}", hills(folder / "hills.ply", triangles), "346x260"
    elif which == "lamps":
        for lamps in (1, 4, 16, 100, 1000):
            yield f"{lamps}", room(lamps, 1), "346x260"
    else:
        for moving in (0, 1, 4, 16, 64):
            yield f"{moving}", room(4, moving), "346x260"


def run(scene: Path, size: str, frames: int) -> tuple[dict[str, float], float]:
    """Run a scene, and return its summary and its memory at the peak [MB]."""
    command = [sys.executable, "-m", "clsim", "live", str(scene), "--resolution", size, "--json"]
    command += ["--frame-count", str(frames)]
    with tempfile.TemporaryFile("w+") as out:
        process = subprocess.Popen(command, stdout=out, stderr=subprocess.DEVNULL)
        _, status, used = os.wait4(process.pid, 0)
        if status:
            raise SystemExit(f"{' '.join(command)}: failed")
        out.seek(0)
        return json.load(out), used.ru_maxrss / 1e3


def main(tables: list[str]) -> None:
    """Print the tables."""
    with tempfile.TemporaryDirectory() as folder:
        for which in tables or ["pixels", "triangles", "lamps", "moving"]:
            print(f"\n| {which} | CPU ms a frame | rays | paths | events | start, CPU s | MB |")
            print("|---" * 7 + "|")
            for name, text, size in cases(which, Path(folder)):
                scene = Path(folder) / "scene.toml"
                scene.write_text(text)
                run(scene, size, 2)  # compiles
                (before, _), (after, peak_mb) = run(scene, size, FIRST), run(scene, size, LAST)
                cpu_s, rays, paths, events = ((after[key] - before[key]) / (LAST - FIRST) for key in SUMS)
                told = f"{1e3 * cpu_s:.0f} | {rays:,.0f} | {paths:,.0f} | {events:,.0f}"
                start_s = before["cpu_s"] - FIRST * cpu_s
                print(f"| {name} | {told} | {start_s:.1f} | {peak_mb:.0f} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
