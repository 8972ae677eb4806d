"""How fast and how noisy the renderer is in a scene file, and other renderers in the same."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.bench.throughput.render import MAX_DEPTH, take_turns
from clsim.frames import Frame, page_aligned
from clsim.render import PathTracer, RenderOptions
from clsim.render.device.devices import start_warp
from clsim.scene import World

WIDTH = 160
"""Of the picture [pixels]; its height is by the scene's own camera."""
ROULETTE = 5
"""Edges after which roulette may end a path, as in Mitsuba where nothing is said."""
Render = Callable[[int], npt.NDArray[np.floating[Any]]]
"""Renders one picture by a seed and returns its radiance."""


def scene_throughput(
    scene: World, *, spp: int = 32, rounds: int = 3, others: Mapping[str, Render] | None = None
) -> dict[str, dict[str, float]]:
    """Measure the first frame of a scene, paths of 8 edges at most, without all that comes before the first picture.

    Args:
        scene: what to render, in a picture of the bench's width.
        spp: paths a pixel.
        rounds: pictures of each renderer, in turns; of processor seconds, which are those of all threads, the median
            counts.
        others: renderers by name, of the same picture with as many paths.

    Returns:
        By renderer, ours being "clsim": ``paths_per_cpu_second``; ``mean_radiance``; ``relative_noise``: the RMSE of a
        picture over its mean, by two seeds; and ``efficiency``, which does not hang on ``spp``: 1 over the processor
        seconds of a pixel times its relative variance.
    """
    start_warp()
    world = narrow(scene)
    tracers = [_tracer(world, spp, seed) for seed in range(2)]
    renders: dict[str, Render] = {"clsim": lambda seed: _picture(tracers[seed]), **(others or {})}
    paths = world.camera.width * world.camera.height * spp
    figures: dict[str, dict[str, float]] = {
        key: {} for key in ("paths_per_cpu_second", "mean_radiance", "relative_noise", "efficiency")
    }
    for name, render in renders.items():
        first, second = (np.asarray(render(seed), np.float64) for seed in range(2))
        mean = float((first + second).mean() / 2)
        figures["mean_radiance"][name] = mean
        figures["relative_noise"][name] = float(np.sqrt(((first - second) ** 2).mean() / 2)) / max(mean, 1e-30)
    _, cpu = take_turns({name: [partial(render, 0)] for name, render in renders.items()}, rounds)
    for tracer in tracers:
        tracer.close()
    for name, seconds in cpu.items():
        figures["paths_per_cpu_second"][name] = paths / seconds
        variance = max(figures["relative_noise"][name] ** 2, 1e-30)
        figures["efficiency"][name] = paths / spp / (seconds * variance)
    return figures


def narrow(world: World) -> World:
    """Return the world seen by a camera of the bench's width."""
    height = round(WIDTH * world.camera.height / world.camera.width)
    return replace(world, camera=replace(world.camera, width=WIDTH, height=height))


def _tracer(world: World, spp: int, seed: int) -> PathTracer:
    # With common noise a picture in which nothing has moved would not be rendered again.
    options = RenderOptions(spp=spp, seed=seed, max_depth=MAX_DEPTH, roulette_start=ROULETTE, noise="independent")
    return PathTracer(world, options)


def _picture(tracer: PathTracer) -> npt.NDArray[np.float32]:
    frame = Frame(page_aligned((len(tracer.names), tracer.height, tracer.width)), tracer.names)
    tracer.fill(0, frame)
    return frame.planes[:3]
