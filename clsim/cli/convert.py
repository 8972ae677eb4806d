"""``clsim convert``: events from one format or socket to another."""

from __future__ import annotations

import sys
import time
from typing import Annotated

import typer

from clsim.cli import parse
from clsim.cli.options import FILES, FORMAT, SENSOR_SIZE, TEXT_TIME
from clsim.cli.status import INTERRUPTED, OUTPUT_FAILED, READER_LEFT


def convert(
    source: Annotated[str, typer.Argument(metavar="IN", help="An event file, tcp://, unix:// or udp:// address.")],
    target: Annotated[str, typer.Argument(metavar="OUT", help="An address, - for text, or an event file: " + FILES)],
    resolution: SENSOR_SIZE = None,
    format: FORMAT = None,
    text_time: TEXT_TIME = None,
) -> int:
    """Convert events between files of all formats and sockets, or record a stream.

    Examples: `clsim convert events.aedat4 events.h5`, `clsim convert tcp://127.0.0.1:7777 recording.aedat4`
    """
    from rich.console import Console

    from clsim.events import SinkError
    from clsim.events.copy import convert_events
    from clsim.events.outputs import FileOptions

    console = Console(stderr=True)
    size = None if resolution is None else parse.resolution(resolution)
    started_s = told_s = time.monotonic()
    done = (0, 0)
    try:
        with console.status(f"{source} → {target}") as status:

            def tell(events: int, time_us: int) -> None:
                nonlocal told_s, done
                done = (events, time_us)
                now_s = time.monotonic()
                if now_s - told_s > 0.1:
                    told_s = now_s
                    rate = events / (now_s - started_s)
                    status.update(f"{source} → {target}: {events:,} events, t {time_us * 1e-6:.3f} s, {rate:,.0f} ev/s")

            convert_events(source, target, size, tell, FileOptions(format, text_time))
    except SinkError as error:
        if isinstance(error.__cause__, BrokenPipeError):
            return READER_LEFT
        print(f"clsim: {error}", file=sys.stderr)
        return OUTPUT_FAILED
    except KeyboardInterrupt:
        print(f"clsim: interrupted after {done[0]:,} events", file=sys.stderr)
        return INTERRUPTED
    print(f"{target}: {done[0]:,} events up to {done[1] * 1e-6:.6f} s", file=sys.stderr)
    return 0
