"""What a run tells at its end: what happened, how fast, where the events are, and one hint at most."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.text import Text

from clsim.cli.output.words import events_text, percent_text, real_time_share, size_text
from clsim.cli.spelling import as_options

if TYPE_CHECKING:
    from rich.console import Console

    from clsim.live.session import Session

_MUCH_NOISE = 0.1
"""Share of events that are likely noise from which on it is told."""
_COARSE_SHARE = 0.2
"""Crossings of several thresholds in one step, per event, from which on most times lie somewhere between frames."""


def print_summary(console: Console, session: Session, summary: dict[str, Any]) -> None:
    """Print what came of a run."""
    say = _sayer(console)
    stopped = "stopped: " if summary["interrupted"] else ""
    rest = f" in {summary['simulated_s']:.3f} s of {summary['name']} ({summary['width']}x{summary['height']})"
    say(Text.assemble(stopped, (events_text(summary["events"]), "bold"), rest))
    share, startup_s = real_time_share(summary), summary["startup_s"] or 0.0
    if share is not None:
        say(
            f"{summary['wall_s'] - startup_s:.1f} s of computing, {percent_text(share)} of real time, after "
            f"{startup_s:.1f} s to start"
        )
    governor = summary["governor"]
    if governor is not None and governor["given_up"]:
        say(f"to keep up with the clock it gave up {governor['given_up']}")
    if governor is not None and governor["too_slow"] and summary["late_frames"] + summary["dropped_frames"]:
        say("it fell behind all the same: lower --resolution")
    if summary["late_frames"] or summary["dropped_frames"]:
        say(f"{summary['late_frames']:,} frames came late, {summary['dropped_frames']:,} were dropped")
    for output in summary["outputs"]:
        say(f"→ {output['name']}" + _outcome(output))
    hint = _hint(session, summary)
    if hint is not None and console.is_terminal:
        say(Text(hint, style="dim"))


def print_losses(console: Console, summary: dict[str, Any]) -> None:
    """Print what a run lost of its input or its events; always, for the events are not what they seem then."""
    say = _sayer(console, style="yellow")
    if summary["masked_pixels"]:
        say(f"clsim: {summary['masked_pixels']:,} NaN or infinite pixels were masked")
    if summary["capped_events"]:
        say(
            f"clsim: {summary['capped_events']:,} events beyond 1000 per pixel and step were not written; the "
            "threshold is too low"
        )
    if summary["lost_events"]:
        say(f"clsim: {summary['lost_events']:,} events were lost in the sensor's readout: it was too busy")
    if summary["too_dark"]:
        say(f"clsim: {summary['too_dark']}")
    if summary["no_events"]:
        say(f"clsim: {as_options(summary['no_events'])}")
    noise = summary["noise_share"]
    if noise is not None and noise > _MUCH_NOISE:
        say(
            f"clsim: about {percent_text(noise)} of the events are likely noise of the rendering: with another "
            "--seed they would be others"
        )
    noise = summary["ideal_noise_share"]
    if noise is not None and noise > _MUCH_NOISE:
        say(
            f"clsim: about {percent_text(noise)} of the events that ideal pixels would fire here are likely noise of "
            "the rendering; the sensor's own noise is not in this"
        )
    motion = summary["motion"]
    if motion is not None and motion["fast_pairs"]:
        say(
            f"clsim: what is seen moves by up to {motion['largest_px']:.1f} pixels from one frame to the next, and by "
            f"more than 1 in {motion['fast_pairs']:,} of {motion['pairs']:,} pairs; what happens between frames is not "
            "known, so edges jump there: expected footage of a higher frame rate"
        )
    if motion is not None and motion["lost_pairs"]:
        say(
            f"clsim: in {motion['lost_pairs']:,} pairs of frames nothing is found again: it moved too far, or there "
            "was a cut, or there is only noise"
        )


def _hint(session: Session, summary: dict[str, Any]) -> str | None:
    """Return the one thing that helps most next, if there is any."""
    if summary["steep_pixels"] > _COARSE_SHARE * max(summary["events"], 1):
        finer = session.schedule.fps * math.ceil(summary["most_crossings"] / 3)
        return f"brightness changes fast between frames: --fps {finer:g} places events in time more exactly"
    if not summary["events"] and summary["frames"] > 1 and session.world and session.world.moving_s() == 0:
        return "nothing moves here, and no light changes: --camera-path moves the camera"
    files = [o["name"] for o in summary["outputs"] if "error" not in o and Path(o["name"]).is_file()]
    if files and summary["events"]:
        return f"to look at it: clsim view {files[0]}"
    if not summary["outputs"]:
        return "to keep the events: --out events.aedat4"
    return None


def _outcome(output: dict[str, Any]) -> str:
    if "error" in output:
        return f": {output['error']}"
    return _size(output["name"]) if output.get("replaced", True) else ": was not replaced, for there was no frame yet"


def _size(name: str) -> str:
    path = Path(name)
    return f" ({size_text(path.stat().st_size)})" if path.is_file() else ""


def _sayer(console: Console, style: str | None = None) -> Any:
    def say(sentence: str | Text) -> None:
        # Lines are left to the terminal to wrap: a path or a command must stay in one piece to be copied. Brackets in
        # names of folders, and of a scene's tables, are no markup.
        console.print(sentence, style=style, highlight=False, markup=False, emoji=False, soft_wrap=True)

    return say
