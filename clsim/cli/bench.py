"""``clsim bench``: how fast, how accurate."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import typer

from clsim.cli.bench_tradeoff import tradeoff
from clsim.cli.options import JSON, OPENCL

bench = typer.Typer(help="Measure speed and accuracy on this machine.", no_args_is_help=True)
bench.command()(tradeoff)


@bench.command()
def throughput(as_json: JSON = False, opencl: OPENCL = None) -> None:
    """Measure the detector's kernels and the path tracer, per second of processor time.

    Example: `clsim bench throughput --json > throughput.json`
    """
    from clsim.bench.throughput_detect import detect_throughput
    from clsim.bench.throughput_render import render_throughput
    from clsim.opencl.device import choose_device

    figures: dict[str, Any] = detect_throughput(device=choose_device(opencl))
    figures["render"] = render_throughput()
    if as_json:
        typer.echo(json.dumps(figures))
        return
    for key, value in _flat(figures):
        typer.echo(f"{key:<52} {f'{value:,.4g}' if isinstance(value, float) else value}")


def _flat(figures: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in figures.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value
