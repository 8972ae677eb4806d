"""``clsim convert``: events from one format or socket to another."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, Annotated

import typer

from clsim.cli.options import parse
from clsim.cli.options.shared import FILES, FORMAT, ROS_EVENTS, SENSOR_SIZE, STRICT_ORDER, TEXT_TIME
from clsim.cli.output.status import INTERRUPTED, OUTPUT_FAILED, READER_LEFT
from clsim.cli.output.words import dropped_text, events_text, moved_text
from clsim.truth.layouts import layout_of
from clsim.truth.recording import recording_kind

if TYPE_CHECKING:
    from clsim.events.copy import Copied


def convert(
    source: Annotated[str, typer.Argument(metavar="IN", help="An event file, tcp://, unix:// or udp:// address.")],
    target: Annotated[str, typer.Argument(metavar="OUT", help="An address, - for text, or an event file: " + FILES)],
    resolution: SENSOR_SIZE = None,
    format: FORMAT = None,
    text_time: TEXT_TIME = None,
    ros_events: ROS_EVENTS = None,
    strict: STRICT_ORDER = False,
) -> int:
    """Convert events between files of all formats and sockets, or record a stream; recordings with truth too.

    Examples: `clsim convert events.aedat4 events.h5`, `clsim convert tcp://127.0.0.1:7777 recording.aedat4`,
    `clsim convert run.h5 run.dsec`
    """
    layout = layout_of(target)
    if layout is not None and recording_kind(source) is not None:
        return _convert_truth(source, target, strict)
    from rich.console import Console

    from clsim.errors import InputError
    from clsim.events import SinkError
    from clsim.events.copy import Copied, convert_events
    from clsim.events.files import ENDINGS
    from clsim.events.outputs import FileOptions

    if layout is not None and format is None and not target.lower().endswith(ENDINGS):
        raise InputError(
            f"{target}: is a layout of truth, and {source} is no recording with truth that can be read back; expected "
            "an event file, such as events.h5"
        )
    console = Console(stderr=True)
    size = None if resolution is None else parse.resolution(resolution)
    started_s = told_s = time.monotonic()
    done = Copied()
    try:
        with console.status(f"{source} → {target}") as status:

            def tell(copied: Copied) -> None:
                nonlocal told_s, done
                done = copied
                now_s = time.monotonic()
                if now_s - told_s > 0.1:
                    told_s = now_s
                    rate = copied.events / (now_s - started_s)
                    status.update(
                        f"{source} → {target}: {events_text(copied.events)}, t {copied.time_us * 1e-6:.3f} s, "
                        f"{rate:,.0f} ev/s"
                    )

            files = FileOptions(format, text_time, ros_events)
            done = convert_events(source, target, size, tell, files, strict=strict)
    except SinkError as error:
        if isinstance(error.__cause__, BrokenPipeError):
            return READER_LEFT
        print(f"clsim: {error}", file=sys.stderr)
        return OUTPUT_FAILED
    except KeyboardInterrupt:
        print(f"clsim: interrupted after {events_text(done.events)}", file=sys.stderr)
        _tell_dropped(source, done)
        return INTERRUPTED
    print(f"{target}: {events_text(done.events)} up to {done.time_us * 1e-6:.6f} s", file=sys.stderr)
    if done.lost_labels:
        print(f"clsim: {target}: its format cannot hold {', '.join(done.lost_labels)} of events", file=sys.stderr)
    _tell_dropped(source, done)
    return 0


def _convert_truth(source: str, target: str, strict: bool) -> int:
    from clsim.events import SinkError
    from clsim.truth.recording import convert_recording

    try:
        events, left_out = convert_recording(source, target, strict=strict)
    except SinkError as error:
        print(f"clsim: {error}", file=sys.stderr)
        return OUTPUT_FAILED
    print(f"{target}: {events:,} events, with what is recorded beside them", file=sys.stderr)
    if left_out:
        print(f"clsim: {target}: its layout cannot hold {', '.join(left_out)}", file=sys.stderr)
    return 0


def _tell_dropped(source: str, done: Copied) -> None:
    if done.moved_events:
        print(f"clsim: {source}: {moved_text(done.moved_events)}", file=sys.stderr)
    if done.dropped_events:
        print(f"clsim: {source}: {dropped_text(done.dropped_events)}", file=sys.stderr)
