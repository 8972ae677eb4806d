"""``clsim bench``: how fast, how accurate."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from clsim.cli.commands.bench_tradeoff import tradeoff
from clsim.cli.options import parse
from clsim.cli.options.shared import JSON, OPENCL
from clsim.errors import InputError

bench = typer.Typer(help="Measure speed and accuracy on this machine.", no_args_is_help=True)
bench.command()(tradeoff)


@bench.command()
def throughput(
    scene: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FILE",
            help="Measure the path tracer in this scene and nothing else; may be given again.",
        ),
    ] = None,
    as_json: JSON = False,
    opencl: OPENCL = None,
) -> None:
    """Measure the detector's kernels and the path tracer, per second of processor time.

    In scene files, paths have at most 8 edges, and roulette ends them from the 5th on; a file that is missing is left
    out.

    Example: `clsim bench throughput --json > throughput.json`
    """
    figures = _scenes(scene) if scene else _all(opencl)
    if as_json:
        typer.echo(json.dumps(figures))
        return
    for key, value in _flat(figures):
        typer.echo(f"{key:<52} {f'{value:,.4g}' if isinstance(value, float) else value}")


def _all(opencl: str | None) -> dict[str, Any]:
    from clsim.bench.throughput.detect import detect_throughput
    from clsim.bench.throughput.render import render_throughput
    from clsim.opencl.device import choose_device

    return {**detect_throughput(device=choose_device(opencl)), "render": render_throughput()}


def _scenes(scenes: list[str]) -> dict[str, Any]:
    from rich.console import Console

    from clsim.bench.throughput.scene import scene_throughput
    from clsim.cli.output.status import say_about_scene
    from clsim.scene import bundled_names, load_world

    figures = {}
    console = Console(stderr=True)
    for scene in scenes:
        if scene in bundled_names() or Path(scene).is_file():
            world = load_world(scene)
            say_about_scene(console, world.notes, world.warnings)
            figures[scene] = scene_throughput(world)
        else:
            typer.echo(f"{scene}: left out, for there is no such file", err=True)
    if not figures:
        raise InputError("nothing is measured, for none of these scenes is there")
    return figures


@bench.command()
def edge(
    resolution: Annotated[str, typer.Option(help="WIDTHxHEIGHT in pixels.")] = "96x72",
    fps: Annotated[float, typer.Option(min=1.0, max=1e6, help="Frames per simulated second.")] = 120.0,
    time: Annotated[
        str,
        typer.Option(
            help="fixed: frames alone; adaptive: pixels are traced between frames too; auto: what each quality does."
        ),
    ] = "auto",
    as_json: JSON = False,
) -> None:
    """Measure how exact event times are, in pixels, on straight edges whose events have a closed form.

    The bundled scene `edge` at 30, 300 and 3000 pixels per second; as one surface before another, as a change of colour
    on one surface, and as a ramp of colour. The error is the speed times the median distance in time.

    Examples: `clsim bench edge --fps 480`, `clsim bench edge --time fixed`
    """
    from rich.console import Console
    from rich.table import Table

    from clsim.bench.edge import SPEEDS_PX_S, measure_edges

    report = partial(typer.echo, err=True)
    rows = measure_edges(SPEEDS_PX_S, parse.resolution(resolution), fps, time, report)
    if as_json:
        typer.echo(json.dumps(rows))
        return
    table = Table()
    for head in ("Edge", "px/s", "quality", "true events", "matched", "error px", "late px"):
        table.add_column(head, justify="left" if head in ("Edge", "quality") else "right")
    for row in rows:
        error, bias = ("–" if row[name] is None else f"{row[name]:.4f}" for name in ("error_px", "bias_px"))
        matched = f"{100 * row['f1']:.1f} %"
        kind, speed = row["kind"], f"{row['speed_px_s']:g}"
        table.add_row(kind, speed, row["quality"], f"{row['true_events']:,}", matched, error, bias)
    Console().print(table)


def _flat(figures: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in figures.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value
