"""What the user sees of a run: a status line while it lasts, a summary at its end."""

from __future__ import annotations

import json
import math
import os
import sys
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.live import Live
from rich.text import Text

from clsim.cli.spelling import as_options
from clsim.events import SinkError

if TYPE_CHECKING:
    from clsim.live.session import Session
    from clsim.live.view.terminal import TerminalScreen

_REFRESH_S = 0.1
_STEEP_SHARE = 0.01
INTERRUPTED = 130
OUTPUT_FAILED = 1
READER_LEFT = 141
"""As of a program that SIGPIPE ends, which Python ignores."""


def run_session(session: Session, *, as_json: bool, screen: TerminalScreen | None = None) -> int:
    """Run a session to its end or to Ctrl-C, painting the screen if there is one; return the exit status.

    A run whose outputs have all failed ends with a sentence; one whose readers have all left, without a word.
    """
    console = Console(stderr=True)
    for output in session.pipeline.outputs:
        warning = getattr(output.sink, "warning", None)
        if warning:
            console.print(f"clsim: {as_options(warning)}", style="yellow", highlight=False)
    for note in session.notes:
        console.print(f"clsim: {as_options(note)}", style="dim", highlight=False)
    for sentence in session.warnings:
        console.print(f"clsim: {as_options(sentence)}", style="yellow", highlight=False)
    session.start()
    interrupted, all_ended = False, True
    failure: SinkError | None = None
    try:
        if screen is not None:
            _paint_to_the_end(session, screen)
        elif console.is_terminal:
            with Live(_status_line(session), console=console, transient=True, auto_refresh=False) as display:
                while not session.pipeline.wait(_REFRESH_S):
                    display.update(_status_line(session), refresh=True)
        else:
            while not session.pipeline.wait(_REFRESH_S):
                pass
    except KeyboardInterrupt:
        interrupted = True
        all_ended = session.pipeline.stop()
    except SinkError as error:
        failure = error
    session.write_sidecars(complete=not interrupted and failure is None)
    summary = session.summary() | {"interrupted": interrupted}
    failed = [output for output in session.pipeline.outputs if output.error is not None]
    unread = bool(failed) and all(output.reader_left for output in failed)
    if failure is None and not (unread and len(failed) == len(session.pipeline.outputs)):
        _print_warnings(console, session, summary)
        if not as_json:
            _print_summary(console, summary)
    elif not unread:
        print(f"clsim: {failure}", file=sys.stderr)
    if as_json:
        print(json.dumps(summary), flush=True)
    status = INTERRUPTED if interrupted else READER_LEFT if unread else OUTPUT_FAILED if failed else 0
    if not all_ended:
        # A thread is still inside a compiler; the files are closed, so nothing is lost by not waiting for it.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    return status


def _paint_to_the_end(session: Session, screen: TerminalScreen) -> None:
    try:
        while not session.pipeline.wait(screen.period_s):
            screen.paint(_status_line(session).plain, session.pipeline.progress.simulated_us)
    finally:
        screen.close()


def _status_line(session: Session) -> Text:
    progress, schedule = session.pipeline.progress, session.schedule
    if progress.first_frame_s is None:
        return Text(f"{session.name}: building kernels …", style="dim")
    total = "" if schedule.total is None else f"/{schedule.time_us(schedule.total - 1) * 1e-6:.2f}"
    summary = session.summary()
    simulated_s = max(summary["simulated_s"], 1e-9)
    clients = sum(int(o.get("clients", 0)) for o in summary["outputs"])
    lost = sum(int(o.get("dropped_events", 0)) for o in summary["outputs"])
    parts = [
        f"t {summary['simulated_s']:.3f}{total} s",
        f"{summary['frames_per_s']:.1f} frames/s",
        f"{_count(summary['events'])} events",
        f"{_count(summary['events'] / simulated_s)} events/s simulated",
        *([] if summary["solved_share"] is None else [f"solved {summary['solved_share']:.0%}"]),
        f"ring {progress.fill}",
        f"drops {summary['dropped_frames']}",
    ]
    if summary["late_frames"]:
        parts.append(f"late {summary['late_frames']}")
    given_up = summary["governor"] and summary["governor"]["given_up"]
    if given_up:
        parts.append(f"gave up: {given_up}")
    if any("clients" in o for o in summary["outputs"]):
        parts.append(f"clients {clients}" + (f" (lost {_count(lost)})" if lost else ""))
    return Text("  ".join(parts), style="cyan", no_wrap=True, overflow="ellipsis")


def _print_summary(console: Console, summary: dict[str, Any]) -> None:
    simulated_s, wall_s = summary["simulated_s"], summary["wall_s"]
    console.print(
        f"[bold]{summary['name']}[/] {summary['width']}x{summary['height']}: "
        f"[bold]{summary['events']:,} events[/] ({summary['on_events']:,} on) in {simulated_s:.3f} s simulated, "
        f"{summary['frames']:,} frames in {wall_s:.1f} s ({summary['frames_per_s']:.1f} frames/s after a start of "
        f"{summary['startup_s'] or 0:.1f} s)",
        highlight=False,
    )
    solved = summary["solved_share"]
    console.print(
        ("" if solved is None else f"solved {solved:.1%} of the pixels, ")
        + f"{summary['dropped_frames']} frames dropped, "
        f"{summary['cpu_s']:.1f} CPU-seconds" + (" — interrupted" if summary["interrupted"] else ""),
        highlight=False,
    )
    governor = summary["governor"]
    if governor is not None:
        console.print(
            f"governor: gave up {governor['given_up'] or 'nothing'} ({governor['changes']} changes), "
            f"{summary['late_frames']} frames late",
            highlight=False,
        )
    for output in summary["outputs"]:
        console.print(f"→ {output['name']}" + (f": {output['error']}" if "error" in output else ""), highlight=False)


def _print_warnings(console: Console, session: Session, summary: dict[str, Any]) -> None:
    """Tell what a user should know of the events: too coarse a time step, bad pixels, events cut off."""
    steep, masked, capped = summary["steep_pixels"], summary["masked_pixels"], summary["capped_events"]
    if steep > _STEEP_SHARE * max(summary["events"], 1):
        console.print(
            f"clsim: {steep:,} times a pixel crossed more than 3 thresholds in one frame step, once "
            f"{summary['most_crossings']:,}, and brightness between frames is taken to be linear; where it is smooth, "
            f"--fps {session.schedule.fps * math.ceil(summary['most_crossings'] / 3):g} would keep it to 3 a step, but "
            "where a sharp edge passes no rate does",
            style="yellow",
            highlight=False,
        )
    governor = summary["governor"]
    if governor is not None and governor["too_slow"] and summary["late_frames"] + summary["dropped_frames"]:
        console.print(
            f"clsim: too slow for {session.schedule.fps:g} fps even at the lowest level: try a smaller --resolution "
            "or a lower --fps",
            style="yellow",
            highlight=False,
        )
    if masked:
        console.print(f"clsim: {masked:,} NaN or infinite pixels were masked", style="yellow", highlight=False)
    if capped:
        console.print(
            f"clsim: {capped:,} events beyond 1000 per pixel and step were not written; the threshold is too low",
            style="yellow",
            highlight=False,
        )


def _count(value: float) -> str:
    for limit, unit in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= limit:
            return f"{value / limit:.1f} {unit}"
    return f"{value:.0f}"
