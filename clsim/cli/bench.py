"""``clsim bench``: how fast, how accurate."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from clsim.cli.bench_tradeoff import tradeoff
from clsim.cli.options import OPENCL

bench = typer.Typer(help="Measure speed and accuracy on this machine.", no_args_is_help=True)
bench.command()(tradeoff)

JSON_FILE = Annotated[Path | None, typer.Option("--json", help="Write the figures into this file, - for stdout.")]


@bench.command()
def throughput(json_file: JSON_FILE = None, opencl: OPENCL = None) -> None:
    """Measure the detector's kernels and the path tracer, per second of processor time.

    Example: `clsim bench throughput --json throughput.json`
    """
    from clsim.bench.throughput_detect import detect_throughput
    from clsim.bench.throughput_render import render_throughput
    from clsim.opencl.device import choose_device

    figures: dict[str, Any] = detect_throughput(device=choose_device(opencl))
    figures["render"] = render_throughput()
    _deliver(figures, json_file)


def _deliver(figures: dict[str, Any], json_file: Path | None) -> None:
    """Write figures to the file asked for, and a table to the terminal unless standard output holds the JSON."""
    if json_file is not None and str(json_file) == "-":
        typer.echo(json.dumps(figures))
        return
    if json_file is not None:
        json_file.write_text(json.dumps(figures, indent=1) + "\n")
    for key, value in _flat(figures):
        typer.echo(f"{key:<52} {f'{value:,.4g}' if isinstance(value, float) else value}")


def _flat(figures: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in figures.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value
