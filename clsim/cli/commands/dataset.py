"""``clsim dataset``: many sequences from one specification."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from clsim.cli.options.shared import JSON, advanced
from clsim.cli.output.status import INTERRUPTED, OUTPUT_FAILED

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from clsim.datasets.engine import Progress

_TOLD = 5
"""Warnings, and failures, that are printed."""


def dataset(
    spec: Annotated[
        str, typer.Argument(help="A TOML specification, or a bundled one: flow, indoor-depth, flicker, digits.")
    ],
    out: Annotated[str, typer.Option(help="Folder of the data set; what is whole in it is kept.")],
    count: Annotated[int | None, typer.Option(min=1, help="Number of sequences. [the specification's]")] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Processes on this machine, each with one sequence at a time. [a half of the cores]"),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a running scheduler of Dask, such as tcp://HOST:8786, instead.")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only draw ten samples on a sheet, and estimate time and bytes of all.")
    ] = False,
    shards: Annotated[
        str | None, typer.Option(metavar="webdataset|parquet", help="Pack the sequences too, when all are there.")
    ] = None,
    verify: Annotated[
        bool, advanced("--verify", help="Compare hashes of what is there, not sizes alone; mend what differs.")
    ] = False,
    as_json: JSON = False,
) -> int:
    """Make a data set: sequences of random scenes, motions and sensors, each with its truth.

    A second run with the same specification goes on where the first ended, however it ended.

    Example: `clsim dataset flow --count 20 --out flow-set`
    """
    from rich.console import Console

    from clsim.cli.output.status import say_about_scene
    from clsim.datasets.engine import SchedulerLostError, check_engine, make
    from clsim.datasets.shards import check_shards, write_shards
    from clsim.datasets.spec import load_spec

    console = Console(stderr=True)
    chosen = load_spec(spec, count)
    check_engine()
    check_shards(shards)
    folder = Path(out)
    if dry_run:
        from clsim.datasets.preview import preview

        told = preview(chosen, folder, workers)
        say_about_scene(console, told.sentences, _first(told.warnings))
        if as_json:
            print(json.dumps(told.as_dict()))
        return 0
    try:
        with _bar(console) as tell:
            done = make(chosen, folder, workers=workers, scheduler=scheduler, verify=verify, tell=tell)
        packed = write_shards(folder, shards) if shards is not None and not done.failures else []
    except KeyboardInterrupt:
        console.print(
            f"clsim: interrupted; the same command goes on with {out}", highlight=False, markup=False, emoji=False
        )
        return INTERRUPTED
    except SchedulerLostError as error:
        print(f"clsim: {scheduler or 'dask.distributed'}: {error}", file=sys.stderr)
        return OUTPUT_FAILED
    kept = done.whole - done.rejected
    sentences = [f"{kept:,} of {done.total:,} sequences are in {out}, {done.new:,} of them new"]
    if done.rejected:
        sentences.append(f"{done.rejected:,} were rejected at each attempt; their job.json tell why")
    if packed:
        sentences.append(f"{len(packed):,} shards are in {packed[0].parent}")
    failed = [f"sequence {index} failed: {why}" for index, why in sorted(done.failures.items())[:_TOLD]]
    say_about_scene(console, sentences, [*_first(done.warnings), *failed])
    if as_json:
        print(json.dumps(vars(done)))
    return OUTPUT_FAILED if done.failures else 0


def _first(warnings: Sequence[str]) -> list[str]:
    """Return the first warnings, and how many more there are: each of thousands of scenes may have its own."""
    more = len(warnings) - _TOLD
    are = "warning is" if more == 1 else "warnings are"
    return [*warnings[:_TOLD], *([f"{more:,} more {are} in the job.json of the sequences"] if more > 0 else [])]


class _bar:  # noqa: N801 - a context manager
    """A progress bar with the time left and the cost so far."""

    def __init__(self, console: Console) -> None:
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as Bars

        self._bars = Bars(
            TextColumn("sequences"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(),
            TextColumn("{task.fields[cost]}"), console=console, transient=True,
            disable=not console.is_terminal,
        )  # fmt: skip
        self._task = self._bars.add_task("", total=None, cost="starting")
        self._begun_s = time.monotonic()

    def __enter__(self) -> _bar:
        self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bars.stop()

    def __call__(self, progress: Progress) -> None:
        """Show how far it is."""
        cost = f"{progress.cpu_s / 3600:.2f} CPU hours, {progress.rejected} rejected, {len(progress.failures)} failed"
        self._bars.update(self._task, total=progress.total, completed=progress.whole, cost=cost)
