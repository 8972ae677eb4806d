"""``clsim sensor``: which cameras there are, what they are like, and what a recording tells of one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from clsim.cli.options import parse
from clsim.cli.options.shared import JSON, SENSOR_SIZE
from clsim.errors import InputError

if TYPE_CHECKING:
    from clsim.sensor import SensorSettings

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
    from clsim.cli.plots.sensor_plot import plot_sensors

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
    lux: Annotated[
        str | None,
        typer.Option(
            metavar="LUX,LUX…",
            help="Illuminances of the recordings, which show even scenes: thresholds, photons and leak by noise alone.",
        ),
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Fit each recording's first half, and tell how well it predicts the second.")
    ] = False,
    resolution: SENSOR_SIZE = None,
    as_json: JSON = False,
) -> None:
    """Find a camera's numbers from its recordings: leak, noise, hot pixels; with a lamp, thresholds and rest too.

    docs/sensor-fit.md says how to record. Each number comes with its standard error.

    Examples: `clsim sensor fit still.aedat4 --out mine.toml`,
    `clsim sensor fit still.raw --lamp lamp.raw --contrast 0.5 --base davis346 --out mine.toml`
    """
    from clsim.cli.output.sensor_fits import fit_lights, fit_scenes, predict, tell
    from clsim.events.formats.filesink import PartFile

    if (lamp is None) != (contrast is None):
        raise InputError("--lamp and --contrast belong together; give both")
    if lux is not None and (lamp is not None or check):
        raise InputError("--lux is of even scenes alone; give it without --lamp and --check")
    _check_ending(out, ".toml")
    if base is not None:
        _load(base, "--base")
        if Path(base).suffix.lower() == ".toml" and out.exists() and out.samefile(base):
            raise InputError(f"--out {out} is the file that --base names; choose another name")
        base = str(Path(base).absolute()) if Path(base).suffix.lower() == ".toml" else base
    part = PartFile(out)
    try:
        size = None if resolution is None else parse.resolution(resolution)
        told = ", ".join(Path(each).name for each in (*recordings, *([] if lamp is None else [lamp])))
        if lux is not None:
            text, rows = fit_lights(recordings, parse.numbers(lux, "--lux"), size, out.stem, told, base)
        else:
            text, rows = fit_scenes(recordings, lamp, contrast, size, out.stem, told, base)
        halves = predict(recordings, size) if check else []
        part.part.write_text(text, encoding="utf-8")
        part.complete()
    finally:
        part.discard()
    tell(rows, halves, as_json=as_json)


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
