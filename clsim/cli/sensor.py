"""``clsim sensor``: which cameras there are, what they are like, and what a recording tells of one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

sensor = typer.Typer(help="Look at simulated cameras, and fit one to recordings.", no_args_is_help=True)


@sensor.command()
def plot(
    name: Annotated[str, typer.Argument(metavar="NAME|FILE", help="A preset, such as davis346, or a .toml file.")],
    out: Annotated[Path, typer.Option(help="The picture, as PNG.")],
    seed: Annotated[int, typer.Option(min=0, help="Seed of all random numbers.")] = 0,
) -> None:
    """Draw what a camera is like: noise, bandwidth and latency against light, thresholds, response to contrast.

    All but the bandwidth is measured of simulated pixels. Needs the [plot] extra.

    Example: `clsim sensor plot davis346 --out davis346.png`
    """
    from clsim.cli.sensor_plot import plot_sensor
    from clsim.sensor import load_sensor

    plot_sensor(load_sensor(name), out, seed)
    typer.echo(out)
