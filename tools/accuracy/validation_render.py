"""Render a Mitsuba scene by Mitsuba 3 and by clsim, twice each.

python -m tools.accuracy.validation_render SCENE OUT.npz SPP

Both render from the camera that Mitsuba reads, 160 pixels wide, with the box filter, paths of at most 8 edges and
roulette from the 5th on. OUT gets ``ours`` and ``mitsubas``, ``[2, h, w, 3]`` by seed, ``seconds`` of processor time:
rendering and what comes before the first picture, for each, the paths a pixel, and what clsim warns of.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from clsim.bench.throughput.render import MAX_DEPTH
from clsim.bench.throughput.scene import ROULETTE, WIDTH, narrow
from clsim.frames import Frame, page_aligned
from clsim.render import PathTracer, RenderOptions
from clsim.scene import load_world
from tools.peers.mitsuba_files import load_mitsuba_file
from tools.peers.mitsuba_variant import load_mitsuba


def mitsubas_scene(path: str, spp: int) -> dict[str, Any]:
    """Return what Mitsuba's ``render`` takes: the scene, a camera as the file's, and paths."""
    mi = load_mitsuba()
    scene = load_mitsuba_file(mi, Path(path), spp=str(spp))
    values = mi.traverse(scene)
    sensor = next(key.removesuffix("film.size") for key, _ in values.items() if key.endswith("film.size"))
    width, height = values[f"{sensor}film.size"]
    film = {
        "type": "hdrfilm",
        "width": WIDTH,
        "height": round(WIDTH * height / width),
        "rfilter": {"type": "box"},
        "pixel_format": "rgb",
    }
    camera = {
        "type": "perspective",
        "fov": float(values[f"{sensor}x_fov"][0]),
        "fov_axis": "x",
        "to_world": mi.ScalarTransform4f(np.array(values[f"{sensor}to_world"].matrix).reshape(4, 4)),
        "near_clip": 1e-3,
        "film": film,
    }
    paths = {"type": "path", "max_depth": MAX_DEPTH, "rr_depth": ROULETTE}
    return {"scene": scene, "sensor": mi.load_dict(camera), "integrator": mi.load_dict(paths), "spp": spp}


def mitsubas(path: str, spp: int) -> tuple[Any, float, float]:
    """Return pictures of two seeds, and processor seconds of rendering and of what comes before."""
    mi = load_mitsuba()
    start = time.process_time()
    asked = mitsubas_scene(path, spp)
    pictures, spent = [], []
    for seed in range(2):
        pictures.append(np.array(mi.render(**asked, seed=seed)))
        spent.append(time.process_time() - start)
        start = time.process_time()
    return np.stack(pictures), spent[1], max(spent[0] - spent[1], 0.0)


def ours(path: str, spp: int) -> tuple[Any, float, float, tuple[str, ...]]:
    """Return the same, and warnings."""
    start = time.process_time()
    world = narrow(load_world(path))
    height = world.camera.height
    pictures, render_s, start_s = [], 0.0, 0.0
    for seed in range(2):
        options = RenderOptions(spp=spp, seed=seed, max_depth=MAX_DEPTH, roulette_start=ROULETTE)
        tracer = PathTracer(world, options)
        frame = Frame(page_aligned((len(tracer.names), height, WIDTH)), tracer.names)
        if seed == 0:
            start_s = time.process_time() - start
        start = time.process_time()
        tracer.fill(0, frame)
        render_s = time.process_time() - start
        pictures.append(frame.planes[:3].transpose(1, 2, 0).copy())
        tracer.close()
    return np.stack(pictures), render_s, start_s, world.warnings


def main(path: str, out: str, spp: str) -> None:
    """Render, and write what was found."""
    own, own_s, own_start_s, warnings = ours(path, int(spp))
    others, others_s, others_start_s = mitsubas(path, int(spp))
    seconds = np.array([[own_s, own_start_s], [others_s, others_start_s]])
    told = {"seconds": seconds, "warnings": np.array(warnings, str), "spp": np.array(int(spp))}
    np.savez_compressed(out, ours=own, mitsubas=others, **told)


if __name__ == "__main__":
    main(*sys.argv[1:])
