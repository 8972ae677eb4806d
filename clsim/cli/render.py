"""``clsim render``: a scene becomes a sequence of EXR frames."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from clsim.cli import parse
from clsim.cli.options import (
    FOLLOW_SPECULAR,
    FPS,
    JSON,
    MAX_DEPTH,
    NOISE,
    RENDER_DEVICE,
    RESOLUTION,
    SAMPLER,
    SCENE,
    SEED,
    SPP,
    STRICT,
    THREADS,
)


def render(
    scene: SCENE,
    out: Annotated[Path, typer.Option(help="Folder for the frames; it must hold no EXR files yet.")],
    frames: Annotated[int | None, typer.Option(help="Number of frames. [the motion]")] = None,
    fps: FPS = None,
    spp: SPP = 8,
    resolution: RESOLUTION = None,
    noise: NOISE = "common",
    sampler: SAMPLER = "pcg",
    follow_specular: FOLLOW_SPECULAR = True,
    seed: SEED = 0,
    max_depth: MAX_DEPTH = 8,
    threads: THREADS = None,
    render_device: RENDER_DEVICE = "cpu",
    strict: STRICT = False,
    as_json: JSON = False,
) -> None:
    """Render a scene to EXR frames with all planes and their variances.

    Example: `clsim render cornell --out frames --frames 24 --spp 64`
    """
    from rich.console import Console
    from rich.progress import track

    from clsim.events.sidecar import write_sidecar
    from clsim.frames import ALL_PLANES, Frame, page_aligned
    from clsim.frames.exr import ExrWriter
    from clsim.live.schedule import plan
    from clsim.live.sidecars import about_camera, camera_pose
    from clsim.render import PathTracer, RenderOptions
    from clsim.scene import load_world

    world = load_world(scene, resolution=None if resolution is None else parse.resolution(resolution), strict=strict)
    schedule = plan(world.duration_s, fps or world.fps, frames=frames)
    options = RenderOptions(
        spp=spp,
        fps=schedule.fps,
        seed=seed,
        noise=noise,
        sampler=sampler,
        follow_specular=follow_specular,
        max_depth=max_depth,
        threads=threads,
        device=render_device,
        variances=True,
        frames=schedule.total,
    )
    writer = ExrWriter(out)
    tracer = PathTracer(world, options)
    frame = Frame(page_aligned((len(ALL_PLANES), tracer.height, tracer.width)), tracer.names)
    console = Console(stderr=True)
    count = schedule.total or 0
    for index in track(range(count), "rendering", console=console, disable=not sys.stderr.isatty()):
        tracer.fill(index, frame)
        writer.write(frame)
    tracer.close()
    times_us = [schedule.time_us(k) for k in range(count)]
    poses = [{"time_us": each, "camera_to_world": camera_pose(world.camera, each * 1e-6).tolist()} for each in times_us]
    about = {"options": {"scene": scene, "spp": spp, "noise": noise, "seed": seed, "max_depth": max_depth}}
    write_sidecar(out / "frames.json", about | {"camera": about_camera(world.camera), "poses": poses})
    if as_json:
        typer.echo(json.dumps({"frames": count, "out": str(out), "width": tracer.width, "height": tracer.height}))
    else:
        console.print(f"{count} frames of {tracer.width}x{tracer.height} at {spp} spp → {out}", highlight=False)
