"""``clsim view``: recordings and streams as something to look at."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast

import typer

from clsim.cli.options import parse
from clsim.cli.options.shared import SENSOR_SIZE, STRICT_ORDER
from clsim.cli.output.watch import PORT, announce, check, host_and_port
from clsim.cli.output.words import dropped_text, events_text
from clsim.errors import InputError
from clsim.events import CAUSES
from clsim.events.color_filter import FILTERS, sidecar_color_filter, with_filters
from clsim.events.sockets.address import is_address
from clsim.truth.recording import recording_kind

if TYPE_CHECKING:
    from clsim.events import EventBatch, Sink
    from clsim.events.formats.filesource import EventSource
    from clsim.events.sockets.stream_source import SocketSource
    from clsim.live.view.playback import TimedImages
    from clsim.live.view.truth_pictures import Shown

_MOST_FPS = 1000.0
"""Pictures per second of a video: more are no video, and would take for ever."""


def view(
    events: Annotated[
        str, typer.Argument(help="An event file, tcp://HOST:PORT, unix://PATH or udp://HOST:PORT?size=WIDTHxHEIGHT.")
    ],
    where: Annotated[
        Literal["web", "terminal", "rerun"],
        typer.Option("--view", help="In the browser (the [view] extra), the terminal, or rerun (the [rerun] extra)."),
    ] = "web",
    port: PORT = None,
    to: Annotated[
        str | None, typer.Option(help="Write a video or picture instead: NAME.mp4 (the [video] extra), .gif or .png.")
    ] = None,
    accumulate: Annotated[
        str, typer.Option(help="Time whose events share a picture, such as 33ms; a bare number is seconds.")
    ] = "33ms",
    decay: Annotated[bool, typer.Option("--decay", help="Let events fade within that time, not end at it.")] = False,
    contrast: Annotated[float, typer.Option(help="Events in a pixel that give the strongest colour.")] = 2.0,
    colours: Annotated[
        Literal["blue-orange", "purple-green", "violet-yellow", "grey", "cause", "filter"] | None,
        typer.Option(
            "--colours",
            "--colors",
            help="Colours of OFF and ON, each pair for the colour-blind too; or of what caused each event, in files "
            "written with --labels; or of colour filters, where there were some. [blue-orange, filter]",
        ),
    ] = None,
    theme: Annotated[Literal["dark", "light"], typer.Option(help="Ground of the picture.")] = "dark",
    zoom: Annotated[int, typer.Option(help="Side of a sensor pixel in the picture.", min=1, max=16)] = 2,
    video_fps: Annotated[float, typer.Option(help="Pictures per second of the video.")] = 30.0,
    speed: Annotated[float, typer.Option(help="Seconds of events in a second: 0.1 is slow motion.")] = 1.0,
    at: Annotated[
        str | None, typer.Option(help="Time of a .png, such as 0.5s; a bare number is seconds. [where most happens]")
    ] = None,
    show: Annotated[
        Literal["image", "depth", "flow", "ids"] | None,
        typer.Option(help="Of a recording with truth, what the page shows beside the events. [image]"),
    ] = None,
    resolution: SENSOR_SIZE = None,
    strict: STRICT_ORDER = False,
) -> int:
    """Look at an event file or a live stream.

    Examples: `clsim view events.aedat4`, `clsim view tcp://127.0.0.1:7777`, `clsim view events.aedat4 --to film.mp4`
    """
    from clsim.events.open import open_events

    for option, value in (("--video-fps", video_fps), ("--speed", speed), ("--contrast", contrast)):
        if not 0 < value < float("inf"):
            raise InputError(f"{option} must be a positive number, got {value}")
    if video_fps > _MOST_FPS:
        raise InputError(f"--video-fps must be at most {_MOST_FPS:g}, got {video_fps:g}; --speed shows slow motion")
    if at is not None and (to is None or Path(to).suffix.lower() != ".png"):
        raise InputError("--at is the time of a picture, so it needs --to NAME.png")
    if show is not None and (is_address(events) or recording_kind(events) is None):
        raise InputError(f"--show is for recordings with truth, but {events} is none")
    if show is not None and (to is not None or where != "web"):
        raise InputError("--show says what the page shows, so it goes with neither --to nor another --view")
    if to is None:
        check(where)
        if colours in ("cause", "filter") and where != "web":
            raise InputError(f"--colours {colours} is for the page and for --to, got --view {where}")
    pattern = _pattern(events, colours)
    with open_events(events, labels=("cause",) if colours == "cause" else (), strict=strict) as source:
        size = _size(events, source, None if resolution is None else parse.resolution(resolution))
        if to is not None:
            from clsim.live.view.colormaps import DEFAULT
            from clsim.live.view.picture import Film, Look, write_picture

            accumulate_us = max(1, round(parse.duration_s(accumulate, "--accumulate") * 1e6))
            look = Look(accumulate_us, decay, contrast, colours or ("filter" if pattern else DEFAULT), theme, zoom)
            at_us = None if at is None else round(parse.duration_s(at, "--at") * 1e6)
            times = _Times()
            count = write_picture(to, times.of(_coloured(source, pattern)), size, look, Film(video_fps, speed), at_us)
            if at_us is None and accumulate_us > times.span_us:
                _warn(f"--accumulate {accumulate} is longer than the recording, {times.span_us * 1e-6:g} s")
            typer.echo(f"{to}: {count} picture{'s' * (count > 1)}", err=True)
            if source.dropped_events:
                _warn(f"{events}: {dropped_text(source.dropped_events)}")
        elif where == "terminal":
            _in_terminal(events, source, size, speed)
        elif where == "rerun":
            from clsim.live.view.rerun import RerunSink

            _pump(source, RerunSink(events, *size))
        elif where == "web":
            _in_page(events, source, size, port, show, colours, strict, pattern)
    return 0


def _pattern(name: str, colours: str | None) -> str | None:
    """Return the pattern of the filters to colour events by; None where that is not wanted, or there are none."""
    if colours not in (None, "filter"):
        return None
    pattern = None if is_address(name) else sidecar_color_filter(name)
    if pattern is None and colours == "filter":
        raise InputError(f"{name}: no sidecar tells of a color_filter, which --colours filter shows")
    return pattern


def _coloured(source: EventSource | SocketSource, pattern: str | None) -> Iterable[EventBatch]:
    """Return the batches; with the filter of each event where there are filters."""
    return source if pattern is None else with_filters(cast("EventSource", source), pattern)


def _size(name: str, source: EventSource | SocketSource, given: tuple[int, int] | None) -> tuple[int, int]:
    """Return the sensor's size; one that the user gives must hold what is there."""
    from clsim.events.open import least_size, sensor_size

    if given is None:
        return sensor_size(name, source, None)
    least = least_size(name, source)
    if given[0] < least[0] or given[1] < least[1]:
        raise InputError(
            f"--resolution {given[0]}x{given[1]} is too small for {name}, which needs {least[0]}x{least[1]}"
        )
    return given


class _Times:
    """Notes the span of time that passing events cover."""

    def __init__(self) -> None:
        self._first_us: int | None = None
        self._last_us = 0

    def of(self, batches: Iterable[EventBatch]) -> Iterator[EventBatch]:
        for batch in batches:
            if len(batch):
                self._first_us = int(batch["t"][0]) if self._first_us is None else self._first_us
                self._last_us = int(batch["t"][-1])
            yield batch

    @property
    def span_us(self) -> int:
        return 0 if self._first_us is None else self._last_us - self._first_us


def _in_page(
    name: str,
    source: EventSource | SocketSource,
    size: tuple[int, int],
    port: str | None,
    show: Shown | None,
    colours: str | None,
    strict: bool,
    pattern: str | None,
) -> None:
    """Serve the page until Ctrl-C or, for a stream, its end."""
    from clsim.events.formats.filesource import EventSource

    if not isinstance(source, EventSource):
        from clsim.live.view.sink import ViewSink

        page = ViewSink(name, *size, **host_and_port(port))
        _warn(page.warning)
        announce(page.url)
        _pump(source, page)
        return
    from clsim.events.files import open_source, read_format_of, split_topic
    from clsim.live.view.player import Player

    source.close()
    frames: Callable[[], TimedImages] | None = None
    frames_are = "recorded frame"
    if recording_kind(name) is not None:
        from clsim.live.view.truth_pictures import CAPTIONS, recorded_pictures

        frames, frames_are = partial(recorded_pictures, name, show or "image"), CAPTIONS[show or "image"]
    elif read_format_of(split_topic(name)[0]).name == "aedat4":
        from clsim.events.formats.aedat4 import read_frames

        frames = partial(read_frames, Path(name))
    causes = "cause" in source.labelled and pattern is None
    kinds = {"filters": FILTERS} if pattern else {"causes": CAUSES} if causes else {}
    opened = partial(open_source, name, labels=("cause",) if causes else (), strict=strict)
    player = Player(
        (lambda: with_filters(opened(), pattern)) if pattern else opened,
        Path(name).name,
        *size,
        **host_and_port(port),
        read_frames=frames,
        kinds=kinds,
        colours=colours or ("filter" if pattern else None),
        frames_are=frames_are,
    )
    _warn(player.warning)
    announce(player.url)
    try:
        while True:
            player.wait(1.0)
    finally:
        player.close()


def _in_terminal(name: str, source: EventSource | SocketSource, size: tuple[int, int], speed: float) -> None:
    from clsim.live.view.pump import Pump, as_they_come, paced
    from clsim.live.view.terminal import TerminalScreen, TerminalView

    title = name if is_address(name) else Path(name).name
    view = TerminalView(*size)
    screen = TerminalScreen(view, sys.stdout)
    pump = Pump(as_they_come(source) if is_address(name) else paced(source, speed), view)
    try:
        while not pump.wait(screen.period_s):
            screen.paint(f"{title}  t {pump.now_us * 1e-6:.3f} s  {events_text(pump.events)}", pump.now_us)
    finally:
        screen.close()
        pump.stop()


def _pump(source: EventSource | SocketSource, sink: Sink) -> None:
    from clsim.live.view.pump import Pump, as_they_come

    pump = Pump(as_they_come(source), sink)
    try:
        while not pump.wait(0.2):
            pass
    finally:
        source.close()
        pump.stop()


def _warn(warning: str | None) -> None:
    if warning is not None:
        typer.echo(f"clsim: {warning}", err=True)
