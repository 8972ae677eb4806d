"""``--view``: where events can be watched, for the commands that have any."""

from __future__ import annotations

import os
import socket
import sys
import threading
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, Literal, TextIO, get_args

import typer
from typer.core import TyperCommand

from clsim.cli.options.shared import advanced
from clsim.cli.output.words import real_time_share
from clsim.errors import InputError

if TYPE_CHECKING:
    from clsim.live.session import Session
    from clsim.live.view.terminal import TerminalScreen

View = Literal["web", "terminal", "rerun", "none"]
VIEW = Annotated[
    View | None,
    typer.Option(
        help="Watch the events: in a page of the browser (what --view alone means; needs the [view] extra), "
        "in the terminal, in rerun (the [rerun] extra), or not at all."
    ),
]
PORT = Annotated[
    str | None,
    advanced(help="Port of the page; HOST:PORT opens it to other machines. [8787 or a free one, for this machine]"),
]


class BareViewCommand(TyperCommand):
    """A command whose ``--view`` may stand alone; typer knows no options with an optional value."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Write the missing ``web`` behind a bare ``--view``."""
        complete: list[str] = []
        for position, word in enumerate(args):
            complete.append(word)
            if word == "--":
                complete += args[position + 1 :]
                break
            if word == "--view" and args[position + 1 : position + 2] not in [[view] for view in get_args(View)]:
                complete.append("web")
        try:
            return super().parse_args(ctx, complete)
        except Exception as error:
            # A word too many, and one behind a bare --view: that is a view misspelt.
            meant = [word for last, word in pairwise(args) if last == "--view" and not word.startswith("-")]
            if "unexpected extra argument" in str(error) and meant and meant[0] not in get_args(View):
                raise InputError(f"--view must be one of {', '.join(get_args(View))}, got {meant[0]!r}") from None
            raise


def host_and_port(text: str | None) -> dict[str, Any]:
    """Return the arguments host and port for ``8080`` or ``0.0.0.0:8080``; None leaves the usual ones."""
    if text is None:
        return {}
    host, _, port = text.rpartition(":")
    if not (port.isascii() and port.isdigit() and len(port) <= 5 and int(port) <= 65535):
        raise InputError(f"--port must be a port within 0 … 65535, or HOST:PORT, got {text!r}")
    return {"host": host.strip("[]") or "127.0.0.1", "port": int(port)}


def announce(url: str) -> None:
    """Print where the page is and, for somebody who sits at a screen, open it."""
    print(f"clsim: watch at {url}", file=sys.stderr, flush=True)
    has_screen = sys.platform in ("darwin", "win32") or any(os.environ.get(n) for n in ("DISPLAY", "WAYLAND_DISPLAY"))
    if has_screen and sys.stderr.isatty() and "SSH_CONNECTION" not in os.environ:
        import webbrowser

        threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()


def page_numbers(summary: dict[str, Any]) -> dict[str, Any]:
    """Return what the page shows of a run."""
    return {
        "events": summary["events"],
        "dropped_frames": summary["dropped_frames"],
        "real_time_share": real_time_share(summary),
    }


def default_view(outputs: tuple[str, ...], *, as_json: bool) -> View:
    """Return what ``clsim live`` shows unless told: events in the terminal, if there is one and no other output."""
    from clsim.live.view.terminal import suits_terminal

    return "terminal" if not outputs and not as_json and suits_terminal(sys.stdout) else "none"


def check(view: View, *, as_json: bool = False) -> None:
    """Raise InputError for a view that cannot be had: asked before any file is opened, so that none is replaced."""
    if view == "terminal" and not _terminal_stream(as_json).isatty():
        raise InputError("--view terminal needs a terminal, but the output goes elsewhere; expected --view web or none")
    if view == "web":
        from clsim.live.view.server import require_aiohttp

        require_aiohttp()
    if view == "rerun":
        from clsim.live.view.rerun import load_rerun

        load_rerun()


def reserve(view: View, port: str | None) -> socket.socket | None:
    """Return the socket of a page to come, listening already, so that nobody takes its port while files are opened."""
    if view != "web":
        return None
    from clsim.live.view.server import listen

    return listen(**host_and_port(port))


def _terminal_stream(as_json: bool) -> TextIO:
    return sys.stderr if as_json else sys.stdout


def attach(
    session: Session, view: View, port: str | None, listener: socket.socket | None, *, as_json: bool
) -> TerminalScreen | None:
    """Let a session be watched; returns the screen that has to be painted, if it is the terminal's.

    ``listener`` is what ``reserve`` returned.
    """
    from clsim.live.outputs.delivery import Output

    size = session.width, session.height
    if view == "terminal":
        from clsim.live.view.terminal import TerminalScreen, TerminalView

        terminal = TerminalView(*size)
        session.pipeline.outputs.append(Output("the terminal", terminal))
        return TerminalScreen(terminal, _terminal_stream(as_json))
    if view == "web":
        from clsim.live.view.sink import ViewSink

        about = {"listener": listener, "truth_every": session.truth_every, "causes": session.labelled}
        page = ViewSink(session.name, *size, **host_and_port(port) | about)
        page.status = lambda: page_numbers(session.summary().as_dict())
        session.pipeline.outputs.append(Output(page.url, page))
        session.pipeline.watchers.append(page)
        announce(page.url)
    if view == "rerun":
        from clsim.live.view.rerun import RerunSink

        viewer = RerunSink(session.name, *size)
        session.pipeline.outputs.append(Output("rerun", viewer))
        session.pipeline.watchers.append(viewer)
    return None
