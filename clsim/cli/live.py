"""``clsim live``: a scene becomes a live event stream."""

from __future__ import annotations

import contextlib
from typing import Annotated, Literal

import typer

from clsim.cli import parse
from clsim.cli.options import (
    FIRST_HIT_RAYS,
    FOLLOW_SPECULAR,
    FORMAT,
    FPS,
    HISTORY,
    JSON,
    LIVE_EVENT_RULE,
    LIVE_METHOD,
    LIVE_NOISE,
    LIVE_SAMPLER,
    LIVE_SPP,
    LIVE_WINDOW,
    MAX_DEPTH,
    OPENCL,
    OUT_HELP,
    PROBE_EVERY,
    PROBE_SPP,
    QUALITY,
    RENDER_DEVICE,
    RESOLUTION,
    SAMPLING,
    SCENE,
    SEED,
    STRICT,
    TEXT_TIME,
    THREADS,
    THRESHOLD,
)
from clsim.cli.watch import PORT, VIEW, attach, check, default_view, reserve
from clsim.errors import InputError


def live(
    scene: SCENE,
    out: Annotated[list[str] | None, typer.Option(help=OUT_HELP)] = None,
    frames: Annotated[
        bool,
        typer.Option(
            "--frames", help="Frames, in 8-bit sRGB, along with the events in .aedat4 files (needs the [dv] extra)."
        ),
    ] = False,
    format: FORMAT = None,
    text_time: TEXT_TIME = None,
    duration: Annotated[str | None, typer.Option(help="Simulated time, such as 2s or 500ms. [the motion]")] = None,
    frame_count: Annotated[int | None, typer.Option(help="Number of frames, instead of a duration.")] = None,
    loop: Annotated[bool, typer.Option("--loop", help="Start the motion anew at its end.")] = False,
    fps: FPS = None,
    quality: QUALITY = None,
    spp: LIVE_SPP = None,
    sampling: SAMPLING = None,
    probe_spp: PROBE_SPP = None,
    probe_every: PROBE_EVERY = None,
    first_hit_rays: FIRST_HIT_RAYS = None,
    resolution: RESOLUTION = None,
    threshold: THRESHOLD = None,
    method: LIVE_METHOD = None,
    gate: Annotated[
        Literal["radiance", "delta-r"] | None,
        typer.Option(help="Where the fit is solved; delta-r is the paper's. [radiance]"),
    ] = None,
    event_rule: LIVE_EVENT_RULE = None,
    window: LIVE_WINDOW = None,
    history: HISTORY = 1,
    noise: LIVE_NOISE = None,
    sampler: LIVE_SAMPLER = None,
    follow_specular: FOLLOW_SPECULAR = True,
    seed: SEED = 0,
    max_depth: MAX_DEPTH = 8,
    threads: THREADS = None,
    pace: Annotated[
        Literal["max", "real"],
        typer.Option(
            help="As fast as it can; or by the wall clock: then from --quality balanced, unless another is given (with "
            "--sampling uniform, if --noise independent or --first-hit-rays 0 is), and with a governor, which renders "
            "less while the machine is too slow (up to --spp, and never more)."
        ),
    ] = "max",
    governor: Annotated[
        bool | None,
        typer.Option("--governor/--no-governor", help="With --pace real: render less rather than fall behind. [yes]"),
    ] = None,
    ring: Annotated[
        Literal["block", "drop-oldest"],
        typer.Option(help="block loses nothing; drop-oldest never waits (with --pace real)."),
    ] = "block",
    render_device: RENDER_DEVICE = "cpu",
    opencl: OPENCL = None,
    strict: STRICT = False,
    view: VIEW = None,
    port: PORT = None,
    as_json: JSON = False,
) -> int:
    """Turn a scene into a live event stream.

    Example: `clsim live two-boxes --out events.aedat4 --out tcp://127.0.0.1:7777 --loop`
    """
    from clsim.events.address import is_standard_output
    from clsim.events.outputs import FileOptions
    from clsim.live.options import LiveOptions

    outputs = tuple(out or ())
    if as_json and any(map(is_standard_output, outputs)):
        raise InputError("--json and --out - would both write to standard output; give --out a file instead")
    if governor and pace != "real":
        raise InputError("--governor needs --pace real: without a clock to keep, no frame can be late")
    options = LiveOptions(
        scene=scene,
        strict=strict,
        duration_s=None if duration is None else parse.duration_s(duration),
        frame_count=frame_count,
        loop=loop,
        fps=fps,
        quality=quality,
        spp=spp,
        sampling=sampling,
        probe_spp=probe_spp,
        probe_every=probe_every,
        first_hit_rays=first_hit_rays,
        resolution=None if resolution is None else parse.resolution(resolution),
        threshold=None if threshold is None else parse.threshold(threshold),
        method=method,
        gate=gate,
        event_rule=event_rule,
        window=window,
        history=history,
        noise=noise,
        sampler=sampler,
        follow_specular=follow_specular,
        seed=seed,
        max_depth=max_depth,
        threads=threads,
        pace=pace,
        governor=governor is not False,
        ring=ring,
        render_device=render_device,
        opencl=opencl,
        outputs=outputs,
        files=FileOptions(format, text_time, frames),
    )
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
    screen = attach(session, view, port, listener, as_json=as_json)
    return run_session(session, as_json=as_json, screen=screen)
