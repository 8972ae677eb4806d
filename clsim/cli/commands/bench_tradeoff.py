"""``clsim bench tradeoff``: what speed costs in accuracy, for one's own scene and machine."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from clsim.cli.options import parse
from clsim.cli.options.shared import FPS, JSON, RESOLUTION, SCENE_HELP
from clsim.cli.plots.figure import new_figure
from clsim.errors import InputError


def tradeoff(
    scene: Annotated[str, typer.Argument(help=SCENE_HELP)],
    quick: Annotated[
        bool, typer.Option("--quick", help="A dozen points of 24 frames of 64x48, in two minutes on 2 cores.")
    ] = False,
    csv_file: Annotated[Path | None, typer.Option("--csv", help="Write all points here.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the points here, as PNG (needs the [plot] extra).")] = None,
    markdown: Annotated[Path | None, typer.Option(help="Write the Pareto front and what each knob costs here.")] = None,
    reference_spp: Annotated[
        int | None, typer.Option(help="Light paths per pixel and frame of the reference. [4096, quick 1024]")
    ] = None,
    reference_budget: Annotated[
        float | None,
        typer.Option(
            help="CPU seconds for doubling the reference's samples and frame rate until scores settle. [600, quick 0]"
        ),
    ] = None,
    resolution: RESOLUTION = None,
    frame_count: Annotated[int | None, typer.Option(help="Number of frames. [48, quick 24]")] = None,
    fps: FPS = None,
    seeds: Annotated[str, typer.Option(help="Seeds to measure, such as 0,1,2: means and spreads are shown.")] = "0",
    cache: Annotated[
        Path | None, typer.Option(help="Folder that keeps references and measured points. [~/.cache/clsim/tradeoff]")
    ] = None,
    as_json: JSON = False,
) -> None:
    """Measure what speed costs in accuracy: samples, noise, gates, windows, against a clean reference.

    Points that were measured before, with the same scene, code and machine, are not measured again; so a run that
    was interrupted goes on where it stopped.

    Example: `clsim bench tradeoff two-boxes --quick --plot tradeoff.png`
    """
    from clsim.bench.tradeoff.sweep import Sweep, TradeoffOptions
    from clsim.cli.output.tradeoff_tables import csv_text, markdown_text

    options = TradeoffOptions(
        scene,
        cache or default_cache(),
        quick=quick,
        reference_spp=reference_spp,
        reference_budget_s=reference_budget,
        resolution=parse.resolution(resolution) if resolution else None,
        frames=frame_count,
        fps=fps,
        seeds=parse_seeds(seeds),
    )
    for file in (csv_file, plot, markdown):
        if file is not None and not file.absolute().parent.is_dir():
            raise InputError(f"cannot write {file}: there is no folder {file.absolute().parent}")
    if plot is not None:
        new_figure("the trade", 1, 1)  # told before all is measured, and not after
    results = with_progress(options, Sweep)
    _write(csv_file, lambda: csv_text(results))
    _write(markdown, lambda: markdown_text(results))
    if plot is not None:
        from clsim.cli.plots.tradeoff_plot import plot_tradeoff

        plot_tradeoff(results, plot)
    if as_json:
        typer.echo(json.dumps(results))
        return
    _print_front(results)


def default_cache() -> Path:
    """Return the folder for what can be measured again, where the system's conventions want it."""
    from clsim.caches import cache_folder

    return cache_folder() / "tradeoff"


def parse_seeds(text: str) -> tuple[int, ...]:
    """Return the seeds of ``0`` or ``0,1,2``."""
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--seeds must be whole numbers such as 0,1,2, got {text!r}") from None


def _write(file: Path | None, text: Any) -> None:
    if file is None:
        return
    try:
        file.write_text(text(), encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write {file}: {error.strerror}") from None


def with_progress(options: Any, make_sweep: Any) -> dict[str, Any]:
    """Run a sweep below a bar with the time left, on standard error, after what the scene has to say."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    from clsim.cli.output.status import say_about_scene

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    # Few refreshes a second: the bar's own processor time is in every figure.
    with Progress(*columns, console=Console(stderr=True), refresh_per_second=2, speed_estimate_period=60) as progress:
        task = progress.add_task("", total=None)

        def report(what: str, done: float, total: float) -> None:
            progress.update(task, description=what, completed=done, total=total or 1.0)

        try:
            sweep = make_sweep(options, report)
            say_about_scene(progress.console, sweep.world.notes, sweep.world.warnings)
            results: dict[str, Any] = sweep.run()
        except KeyboardInterrupt:
            progress.console.print("clsim: interrupted; the same command goes on from the points measured so far")
            raise
        progress.update(task, description="done", completed=1.0, total=1.0)
    return results


def _print_front(results: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    from clsim.cli.output.tradeoff_tables import front_table, reference_text

    head, rows = front_table(results)
    # Eighty columns do not hold all; the Markdown does.
    shown = [i for i, name in enumerate(head) if name in ("Setting", "CPU s", "F1", "strict F1", "front")]
    table = Table(title=f"{results['scene']}: the Pareto front", title_justify="left")
    for i in shown:
        table.add_column(head[i], justify="right" if i else "left")
    for row in rows:
        table.add_row(*(row[i] for i in shown))
    console = Console()
    console.print(table)
    console.print(reference_text(results), highlight=False)
