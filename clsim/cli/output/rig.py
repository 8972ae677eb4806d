"""What the user sees of a run with several cameras."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING

from rich.console import Console

from clsim.cli.output.status import INTERRUPTED, OUTPUT_FAILED, say_about_scene
from clsim.cli.output.summary import print_losses, print_summary
from clsim.events import SinkError

if TYPE_CHECKING:
    from clsim.live.session import Session


def run_rig(sessions: list[Session], *, as_json: bool) -> int:
    """Run all cameras to the end or to Ctrl-C and print a summary of each; return the exit status."""
    from clsim.live.rig import run_all

    console = Console(stderr=True)
    say_about_scene(console, sessions[0].notes, sessions[0].warnings)
    status = 0
    try:
        run_all(sessions)
    except KeyboardInterrupt:
        status = INTERRUPTED
    except SinkError as error:
        print(f"clsim: {error}", file=sys.stderr)
        status = OUTPUT_FAILED
    summaries = [session.summary().as_dict() | {"interrupted": status == INTERRUPTED} for session in sessions]
    for session, summary in zip(sessions, summaries, strict=True):
        print_losses(console, summary)
        if not as_json:
            print_summary(console, session, summary)
    if as_json:
        print(json.dumps(summaries), flush=True)
    return status
