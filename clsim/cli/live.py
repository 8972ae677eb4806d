"""``clsim live``: a scene becomes a live event stream."""

from __future__ import annotations

import contextlib
from typing import Annotated, Literal

import typer

from clsim.cli import parse
from clsim.cli.config import live_options
from clsim.cli.options import (
    CONFIG,
    DURATION,
    EVENT_RULE,
    FIRST_HIT_RAYS,
    FOLLOW_SPECULAR,
    FORMAT,
    FPS,
    FRAME_COUNT,
    HISTORY,
    JSON,
    MAX_DEPTH,
    METHOD,
    NOISE,
    OPENCL,
    OUT_HELP,
    PROBE_EVERY,
    PROBE_SPP,
    QUALITY,
    RENDER_DEVICE,
    RESOLUTION,
    SAMPLER,
    SAMPLING,
    SCENE,
    SEED,
    SPP,
    STRICT,
    TEXT_TIME,
    THREADS,
    THRESHOLD,
    WINDOW,
    advanced,
)
from clsim.cli.watch import PORT, VIEW, attach, check, default_view, reserve
from clsim.errors import InputError


def live(
    scene: SCENE = None,
    out: Annotated[list[str] | None, typer.Option(help=OUT_HELP)] = None,
    view: VIEW = None,
    duration: DURATION = None,
    loop: Annotated[bool | None, typer.Option("--loop", help="Start the motion anew at its end.")] = None,
    fps: FPS = None,
    resolution: RESOLUTION = None,
    threshold: THRESHOLD = None,
    quality: QUALITY = None,
    pace: Annotated[
        Literal["max", "real"] | None,
        typer.Option(
            help="As fast as it can; or by the wall clock, where a governor renders less while the machine is too "
            "slow. [max]"
        ),
    ] = None,
    seed: SEED = None,
    config: CONFIG = None,
    as_json: JSON = False,
    frames: Annotated[
        bool | None,
        advanced("--frames", help="Frames, in 8-bit sRGB, along with the events in .aedat4 files."),
    ] = None,
    format: FORMAT = None,
    text_time: TEXT_TIME = None,
    port: PORT = None,
    frame_count: FRAME_COUNT = None,
    spp: SPP = None,
    sampling: SAMPLING = None,
    probe_spp: PROBE_SPP = None,
    probe_every: PROBE_EVERY = None,
    first_hit_rays: FIRST_HIT_RAYS = None,
    method: METHOD = None,
    gate: Annotated[
        Literal["radiance", "delta-r"] | None,
        advanced(help="Where esim-ad solves its regression; delta-r is the paper's. [the quality's]"),
    ] = None,
    event_rule: EVENT_RULE = None,
    window: WINDOW = None,
    history: HISTORY = None,
    noise: NOISE = None,
    sampler: SAMPLER = None,
    follow_specular: FOLLOW_SPECULAR = None,
    max_depth: MAX_DEPTH = None,
    governor: Annotated[
        bool | None,
        advanced("--governor/--no-governor", help="With --pace real: render less rather than fall behind. [yes]"),
    ] = None,
    ring: Annotated[
        Literal["block", "drop-oldest"] | None,
        advanced(help="block loses nothing; drop-oldest never waits (with --pace real). [block]"),
    ] = None,
    threads: THREADS = None,
    render_device: RENDER_DEVICE = None,
    opencl: OPENCL = None,
    strict: STRICT = None,
) -> int:
    """Turn a scene into a live event stream.

    Example: `clsim live two-boxes --out events.aedat4 --out tcp://127.0.0.1:7777 --loop`
    """
    from clsim.events.address import is_standard_output

    outputs = tuple(out or ())
    if as_json and any(map(is_standard_output, outputs)):
        raise InputError("--json and --out - would both write to standard output; give --out a file instead")
    options = live_options(
        config,
        {
            "scene": scene,
            "outputs": outputs or None,
            "duration_s": None if duration is None else parse.duration_s(duration),
            "loop": loop,
            "fps": fps,
            "resolution": None if resolution is None else parse.resolution(resolution),
            "threshold": None if threshold is None else parse.threshold(threshold),
            "quality": quality,
            "pace": pace,
            "seed": seed,
            "frame_count": frame_count,
            "spp": spp,
            "sampling": sampling,
            "probe_spp": probe_spp,
            "probe_every": probe_every,
            "first_hit_rays": first_hit_rays,
            "method": method,
            "gate": gate,
            "event_rule": event_rule,
            "window": window,
            "history": history,
            "noise": noise,
            "sampler": sampler,
            "follow_specular": follow_specular,
            "max_depth": max_depth,
            "governor": governor,
            "ring": ring,
            "threads": threads,
            "render_device": render_device,
            "opencl": opencl,
            "strict": strict,
        },
        {"format": format, "text_time": text_time, "frames": frames},
    )
    if governor and options.pace != "real":
        raise InputError("--governor needs --pace real: without a clock to keep, no frame can be late")
    from clsim.cli.status import run_session
    from clsim.live.session import open_live

    if view is None:
        view = default_view(outputs, as_json=as_json)
    if view == "terminal" and any(map(is_standard_output, outputs)):
        raise InputError("--view terminal and --out - would both write to standard output; give --out a file instead")
    check(view, as_json=as_json)
    with contextlib.ExitStack() as undo:
        listener = reserve(view, port)
        if listener is not None:
            undo.callback(listener.close)
        session = open_live(options)
        undo.pop_all()
    if config is not None and not outputs:
        typer.echo("clsim: no events are written: --config repeats a run, but not its outputs; give --out", err=True)
    screen = attach(session, view, port, listener, as_json=as_json)
    return run_session(session, as_json=as_json, screen=screen)
