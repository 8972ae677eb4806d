"""A sensor drawn: what a user wants to know of it before choosing it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from clsim.cli.figure import new_figure
from clsim.errors import InputError
from clsim.sensor import SensorSettings, characteristics

_ON, _OFF, _LINE = "#0072B2", "#D55E00", "#333333"
"""Blue, vermilion of Okabe and Ito, which colour-blind people tell apart; and a dark grey."""
_LUX = np.logspace(-2, 4, 25)
_WATCHED_LUX = np.logspace(-2, 4, 19)
_LONGEST_LISTED = 24


def plot_sensor(settings: SensorSettings, file: str | Path, seed: int = 0) -> None:
    """Draw noise, bandwidth and latency against light, thresholds, responses to contrast, and the numbers, into a PNG.

    Raises:
        InputError: matplotlib is not installed, or the file cannot be written.
    """
    figure = new_figure("a sensor", 15, 8)
    if not Path(file).absolute().parent.is_dir():
        # Told before the seconds that measuring takes.
        raise InputError(f"cannot write {file}: there is no folder {Path(file).parent}")
    draw: tuple[Callable[[Any, SensorSettings, int], None], ...] = (
        _draw_noise,
        _draw_bandwidth,
        _draw_latency,
        _draw_thresholds,
        _draw_responses,
        _write_numbers,
    )
    for panel, each in zip(figure.subplots(2, 3).flat, draw, strict=True):
        each(panel, settings, seed)
    figure.suptitle(settings.name, fontsize=14)
    try:
        figure.savefig(file, format="png", dpi=100)
    except OSError as error:
        raise InputError(f"cannot write {file}: {error.strerror}") from None


def _axes(panel: Any, title: str, x: str, y: str, *, light: bool = False) -> None:
    panel.set(title=title, xlabel=x, ylabel=y)
    panel.grid(alpha=0.25, which="major", linewidth=0.5)
    if light:
        panel.set_xscale("log")
        panel.set_xlim(_LUX[0], _LUX[-1])


def _nothing(panel: Any, what: str) -> None:
    panel.text(0.5, 0.5, what, transform=panel.transAxes, ha="center", va="center", color=_LINE)


def _draw_noise(panel: Any, settings: SensorSettings, seed: int) -> None:
    rates = characteristics.noise_rates(settings, _WATCHED_LUX, seed)
    watched = characteristics.PIXELS * rates.seconds
    _axes(panel, "Noise of a pixel, none of the hot ones", "illuminance [lux]", "events [1/s]", light=True)
    found = False
    for hz, colour, name in ((rates.on_hz, _ON, "ON: leak and noise"), (rates.off_hz, _OFF, "OFF: noise")):
        if hz.any():
            found = True
            # A rate is known as well as the number of its events is.
            panel.errorbar(rates.lux, hz, np.sqrt(hz / watched), color=colour, marker="o", ms=3, lw=1, label=name)
    if found:
        panel.set_yscale("log")
        panel.margins(y=0.3)
        panel.legend(frameon=False)
    else:
        _nothing(panel, "none")


def _draw_bandwidth(panel: Any, settings: SensorSettings, seed: int) -> None:
    hz = characteristics.bandwidth_hz(settings.front_end, _LUX)
    _axes(panel, "Bandwidth", "illuminance [lux]", "−3 dB [Hz]", light=True)
    if np.isinf(hz).any():
        _nothing(panel, "no limit")
        return
    panel.plot(_LUX, hz, color=_LINE)
    panel.set_yscale("log")


def _draw_latency(panel: Any, settings: SensorSettings, seed: int) -> None:
    latencies = characteristics.step_latencies(settings, _LUX, seed)
    _axes(panel, "Time to the first event, 10 to 90 % of pixels", "illuminance before [lux]", "[µs]", light=True)
    rows = (latencies.on_s, _ON, "light is doubled: ON"), (latencies.off_s, _OFF, "halved: OFF")
    for (low, middle, high), colour, name in rows:
        panel.plot(latencies.lux, middle * 1e6, color=colour, label=name)
        panel.fill_between(latencies.lux, low * 1e6, high * 1e6, color=colour, alpha=0.2, linewidth=0)
    panel.set_yscale("log")
    panel.legend(frameon=False)


def _draw_thresholds(panel: Any, settings: SensorSettings, seed: int) -> None:
    on, off = characteristics.thresholds(settings, seed=seed)
    _axes(panel, "Contrast thresholds of pixels", "[natural-log units]", "pixels [%]")
    middle, spread = np.mean([on, off]), max(np.std([on, off]), 0.01 * np.mean([on, off]))
    bins = np.linspace(middle - 4 * spread, middle + 4 * spread, 49)
    for found, colour, name in ((on, _ON, "ON"), (off, _OFF, "OFF")):
        label = f"{name}: {found.mean():.3f} ± {found.std():.3f}"
        panel.hist(found, bins, weights=np.full(len(found), 100 / len(found)), color=colour, alpha=0.5, label=label)
    panel.legend(frameon=False)


def _draw_responses(panel: Any, settings: SensorSettings, seed: int) -> None:
    responses = characteristics.step_responses(settings, seed)
    title = f"Pixels that fire within 10 ms of a step, at {characteristics.BRIGHT_LUX:g} lux"
    _axes(panel, title, "contrast [natural-log units]", "[%]")
    for share, colour, name in ((responses.on, _ON, "up: ON"), (responses.off, _OFF, "down: OFF")):
        panel.plot(responses.steps, 100 * share, color=colour, marker="o", ms=3, lw=1, label=name)
    panel.legend(frameon=False, loc="lower right")


def _write_numbers(panel: Any, settings: SensorSettings, seed: int) -> None:
    panel.axis("off")
    lines, marked = _numbers(settings)
    if marked:
        lines.append("")
        lines.append("* clsim's default, not measured of this camera")
    panel.text(0, 1, "\n".join(lines), transform=panel.transAxes, va="top", family="monospace", fontsize=9)


def _numbers(settings: SensorSettings) -> tuple[list[str], bool]:
    """Return the numbers of a sensor, a line each, and whether some have no source."""
    lines, marked = [], False
    for group in fields(settings):
        stage = getattr(settings, group.name)
        for number in fields(stage) if is_dataclass(stage) else ():
            value, default = getattr(stage, number.name), getattr(type(stage)(), number.name)
            if value == default:
                continue
            source = settings.sources.get(f"{group.name}.{number.name}", "")
            name = f"{group.name}.{number.name}"
            guessed = _is_default(settings, source)
            marked = marked or guessed
            lines.append(f"{name:<31}{'*' if guessed else ' '} {_short(value)}")
    return lines or ["the ideal pixel: nothing is on"], marked


def _is_default(settings: SensorSettings, source: str) -> bool:
    """Whether a source, or what it is said to be like, is a default of clsim's."""
    if source.startswith("as ") and source[3:] in settings.sources:
        return _is_default(settings, settings.sources[source[3:]])
    return source.startswith("clsim's default")


def _short(value: Any) -> str:
    text = ", ".join(f"{each:g}" for each in value) if isinstance(value, tuple) else f"{value:g}"
    return text if len(text) <= _LONGEST_LISTED else text[: _LONGEST_LISTED - 2] + " …"
