"""What the user sees of a run: a status line while it lasts, a summary at its end."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.console import Console
from rich.live import Live
from rich.text import Text

from clsim.cli.output.summary import print_losses, print_summary
from clsim.cli.output.words import count_text, events_text, percent_text, real_time_share
from clsim.cli.spelling import as_options
from clsim.events import Exposed, SinkError

if TYPE_CHECKING:
    from clsim.live.outputs.delivery import Output
    from clsim.live.session import Session
    from clsim.live.view.terminal import TerminalScreen

_REFRESH_S = 0.1
_LONG_START_S = 2.0
"""From then on a start is one that compiles kernels: those that are kept load in less."""
_SILENT_S = 1.0
"""From then on the end of a run that was interrupted says what it waits for."""
INTERRUPTED = 130
OUTPUT_FAILED = 1
READER_LEFT = 141
"""As of a program that SIGPIPE ends, which Python ignores."""


def run_session(session: Session, *, as_json: bool, screen: TerminalScreen | None = None) -> int:
    """Run a session to its end or to Ctrl-C, painting the screen if there is one; return the exit status.

    A run whose outputs have all failed ends with a sentence; one whose readers have all left, without a word.
    """
    console = Console(stderr=True)
    _print_start(console, session)
    interrupted, all_ended = False, True
    failure: SinkError | None = None
    try:
        session.start()
        if screen is not None:
            _paint_to_the_end(session, screen)
        elif console.is_terminal:
            with Live(status_line(session), console=console, transient=True, auto_refresh=False) as display:
                while not session.pipeline.wait(_REFRESH_S):
                    display.update(status_line(session), refresh=True)
        else:
            wait_to_the_end(session, console)
    except KeyboardInterrupt:
        interrupted = True
        told = threading.Timer(_SILENT_S, _print_unfinished, (console, session))
        told.start()
        all_ended = session.pipeline.stop()
        told.cancel()
    except SinkError as error:
        failure = error
    session.write_sidecars(complete=not interrupted and failure is None)
    summary = session.summary().as_dict() | {"interrupted": interrupted}
    failed = [output for output in session.pipeline.outputs if output.error is not None]
    unread = bool(failed) and all(output.reader_left for output in failed)
    if failure is None and not (unread and len(failed) == len(session.pipeline.outputs)):
        print_losses(console, summary)
        if not as_json:
            print_summary(console, session, summary)
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


def _print_unfinished(console: Console, session: Session) -> None:
    names = [output.name for output in session.pipeline.outputs if output.on_disk and not output.closed]
    if names:
        _say(console, f"completing {', '.join(names)} …")


def _paint_to_the_end(session: Session, screen: TerminalScreen) -> None:
    try:
        while not session.pipeline.wait(screen.period_s):
            screen.paint(status_line(session).plain, session.pipeline.progress.simulated_us)
    finally:
        screen.close()


def wait_to_the_end(session: Session, console: Console) -> None:
    """Wait without a status line; say once why, where the first frame is long in coming."""
    begun_s, told = time.monotonic(), False
    while not session.pipeline.wait(_REFRESH_S):
        if not told and time.monotonic() - begun_s >= _LONG_START_S:
            told = True
            if session.pipeline.progress.first_frame_s is None:
                _say(console, status_line(session).plain)


def status_line(session: Session) -> Text:
    """Return how far a run has come, in one line."""
    progress, schedule = session.pipeline.progress, session.schedule
    if progress.first_frame_s is None:
        return Text(
            f"{session.name}: starting (new kernels are compiled once, and the first frame takes the most paths) …",
            style="dim",
        )
    summary = session.summary().as_dict()
    total = "" if schedule.total is None else f" of {schedule.time_us(schedule.total - 1) * 1e-6:.2f}"
    share = real_time_share(summary)
    given_up = summary["governor"] and summary["governor"]["given_up"]
    clients = sum(int(o.get("clients", 0)) for o in summary["outputs"])
    lost = sum(int(o.get("dropped_events", 0)) for o in summary["outputs"])
    parts = [
        f"{summary['simulated_s']:.2f}{total} s",
        events_text(summary["events"], short=True),
    ]
    if share is not None:
        parts.append(f"{percent_text(share)} of real time")
    if summary["late_frames"]:
        parts.append(f"{summary['late_frames']} frames late")
    if summary["dropped_frames"]:
        parts.append(f"{summary['dropped_frames']} frames dropped")
    if given_up:
        parts.append(f"gave up: {given_up}")
    if any("clients" in o for o in summary["outputs"]):
        parts.append(f"clients: {clients}" + (f" (missed {count_text(lost)} events)" if lost else ""))
    return Text(" · ".join(parts), style="cyan", no_wrap=True, overflow="ellipsis")


def _print_start(console: Console, session: Session) -> None:
    """Print where the events can be had, and what the user should know before he waits."""
    for output in session.pipeline.outputs:
        if isinstance(output.sink, Exposed) and output.sink.warning:
            _say(console, output.sink.warning, "yellow")
        if output.name.startswith("tcp://"):
            _say(console, f"events at {_served_at(output)}")
    say_about_scene(console, session.notes, session.warnings)


def say_about_scene(console: Console, notes: Sequence[str], warnings: Sequence[str]) -> None:
    """Print what was chosen where a scene leaves it open, and what it asks for and will not get."""
    for note in notes:
        _say(console, note, "dim")
    for sentence in warnings:
        _say(console, sentence, "yellow")


def _say(console: Console, sentence: str, style: str | None = None) -> None:
    console.print(
        f"clsim: {as_options(sentence)}", style=style, highlight=False, markup=False, emoji=False, soft_wrap=True
    )


def _served_at(output: Output) -> str:
    """Return a server's address as its readers take it: with the port that it has, and without the server's options."""
    from clsim.events.sockets.tcp import TcpSink

    host, _, asked = output.name.partition("?")[0].rpartition(":")
    return f"{host}:{output.sink.port if isinstance(output.sink, TcpSink) else asked}"
