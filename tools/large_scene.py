"""What a height field of many triangles costs: python -m tools.large_scene TRIANGLES FOLDER

Writes it into FOLDER as a binary PLY and a scene, and prints as JSON: the file's size; processor and clock seconds to
the first event, with all that comes before it (`--quality draft`, 96×72); memory at its peak; and paths per second of
processor time, of at most 8 edges.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from pathlib import Path

import numpy as np

import clsim
from clsim.bench.throughput.render import MAX_DEPTH
from clsim.frames import Frame, page_aligned
from clsim.render import PathTracer, RenderOptions
from clsim.scene import load_world

SIZE_M = 100.0
SPP = 8
STEP_US, LAST_US = 5_000, 500_000
SCENE = """
[camera]
resolution = [96, 72]
keyframes = [
  { time_s = 0.0, position = [0.0, 20.0, 60.0], look_at = [0.0, 0.0, 0.0] },
  { time_s = 1.0, position = [20.0, 20.0, 60.0], look_at = [0.0, 0.0, 0.0] },
]
[environment.daylight]
elevation_deg = 30.0
[[objects]]
file = "field.ply"
"""


def write_field(path: Path, triangles: int) -> None:
    """Write hills with rough ground as a PLY of at least that many triangles."""
    side = int(np.ceil(np.sqrt(triangles / 2))) + 1
    x, z = np.meshgrid(*[np.linspace(-SIZE_M / 2, SIZE_M / 2, side, dtype=np.float32)] * 2)
    rough = np.random.default_rng(0).random(x.shape, dtype=np.float32) * (0.5 * SIZE_M / side)
    points = np.stack([x, 2.0 * np.sin(0.3 * x) * np.cos(0.2 * z) + rough, z], axis=-1).astype("<f4")
    corner = np.arange(side * side, dtype="<i4").reshape(side, side)[:-1, :-1].ravel()
    first = np.stack([corner, corner + side, corner + 1], axis=1)
    second = np.stack([corner + 1, corner + side, corner + side + 1], axis=1)
    faces = np.zeros(2 * len(corner), np.dtype([("count", "u1"), ("corners", "<i4", 3)]))
    faces["count"], faces["corners"] = 3, np.concatenate([first, second])
    header = f"""ply
format binary_little_endian 1.0
element vertex {side * side}
property float x
property float y
property float z
element face {len(faces)}
property list uchar int vertex_indices
end_header
"""
    with path.open("wb") as file:
        file.write(header.encode())
        points.tofile(file)
        faces.tofile(file)


def measure(scene: Path) -> dict[str, float]:
    """Return seconds until the first event, the peak of memory in all and a triangle, and paths a second."""
    cpu_s, clock_s = time.process_time(), time.perf_counter()
    world = load_world(str(scene))
    triangles = sum(len(mesh.triangles) for mesh in world.meshes)
    figures: dict[str, float] = {"triangles": triangles, "load_cpu_s": time.process_time() - cpu_s}
    with clsim.Simulator(world, clock="caller", quality="draft") as simulator:
        at_us = 0
        while not len(simulator.step(until_us=at_us)) and at_us < LAST_US:
            at_us += STEP_US
    figures |= {"first_event_cpu_s": time.process_time() - cpu_s, "first_event_s": time.perf_counter() - clock_s}
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    figures |= {"first_event_us": at_us, "peak_bytes": peak, "bytes_per_triangle": peak / triangles}
    tracer = PathTracer(world, RenderOptions(spp=SPP, max_depth=MAX_DEPTH))
    frame = Frame(page_aligned((len(tracer.names), tracer.height, tracer.width)), tracer.names)
    tracer.fill(0, frame)
    cpu_s = time.process_time()
    tracer.fill(0, frame)
    figures["paths_per_cpu_second"] = tracer.width * tracer.height * SPP / (time.process_time() - cpu_s)
    tracer.close()
    return figures


def main(triangles: str, folder: str) -> None:
    """Write the scene, measure."""
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    write_field(place / "field.ply", int(triangles))
    (place / "field.toml").write_text(SCENE)
    print(json.dumps({"file_bytes": (place / "field.ply").stat().st_size, **measure(place / "field.toml")}, indent=1))


if __name__ == "__main__":
    main(*sys.argv[1:])
