"""``clsim score``: events against reference events."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from clsim.cli.options import parse
from clsim.cli.options.shared import JSON, SENSOR_SIZE, STRICT_ORDER
from clsim.cli.output.words import dropped_text, moved_text
from clsim.errors import InputError
from clsim.events import EventBatch, empty_batch
from clsim.events.files import open_source

_SAME_RATE = 1e-3


def score(
    events: Annotated[str, typer.Argument(help="Events to judge: a file of any format that clsim reads.")],
    reference: Annotated[str, typer.Argument(help="Events held to be true.")],
    resolution: SENSOR_SIZE = None,
    fps: Annotated[
        float | None, typer.Option(help="Frame rate by which both were made: a frame is ⌈t·fps⌉. [the sidecars']")
    ] = None,
    tau: Annotated[float, typer.Option(help="Largest squared distance of a match, in image widths squared.")] = 5e-4,
    within: Annotated[
        str,
        typer.Option(
            help="Windows of time, comma-separated, bare numbers are seconds: scores of one-to-one matches within each."
        ),
    ] = "0.3ms,1ms,3ms,10ms",
    plot: Annotated[Path | None, typer.Option(help="Draw precision, recall and F1 over τ into this PNG.")] = None,
    as_json: JSON = False,
    strict: STRICT_ORDER = False,
) -> None:
    """Score events against reference events: precision, recall, F1, chamfer distance, timing.

    Precision is the share of EVENTS with a reference event near them; the ICIP 2023 paper calls that R(τ), and P(τ)
    what is recall here. F1 is the same.

    Examples: `clsim score live.aedat4 reference.aedat4`, `clsim score a.raw b.raw --resolution 346x260 --fps 120`
    """
    from clsim.score import Sampling, curves, plot_curves
    from clsim.score import score as score_events

    (found, found_told), (truth, truth_told) = _read(events, strict), _read(reference, strict)
    told = {events: found_told, reference: truth_told}
    columns, rows = _agreed("--resolution", None if resolution is None else parse.resolution(resolution), told)
    rate: float = _agreed("--fps", fps, told)
    Sampling(columns, rows, rate)  # refuses what is not positive
    _tell_ends({path: each["ends_s"] for path, each in told.items() if "ends_s" in each}, 1.0 / rate)
    _tell_apart({events: found, reference: truth}, 1e6 / rate)
    result = score_events(found, truth, columns, rows, rate, tau, parse.windows_us(within, "--within"))
    if plot is not None:
        plot_curves({Path(events).stem: curves(found, truth, Sampling(columns, rows, rate))}, plot)
    if as_json:
        typer.echo(json.dumps(result.as_dict()))
        return
    typer.echo("f1, precision, recall: 1 is best; chamfer: 0 is best; dt: µs, bias above 0: late; –: nothing matched")
    for key, value in result.as_dict().items():
        if key != "within":
            typer.echo(f"{key:<20} {'–' if value is None else f'{value:.6g}'}")
    for window, each in result.within.items():
        typer.echo(f"{f'F1 within {window / 1000:g} ms':<20} {each.f1:.6g}")


def _read(path: str, strict: bool) -> tuple[EventBatch, dict[str, Any]]:
    """Return the events of a file, and the options that it or its sidecar tells; say what was out of order."""
    from clsim.events.sidecar import read_sidecar, sidecar_size

    source = open_source(path, strict=strict)
    batch = np.concatenate([empty_batch(), *source])
    if source.moved_events:
        print(f"clsim: {path}: {moved_text(source.moved_events)}", file=sys.stderr)
    if source.dropped_events:
        print(f"clsim: {path}: {dropped_text(source.dropped_events)}", file=sys.stderr)
    about = read_sidecar(path)
    size = sidecar_size(about)
    if source.width is not None and source.height is not None:
        size = source.width, source.height
    told: dict[str, Any] = {} if size is None else {"--resolution": size}
    fps = about.get("fps")
    if isinstance(fps, int | float) and 0 < fps < float("inf"):
        told["--fps"] = fps
    summary = about.get("summary")
    ends_s = summary.get("simulated_s") if isinstance(summary, dict) else None
    if isinstance(ends_s, int | float) and ends_s < float("inf"):
        told["ends_s"] = ends_s
    return batch, told


def _tell_ends(ends_s: dict[str, float], frame_s: float) -> None:
    """Say so where one recording goes on for more than a frame after the other's end."""
    if not ends_s:
        return
    first, last = (choose(ends_s, key=lambda path: ends_s[path]) for choose in (min, max))
    if ends_s[last] - ends_s[first] > frame_s:
        told = f"{first} ends at {ends_s[first]:g} s, {last} at {ends_s[last]:g} s"
        print(f"clsim: {told}: events after the earlier end match nothing", file=sys.stderr)


def _tell_apart(batches: dict[str, EventBatch], frame_us: float) -> None:
    """Say so where one recording has all its events before those of the other."""
    if any(not len(batch) for batch in batches.values()):
        return
    first, last = (choose(batches, key=lambda path: batches[path]["t"][0]) for choose in (min, max))
    end_us, start_us = int(batches[first]["t"][-1]), int(batches[last]["t"][0])
    if start_us - end_us > frame_us:
        told = f"the events of {first} end at {end_us * 1e-6:g} s, those of {last} begin at {start_us * 1e-6:g} s"
        print(f"clsim: {told}: they have no time in common, so that nothing matches", file=sys.stderr)


def _agreed(option: str, given: Any, told: dict[str, dict[str, Any]]) -> Any:
    """Return an option as it was given, or else as the files tell it, the reference before the other."""
    if given is not None:
        return given
    values = {path: found[option] for path, found in told.items() if option in found}
    if not values:
        raise InputError(f"{option} is needed, for neither {' nor '.join(told)} tells it")
    if not _agree(option, list(values.values())):
        differing = ", but ".join(f"{path} has {_text(value)}" for path, value in values.items())
        raise InputError(f"{option}: {differing}; expected recordings that agree, or the option")
    return list(values.values())[-1]


def _agree(option: str, values: list[Any]) -> bool:
    """Tell whether both files mean the same; rates found from times in whole µs differ a little."""
    if option == "--fps":
        return math.isclose(values[0], values[-1], rel_tol=_SAME_RATE)
    return len(set(values)) == 1


def _text(value: Any) -> str:
    return f"{value[0]}x{value[1]}" if isinstance(value, tuple) else f"{value:g}"
