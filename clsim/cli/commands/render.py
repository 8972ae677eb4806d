"""``clsim render``: a scene becomes a sequence of EXR frames."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from clsim.cli.options.config import config_times_us, live_options
from clsim.cli.options.shared import (
    CAMERA_PATH,
    CONFIG,
    DURATION,
    FPS,
    FRAME_COUNT,
    JSON,
    MAX_DEPTH,
    METHOD,
    NOISE,
    OPENCL,
    QUALITY,
    RENDER_DEVICE,
    RENDER_TIMES,
    RESOLUTION,
    SAMPLING,
    SCENE,
    SEED,
    SENSOR,
    SPP,
    STRICT,
    THREADS,
    THRESHOLD,
    TIME_TOLERANCE,
    TRUTH,
    WINDOW,
)
from clsim.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from clsim.frames.exr import ExrWriter
    from clsim.live.rendering import Rendering


def render(
    out: Annotated[Path, typer.Option(help="Folder for the frames; it must hold no EXR files yet.")],
    scene: SCENE = None,
    config: CONFIG = None,
    duration: DURATION = None,
    frame_count: FRAME_COUNT = None,
    fps: FPS = None,
    resolution: RESOLUTION = None,
    camera_path: CAMERA_PATH = None,
    threshold: THRESHOLD = None,
    sensor: SENSOR = None,
    quality: QUALITY = None,
    seed: SEED = None,
    truth: TRUTH = None,
    as_json: JSON = False,
    times: RENDER_TIMES = None,
    time_tolerance: TIME_TOLERANCE = None,
    spp: SPP = None,
    sampling: SAMPLING = None,
    method: METHOD = None,
    window: WINDOW = None,
    noise: NOISE = None,
    max_depth: MAX_DEPTH = None,
    threads: THREADS = None,
    render_device: RENDER_DEVICE = None,
    opencl: OPENCL = None,
    strict: STRICT = None,
) -> int:
    """Render the frames that `clsim live` would render, to EXR files with all their planes.

    `clsim detect` makes the same events of them. Planes of variances are there unless first-hit rays are traced. With
    --times adaptive, between-NNNNNN.npz beside each frame holds what `clsim live --time adaptive` traces before it: x,
    y, time_s, and planes with their names.

    Examples: `clsim render cornell --out frames`, `clsim render cornell --out clean --method esim --spp 512`
    """
    given = dict(locals())
    from rich.console import Console

    from clsim.cli.output.status import INTERRUPTED, say_about_scene
    from clsim.events.sidecar import write_sidecar
    from clsim.frames.exr import ExrWriter
    from clsim.live.outputs.sidecars import scene_from_here

    rendering = _rendering(given)
    if rendering.between and next(out.glob("between-*.npz"), None) is not None:
        raise InputError(f"{out} holds files between-NNNNNN.npz; expected a folder without")
    writer = ExrWriter(out)
    console = Console(stderr=True)
    say_about_scene(console, rendering.notes, rendering.warnings)
    count = rendering.frame_count
    written = _write_frames(rendering, writer, console)
    if written < count:
        print(f"clsim: interrupted; {out} holds {written:,} of {count:,} frames", file=sys.stderr)
        return INTERRUPTED
    write_sidecar(out / "frames.json", rendering.about | scene_from_here(rendering.about, out))
    size = {"width": rendering.width, "height": rendering.height}
    if as_json:
        typer.echo(json.dumps({"frames": count, "out": str(out)} | size))
        return 0
    console.print(
        f"{count} frame{'s' * (count > 1)} of {rendering.width}x{rendering.height} ({rendering.settings}) → {out}",
        highlight=False,
        markup=False,
        emoji=False,
        soft_wrap=True,
    )
    return 0


def _write_frames(rendering: Rendering, writer: ExrWriter, console: Console) -> int:
    """Render all frames, or until Ctrl-C; returns how many were written."""
    import numpy as np
    from rich.progress import track

    frames, count, quiet = rendering.frames_and_requests(), rendering.frame_count, not sys.stderr.isatty()
    written = 0
    with contextlib.suppress(KeyboardInterrupt):
        for frame, requests in track(frames, "rendering", count, console=console, disable=quiet):
            writer.write(frame)
            if rendering.between and frame.index > 0:
                np.savez(writer.folder / f"between-{frame.index:06d}.npz", **requests.as_dict())
            written += 1
    return written


def _rendering(given: Mapping[str, Any]) -> Rendering:
    """Return what renders: at an even rate, or at the times of a file, or of the frames whose sidecar is --config."""
    from clsim.footage.times import read_times_us
    from clsim.live.rendering import Rendering

    times = given["times"]
    settings = {name: value for name, value in given.items() if name not in ("out", "as_json", "times")}
    if times == "adaptive":
        return Rendering(live_options(settings | {"time": "adaptive"}))
    if times is not None and given["time_tolerance"] is not None:
        raise InputError("`time_tolerance` is for `times` adaptive")
    options = live_options(settings)
    evenly = next((name for name in ("fps", "duration", "frame_count") if given[name] is not None), None)
    if times is None:
        times_us = None if given["config"] is None or evenly else config_times_us(given["config"])
    elif evenly:
        raise InputError(f"`times` say when frames are; leave out `{evenly}`")
    else:
        times_us = read_times_us(times, "s")
    if times_us is None:
        return Rendering(options)
    alone = replace(options, fps=None, duration_s=None, frame_count=None, time="fixed", time_tolerance_us=None)
    return Rendering(alone, times_us)
