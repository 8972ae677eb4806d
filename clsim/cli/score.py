"""``clsim score``: events against reference events."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from clsim.cli.options import JSON
from clsim.events import EventBatch, empty_batch
from clsim.events.files import open_source


def score(
    events: Annotated[str, typer.Argument(help="Events to judge: a file of any format that clsim reads.")],
    reference: Annotated[str, typer.Argument(help="Events held to be true.")],
    width: Annotated[int, typer.Option(help="Width of the sensor [pixels].")],
    height: Annotated[int, typer.Option(help="Height of the sensor [pixels].")],
    fps: Annotated[float, typer.Option(help="Frame rate by which both were made: a frame is ⌈t·fps⌉.")],
    tau: Annotated[float, typer.Option(help="Largest squared distance of a match, in image widths squared.")] = 5e-4,
    plot: Annotated[Path | None, typer.Option(help="Draw precision, recall and F1 over τ into this PNG.")] = None,
    as_json: JSON = False,
) -> None:
    """Score events against reference events: precision, recall, F1, chamfer distance, timing.

    Precision is the share of EVENTS with a reference event near them; the ICIP 2023 paper calls that R(τ), and P(τ)
    what is recall here. F1 is the same.

    Example: `clsim score live.aedat4 reference.aedat4 --width 346 --height 260 --fps 120`
    """
    from clsim.score import Sampling, curves, plot_curves
    from clsim.score import score as score_events

    found, truth = _read(events), _read(reference)
    result = score_events(found, truth, width, height, fps, tau)
    if plot is not None:
        plot_curves({Path(events).stem: curves(found, truth, Sampling(width, height, fps))}, plot)
    if as_json:
        typer.echo(json.dumps(result.as_dict()))
        return
    for key, value in result.as_dict().items():
        typer.echo(f"{key:<20} {'–' if value is None else f'{value:.6g}'}")


def _read(path: str) -> EventBatch:
    return np.concatenate([empty_batch(), *open_source(path)])
