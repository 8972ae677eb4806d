"""The list of commands; each lives in a file of its own and imports what it needs when it runs."""

from __future__ import annotations

import typer

from clsim.cli.commands.bench import bench
from clsim.cli.commands.convert import convert
from clsim.cli.commands.dataset import dataset
from clsim.cli.commands.detect import detect
from clsim.cli.commands.devices import devices
from clsim.cli.commands.info import info
from clsim.cli.commands.live import live
from clsim.cli.commands.render import render
from clsim.cli.commands.scenes import scenes
from clsim.cli.commands.score import score
from clsim.cli.commands.sensor import sensor
from clsim.cli.commands.view import view
from clsim.cli.output.watch import BareViewCommand

app = typer.Typer(
    help="Live event-camera simulation from path-traced 3-D scenes.",
    invoke_without_command=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)

for command in (live, render, detect, dataset, score, view, convert, info, scenes, devices):
    app.command(cls=BareViewCommand if command in (live, view) else None)(command)
app.add_typer(bench, name="bench")
app.add_typer(sensor, name="sensor")


def _print_version(value: bool) -> None:
    if value:
        from clsim import __version__

        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def common(
    context: typer.Context,
    version: bool = typer.Option(False, "--version", callback=_print_version, is_eager=True, help="Print the version."),
) -> None:
    """Live event-camera simulation from path-traced 3-D scenes."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
