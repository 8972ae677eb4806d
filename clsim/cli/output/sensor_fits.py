"""What ``clsim sensor fit`` reads of recordings, and how it tells what it found."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence

import numpy as np
import typer

from clsim.errors import InputError
from clsim.events import EventBatch
from clsim.events.open import open_events, sensor_size
from clsim.sensor.fit.check import Predicted, predicted
from clsim.sensor.fit.fitted import Row, fitted_rows, noise_table, sensor_file, uniform_rows
from clsim.sensor.fit.flicker import fit_flicker
from clsim.sensor.fit.still import Counts, fit_still
from clsim.sensor.fit.uniform import fit_uniform, rates_of

Size = tuple[int, int]
Fitted = tuple[str, list[Row]]
"""Text of a sensor file, and the numbers that were found."""


def fit_scenes(
    recordings: Sequence[str], lamp: str | None, contrast: float | None, size: Size | None, name: str, told: str,
    base: str | None,
) -> Fitted:  # fmt: skip
    """Fit still scenes, and a lamp if there is one."""
    counts: Counts | None = None
    for recording in recordings:
        counts, size = _counted(recording, size, counts)
    assert counts is not None and size is not None, "the command line asks for a recording at least"
    still = fit_still(counts)
    flicker = None
    if lamp is not None and contrast is not None:
        with open_events(lamp) as source:
            flicker = fit_flicker(source, *size, contrast, ~still.hot)
        if flicker.mismatch[0] > min(flicker.on[0], flicker.off[0]):
            # What is no flicker fits thresholds of nothing, which differ by more than they are.
            raise InputError(f"{lamp}: is no recording of a lamp whose light is a sine of contrast {contrast:g}")
    rows = list(fitted_rows(still, flicker))
    return sensor_file(name, size, rows, told, base), rows


def fit_lights(
    recordings: Sequence[str], lux: Sequence[float], size: Size | None, name: str, told: str, base: str | None
) -> Fitted:
    """Fit even scenes, each in another light."""
    if len(lux) != len(recordings):
        raise InputError(f"--lux has {len(lux)} numbers, expected {len(recordings)}, one for each recording")
    each = []
    for recording in recordings:
        counts, size = _counted(recording, size)
        each.append(counts)
    assert size is not None, "the command line asks for a recording at least"
    quiet = np.ones(each[0].on.shape, np.bool_)
    for counts in each:
        try:
            quiet &= ~fit_still(counts).hot
        except InputError:
            continue  # too few events to know hot pixels by
    rates = [rates_of(light, counts, quiet) for light, counts in zip(lux, each, strict=True)]
    found = fit_uniform(rates)
    rows = list(uniform_rows(found))
    return sensor_file(name, size, rows, told, base, noise_table(rates, found)), rows


def predict(recordings: Sequence[str], size: Size | None) -> list[Predicted]:
    """Return what the first halves of the recordings predict of the second halves."""
    quarters: list[Counts] = []
    for recording in recordings:
        with open_events(recording) as source:
            size = sensor_size(recording, source, size)
            times = [(int(batch["t"][0]), int(batch["t"][-1])) for batch in source if len(batch)]
        if not times:
            raise InputError(f"{recording}: holds no events; there is nothing to fit")
        edges = np.linspace(times[0][0], times[-1][1] + 1, 5).round().astype(np.int64)
        quarters = quarters or [Counts.of_size(*size) for _ in range(4)]
        for number, quarter in enumerate(quarters):
            seconds = quarter.seconds
            with open_events(recording) as source:
                quarter.add(_between(source, int(edges[number]), int(edges[number + 1])))
            quarter.seconds = seconds + float(edges[number + 1] - edges[number]) * 1e-6
    return predicted(quarters)[1]


def tell(rows: Sequence[Row], halves: Sequence[Predicted], *, as_json: bool) -> None:
    """Print what was found, a line a number or as JSON."""
    if as_json:
        found: dict[str, object] = {name: number for name, number, _ in rows}
        if halves:
            found["check"] = {
                each.name: {"expected": each.expected, "found": each.found, "errors_off": each.errors_off}
                for each in halves
            }
        typer.echo(json.dumps(found))
        return
    for name, number, _ in rows:
        typer.echo(f"{name:<26} " + ("none found" if number is None else f"{number[0]:.5g} ± {number[1]:.2g}"))
    for each in halves:
        typer.echo(
            f"second half, {each.name:<13} {each.found:.5g}, by the first {each.expected[0]:.5g} ± "
            f"{each.expected[1]:.2g}: {each.errors_off:.1f} errors off"
        )


def _counted(recording: str, size: Size | None, counts: Counts | None = None) -> tuple[Counts, Size]:
    """Return the counts with those of a recording, and the sensor's size, which the first recording tells of all."""
    with open_events(recording) as source:
        size = sensor_size(recording, source, size)
        counts = counts or Counts.of_size(*size)
        counts.add(source)
    return counts, size


def _between(batches: Iterable[EventBatch], begin_us: int, end_us: int) -> Iterable[EventBatch]:
    for batch in batches:
        low, high = np.searchsorted(batch["t"], (begin_us, end_us))
        yield batch[low:high]
