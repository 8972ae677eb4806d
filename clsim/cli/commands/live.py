"""``clsim live``: a scene becomes a live event stream."""

from __future__ import annotations

import contextlib
import socket
from typing import TYPE_CHECKING, Annotated

import typer

from clsim.cli.options.config import live_options
from clsim.cli.options.shared import (
    CAMERA_PATH,
    CONFIDENCE,
    CONFIG,
    DURATION,
    EVENT_RULE,
    FORMAT,
    FPS,
    FRAME_COUNT,
    FRAME_RATE,
    FRAMES,
    GATE,
    HISTORY,
    JSON,
    LABELS,
    LOOP,
    MAX_DEPTH,
    METHOD,
    NOISE,
    OPENCL,
    OUT_HELP,
    PACE,
    QUALITY,
    RENDER_DEVICE,
    RESOLUTION,
    ROS_EVENTS,
    SAMPLING,
    SCENE,
    SEED,
    SENSOR,
    SPP,
    STRICT,
    TEXT_TIME,
    THREADS,
    THRESHOLD,
    TIME,
    TIME_TOLERANCE,
    TRUTH,
    WINDOW,
)
from clsim.cli.output.watch import PORT, VIEW, View, attach, check, default_view, reserve
from clsim.errors import InputError

if TYPE_CHECKING:
    from clsim.live.options import LiveOptions
    from clsim.live.session import Session


def live(
    scene: SCENE = None,
    out: Annotated[list[str] | None, typer.Option(help=OUT_HELP)] = None,
    view: VIEW = None,
    duration: DURATION = None,
    loop: LOOP = None,
    fps: FPS = None,
    resolution: RESOLUTION = None,
    camera_path: CAMERA_PATH = None,
    threshold: THRESHOLD = None,
    sensor: SENSOR = None,
    quality: QUALITY = None,
    time: TIME = None,
    pace: PACE = None,
    seed: SEED = None,
    truth: TRUTH = None,
    config: CONFIG = None,
    as_json: JSON = False,
    frames: FRAMES = None,
    labels: LABELS = None,
    format: FORMAT = None,
    text_time: TEXT_TIME = None,
    ros_events: ROS_EVENTS = None,
    frame_rate: FRAME_RATE = None,
    port: PORT = None,
    frame_count: FRAME_COUNT = None,
    spp: SPP = None,
    sampling: SAMPLING = None,
    method: METHOD = None,
    gate: GATE = None,
    event_rule: EVENT_RULE = None,
    window: WINDOW = None,
    history: HISTORY = None,
    confidence: CONFIDENCE = None,
    noise: NOISE = None,
    time_tolerance: TIME_TOLERANCE = None,
    max_depth: MAX_DEPTH = None,
    threads: THREADS = None,
    render_device: RENDER_DEVICE = None,
    opencl: OPENCL = None,
    strict: STRICT = None,
) -> int:
    """Turn a scene into a live event stream.

    Example: `clsim live two-boxes --out events.aedat4 --out tcp://127.0.0.1:7777 --loop`
    """
    given = dict(locals())
    outputs = tuple(out or ())
    if view is None:
        view = default_view(outputs, as_json=as_json)
    _check_standard_output(outputs, view, as_json)
    about_the_command = ("out", "view", "port", "as_json")
    settings = {name: value for name, value in given.items() if name not in about_the_command}
    options = live_options(settings | {"outputs": outputs or None})
    check(view, as_json=as_json)
    if any("{camera}" in name for name in outputs):
        from clsim.cli.output.rig import run_rig

        return run_rig(_open_rig(options, view), as_json=as_json)
    from clsim.cli.output.status import INTERRUPTED, run_session

    try:
        session, listener = _open(options, view, port)
    except KeyboardInterrupt:
        typer.echo("clsim: interrupted before it began", err=True)
        return INTERRUPTED
    if not outputs and (config is not None or (view == "none" and not as_json)):
        why = "--config repeats a run, but not its outputs; " if config is not None else ""
        typer.echo(f"clsim: no events are written: {why}give --out", err=True)
    screen = attach(session, view, port, listener, as_json=as_json)
    return run_session(session, as_json=as_json, screen=screen)


def _check_standard_output(outputs: tuple[str, ...], view: View, as_json: bool) -> None:
    """Refuse two things that both write to standard output."""
    from clsim.events.sockets.address import is_standard_output

    if any(map(is_standard_output, outputs)):
        for taken, option in ((as_json, "--json"), (view == "terminal", "--view terminal")):
            if taken:
                raise InputError(f"{option} and --out - would both write to standard output; give --out a file instead")


def _open_rig(options: LiveOptions, view: View) -> list[Session]:
    """Return a session for each camera of a rig."""
    from clsim.live.rig import open_rig

    if view not in ("none", "terminal"):
        raise InputError(f"--view {view} shows one camera; watch those of a rig by their own outputs")
    return open_rig(options)


def _open(options: LiveOptions, view: View, port: str | None) -> tuple[Session, socket.socket | None]:
    """Return the session, and where the page will be served; nothing stays open if either fails."""
    from clsim.live.session import open_live

    with contextlib.ExitStack() as undo:
        listener = reserve(view, port)
        if listener is not None:
            undo.callback(listener.close)
        session = open_live(options)
        undo.pop_all()
    return session, listener
