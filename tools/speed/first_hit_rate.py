"""First-hit rays per CPU-second: of whole frames seen in kept light, where no path is traced, and of the search alone.

python tools/speed/first_hit_rate.py [--scenes two-boxes,…] [--qualities balanced,accurate]
    [--resolutions 64x48,173x130] [--frames 8] [--rounds 3] [--beside CHECKOUT]

Frames are rendered by one thread; figures are medians over frames, and then over rounds. With --beside, another
checkout renders the same in turn. The search alone is that of one ray a pixel, through its middle.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parents[2]
_ONCE_HZ = 1e-3
"""Light becomes no better after the first frame, and no path is traced."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", default="two-boxes")
    parser.add_argument("--qualities", default="balanced,accurate")
    parser.add_argument("--resolutions", default="64x48,173x130")
    parser.add_argument("--frames", type=int, default=8)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--beside", type=Path)
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        width, height = map(int, options.resolutions.split("x"))
        print(json.dumps(measure(options.scenes, options.qualities, width, height, options.frames)))
        return
    checkouts = [HERE] if options.beside is None else [options.beside.resolve(), HERE]
    for scene in options.scenes.split(","):
        for quality in options.qualities.split(","):
            for resolution in options.resolutions.split(","):
                told = [f"{Path(scene).parent.name or scene} {quality} {resolution}:"]
                found: dict[Path, list[dict[str, float]]] = {checkout: [] for checkout in checkouts}
                for _ in range(options.rounds):
                    for checkout in checkouts:
                        found[checkout].append(run(checkout, scene, quality, resolution, options.frames))
                for checkout, rounds in found.items():
                    middle = {key: statistics.median(each[key] for each in rounds) for key in rounds[0]}
                    told.append(
                        f"{checkout.name}: {middle['rays']:.1f} rays and {middle['us']:.2f} µs a pixel, "
                        f"{middle['rays'] / middle['us']:.2f} M rays a CPU-second, alone {middle['search']:.2f} M;"
                    )
                print(" ".join(told), flush=True)


def run(checkout: Path, scene: str, quality: str, resolution: str, frames: int) -> dict[str, float]:
    """Measure in a process of its own, with the code of that checkout."""
    command = [sys.executable, str(Path(__file__).resolve()), "--worker", "--scenes", scene, "--qualities", quality]
    command += ["--resolutions", resolution, "--frames", str(frames)]
    environment = os.environ | {"PYTHONPATH": str(checkout)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    result: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return result


def measure(scene: str, quality: Any, width: int, height: int, frames: int) -> dict[str, float]:
    """Return rays and µs of CPU time a pixel in whole frames, and millions of rays a CPU-second of the search alone."""
    from clsim.frames import Frame, page_aligned
    from clsim.live.options import LiveOptions
    from clsim.live.stages import plan_stages
    from clsim.render import PathTracer

    stages = plan_stages(LiveOptions(scene, resolution=(width, height), threads=1, quality=quality))
    tracer = PathTracer(stages.world, replace(stages.render, light_hz=_ONCE_HZ))
    frame = Frame(page_aligned((len(tracer.names), height, width)), tracer.names)
    rays, seconds = [], []
    for index in range(frames + 2):
        before, start = tracer.first_hit_rays, time.process_time()
        tracer.fill(index, frame)
        seconds.append(time.process_time() - start)
        rays.append(tracer.first_hit_rays - before)
    pixels = width * height
    return {
        "rays": statistics.median(rays[2:]) / pixels,
        "us": statistics.median(seconds[2:]) / pixels * 1e6,
        "search": pixels / cpu_seconds(search_of(stages.world)[0]) / 1e6,
    }


def search_of(world: Any) -> tuple[Callable[[], None], Any, Any, Any]:
    """Return a search of one ray a pixel, their origins and directions ``[pixels, 3]``, and the distances it finds."""
    import warp as wp

    from clsim.bench.throughput.rays import aim, build_searches
    from clsim.render import RenderOptions, SceneData
    from clsim.render.camera.camera import CameraData

    features = RenderOptions().features_of(world)
    data = SceneData(world, tree="bvh16")
    width, pixels = world.camera.width, world.camera.width * world.camera.height
    origins, directions = (wp.zeros(pixels, dtype=wp.vec3, device="cpu") for _ in range(2))
    camera = CameraData(world.camera, features, data.origin_m, wp.get_device("cpu")).at(0.0)
    wp.launch(aim, dim=pixels, inputs=[camera, width], outputs=[origins, directions], device="cpu")
    nearest, *_ = build_searches(features, "bvh16")
    out = [wp.zeros(pixels, dtype=wp.float32, device="cpu"), wp.zeros(pixels, dtype=wp.int32, device="cpu")]
    inputs = [data.scene.geometry, origins, directions]
    launch: Any = wp.launch(nearest, dim=pixels, inputs=inputs, outputs=out, device="cpu", record_cmd=True)

    def again(data: Any = data) -> None:
        """Search; it holds the scene that is searched."""
        launch.launch()

    return again, origins.numpy(), directions.numpy(), out[0].numpy()


def cpu_seconds(work: Callable[[], None]) -> float:
    """Return the median of a few calls."""
    spent = []
    for _ in range(9):
        start = time.process_time()
        work()
        spent.append(time.process_time() - start)
    return statistics.median(spent)


if __name__ == "__main__":
    main()
