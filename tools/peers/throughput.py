"""Measure what `clsim bench throughput` measures, with plain numpy and Mitsuba 3 beside it.

    python -m tools.peers.throughput
    python -m tools.peers.throughput living-room/scene_mi3.xml staircase/scene.xml

Prints JSON: fits per processor second of numpy and of the kernels, paths per second of both renderers; with Mitsuba's
scene files, paths per processor second and noise of both in these, without what comes before the first picture.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from time import process_time
from typing import Any

import numpy as np

from clsim.bench.throughput.detect import detect_throughput, noise_frame
from clsim.bench.throughput.render import MAX_DEPTH, measure_world
from clsim.bench.throughput.render_worlds import bumpy_room, cornell
from clsim.bench.throughput.scene import scene_throughput
from clsim.frames import Frame
from clsim.render.device.devices import start_warp
from clsim.scene import World, load_world
from tools.accuracy.validation_render import mitsubas_scene
from tools.peers.mitsuba_scene import mitsuba_scene
from tools.peers.mitsuba_variant import load_mitsuba
from tools.peers.plain_wlr import cut_window, solve_window

WINDOW = 13
SIDE = 24
"""Side of the picture whose pixels numpy fits [pixels]."""


def numpy_fits_per_cpu_second(side: int = SIDE, window: int = WINDOW, rounds: int = 3) -> float:
    """Return how many windows of noise plain numpy fits in a second of processor time, at best of some rounds."""
    frame = noise_frame(side, side)
    seconds = []
    for _ in range(rounds):
        start = process_time()
        plain_fits(frame, window)
        seconds.append(process_time() - start)
    return side * side / min(seconds)


def plain_fits(frame: Frame, window: int) -> None:
    """Fit every pixel's window as one would first write it: numpy, one pixel at a time, pseudo-inverse."""
    y = np.log(np.maximum(np.tensordot((0.2126, 0.7152, 0.0722), frame.planes[:3].astype(float), axes=1), 1e-4))
    ys, xs = np.mgrid[0 : frame.height, 0 : frame.width].astype(float)
    x = np.stack([xs, ys, *frame.planes[3:].astype(float)], axis=-1)
    for row in range(frame.height):
        for column in range(frame.width):
            solve_window(cut_window(x, y, row, column, window), "gaussian")


def beside_mitsuba(world: World, spp: int, rounds: int) -> dict[str, Any]:
    """Measure a world with both renderers in turns; ``mitsuba_ratio`` is our paths per second over Mitsuba's.

    Raises:
        InputError: Mitsuba does not work here or cannot have the world.
    """
    mitsuba = load_mitsuba()
    result = measure_world(world, spp, rounds, {"mitsuba": mitsuba_render(mitsuba, world, spp)})
    for ratio, rate in (("mitsuba_ratio", "paths_per_second"), ("mitsuba_cpu_ratio", "paths_per_cpu_second")):
        result[ratio] = result[rate]["bvh16"] / result[rate]["mitsuba"]
    return result


def mitsuba_render(mitsuba: Any, world: World, spp: int) -> Callable[[], float]:
    """Return what renders the world's start with Mitsuba and returns the mean radiance."""
    scene = mitsuba_scene(mitsuba, world, MAX_DEPTH)
    seeds = iter(range(1 << 30))

    def render() -> float:
        return float(np.array(mitsuba.render(scene, spp=spp, seed=next(seeds)))[..., :3].mean())

    return render


def file_beside_mitsuba(path: str, spp: int, rounds: int) -> dict[str, Any]:
    """Return what `scene_throughput` tells of a scene of Mitsuba's, and our paths and efficiency over Mitsuba's.

    Raises:
        InputError: Mitsuba does not work here.
    """
    mitsuba = load_mitsuba()
    asked = mitsubas_scene(path, spp)
    others = {"mitsuba": lambda seed: np.array(mitsuba.render(**asked, seed=seed))}
    result: dict[str, Any] = {**scene_throughput(load_world(path), spp=spp, rounds=rounds, others=others)}
    for ratio, figure in (("mitsuba_cpu_ratio", "paths_per_cpu_second"), ("mitsuba_efficiency_ratio", "efficiency")):
        result[ratio] = result[figure]["clsim"] / result[figure]["mitsuba"]
    return result


def main() -> None:
    """Measure all of it, or the scenes that are named."""
    start_warp()
    if files := sys.argv[1:]:
        print(json.dumps({file: file_beside_mitsuba(file, spp=32, rounds=3) for file in files}, indent=1))
        return
    ours = float(detect_throughput(window=WINDOW)["fits_per_cpu_second"])
    plain = numpy_fits_per_cpu_second()
    figures: dict[str, Any] = {"numpy_fits_per_cpu_second": plain, "numpy_ratio": ours / plain}
    for name, world in (("cornell", cornell()), ("bumpy-room", bumpy_room())):
        figures[name] = beside_mitsuba(world, spp=16, rounds=3)
    print(json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
