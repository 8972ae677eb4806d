"""``clsim sensor``: which cameras there are, what they are like, and what a recording tells of one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from clsim.cli import parse
from clsim.cli.options import JSON, SENSOR_SIZE
from clsim.errors import InputError

if TYPE_CHECKING:
    from clsim.sensor import SensorSettings
    from clsim.sensor.fit_flicker import FlickerFit
    from clsim.sensor.fit_still import Counts, StillFit

sensor = typer.Typer(help="Look at simulated cameras, and fit one to recordings.", no_args_is_help=True)


@sensor.command()
def plot(
    names: Annotated[
        list[str], typer.Argument(metavar="NAME|FILE…", help="Presets, such as davis346, or .toml files; up to eight.")
    ],
    out: Annotated[Path, typer.Option(help="The picture, as PNG.")],
    seed: Annotated[int, typer.Option(min=0, help="Seed of all random numbers.")] = 0,
) -> None:
    """Draw what a camera is like: noise, bandwidth and latency against light, thresholds, response to contrast.

    Several are drawn over each other, with what their readouts let through. All but the bandwidth is measured of
    simulated pixels. Needs the [plot] extra.

    Examples: `clsim sensor plot davis346 --out davis346.png`,
    `clsim sensor plot davis346 dvxplorer gen4.1 --out three.png`
    """
    from clsim.cli.sensor_plot import plot_sensors

    _check_ending(out, ".png")
    plot_sensors([_load(name, "sensor plot") for name in names], out, seed)
    typer.echo(out)


@sensor.command()
def fit(
    recordings: Annotated[
        list[str], typer.Argument(metavar="RECORDING…", help="Events of a still scene, steadily lit.")
    ],
    out: Annotated[Path, typer.Option(help="The sensor file to write, as TOML; --sensor takes it.")],
    lamp: Annotated[
        str | None, typer.Option(metavar="RECORDING", help="Events of a lamp whose light is a slow sine.")
    ] = None,
    contrast: Annotated[
        float | None, typer.Option(help="The lamp's (brightest − darkest) / (brightest + darkest), from 0 to 1.")
    ] = None,
    base: Annotated[
        str | None, typer.Option(metavar="NAME|FILE", help="The sensor that says what is not fitted. [ideal]")
    ] = None,
    resolution: SENSOR_SIZE = None,
    as_json: JSON = False,
) -> None:
    """Find a camera's numbers from its recordings: leak, noise, hot pixels; with a lamp, thresholds and rest too.

    docs/sensor.md says how to record. Each number comes with its standard error.

    Examples: `clsim sensor fit still.aedat4 --out mine.toml`,
    `clsim sensor fit still.raw --lamp lamp.raw --contrast 0.5 --base davis346 --out mine.toml`
    """
    from clsim.events.filesink import PartFile
    from clsim.sensor.fitted import fitted_rows, sensor_file

    if (lamp is None) != (contrast is None):
        raise InputError("--lamp and --contrast belong together; give both")
    _check_ending(out, ".toml")
    if base is not None:
        _load(base, "--base")
        if Path(base).suffix.lower() == ".toml" and out.exists() and out.samefile(base):
            raise InputError(f"--out {out} is the file that --base names; choose another name")
        base = str(Path(base).absolute()) if Path(base).suffix.lower() == ".toml" else base
    part = PartFile(out)
    try:
        size, still, flicker = _fitted(recordings, lamp, contrast, resolution)
        rows = list(fitted_rows(still, flicker))
        told = ", ".join(Path(each).name for each in (*recordings, *([] if lamp is None else [lamp])))
        part.part.write_text(sensor_file(out.stem, size, rows, told, base), encoding="utf-8")
        part.complete()
    finally:
        part.discard()
    if as_json:
        typer.echo(json.dumps({name: number for name, number, _ in rows}))
        return
    for name, number, _ in rows:
        typer.echo(f"{name:<24} " + ("none found" if number is None else f"{number[0]:.5g} ± {number[1]:.2g}"))


def _check_ending(out: Path, ending: str) -> None:
    """Raise InputError where a file of another kind, such as the recording itself, would be written over."""
    if out.suffix.lower() != ending:
        raise InputError(f"--out {out}: the ending is wrong; expected NAME{ending}")


def _load(name: str, option: str) -> SensorSettings:
    """Return a sensor; a message that there is none names what the user wrote."""
    from clsim.sensor import load_sensor

    try:
        return load_sensor(name)
    except InputError as error:
        raise InputError(str(error).replace("`sensor`", option, 1)) from None


def _fitted(
    recordings: list[str], lamp: str | None, contrast: float | None, resolution: str | None
) -> tuple[tuple[int, int], StillFit, FlickerFit | None]:
    """Return the sensor's size, and what the recordings tell."""
    from clsim.events.open import open_events, sensor_size
    from clsim.sensor.fit_flicker import fit_flicker
    from clsim.sensor.fit_still import Counts, fit_still

    counts: Counts | None = None
    size = None if resolution is None else parse.resolution(resolution)
    for name in recordings:
        with open_events(name) as source:
            # The first recording tells the size of all.
            size = sensor_size(name, source, size)
            counts = counts or Counts.of_size(*size)
            counts.add(source)
    assert counts is not None and size is not None, "the command line asks for a recording at least"
    still = fit_still(counts)
    if lamp is None or contrast is None:
        return size, still, None
    with open_events(lamp) as source:
        flicker = fit_flicker(source, *size, contrast, ~still.hot)
    if flicker.mismatch[0] > min(flicker.on[0], flicker.off[0]):
        # What is no flicker fits thresholds of nothing, which differ by more than they are.
        raise InputError(f"{lamp}: is no recording of a lamp whose light is a sine of contrast {contrast:g}")
    return size, still, flicker
