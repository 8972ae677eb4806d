"""Sensors drawn: what a user wants to know of them before choosing one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from clsim.cli.plots.figure import new_figure
from clsim.errors import InputError
from clsim.sensor import SensorSettings, characteristics

_ON, _OFF, _LINE = "#0072B2", "#D55E00", "#333333"
"""Blue, vermilion of Okabe and Ito, which colour-blind people tell apart; and a dark grey."""
_LUX = np.logspace(-2, 4, 25)
_WATCHED_LUX = np.logspace(-2, 4, 19)
_ASKED_PER_S = np.logspace(5, 8.5, 15)
_LONGEST_LISTED = 24
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#999999")
"""Of Okabe and Ito, and a grey: one a camera."""


def plot_sensors(sensors: Sequence[SensorSettings], file: str | Path, seed: int = 0) -> None:
    """Draw one sensor with its numbers, or several over each other, into a PNG.

    Raises:
        InputError: matplotlib is not installed, there are more sensors than colours, or the file cannot be written.
    """
    if len(sensors) > len(_COLOURS):
        raise InputError(f"cannot tell more than {len(_COLOURS)} sensors apart in one picture, got {len(sensors)}")
    figure = new_figure("a sensor", 15, 8)
    if not Path(file).absolute().parent.is_dir():
        # Told before the seconds that measuring takes.
        raise InputError(f"cannot write {file}: there is no folder {Path(file).parent}")
    if len(sensors) == 1:
        _draw_one(figure, sensors[0], seed)
    else:
        _draw_over_each_other(figure, sensors, seed)
    try:
        figure.savefig(file, format="png", dpi=100)
    except OSError as error:
        raise InputError(f"cannot write {file}: {error.strerror}") from None


def _draw_one(figure: Any, settings: SensorSettings, seed: int) -> None:
    """Draw noise, bandwidth and latency against light, thresholds, responses to contrast, and the numbers."""
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


def _draw_over_each_other(figure: Any, sensors: Sequence[SensorSettings], seed: int) -> None:
    """Draw the same of several sensors, ON in full lines and OFF in broken ones; and what readouts let through."""
    noise, bandwidth, latency, thresholds, responses, readout = figure.subplots(2, 3).flat
    _axes(noise, "Noise of a pixel, none of the hot ones", "illuminance [lux]", "events [1/s]", light=True)
    _axes(bandwidth, "Bandwidth", "illuminance [lux]", "−3 dB [Hz]", light=True)
    _axes(latency, "Time to the first event, half of the pixels", "illuminance before [lux]", "[µs]", light=True)
    _axes(thresholds, "Contrast thresholds of pixels", "[natural-log units]", "pixels below [%]")
    title = f"Pixels that fire within 10 ms of a step, at {characteristics.BRIGHT_LUX:g} lux"
    _axes(responses, title, "contrast [natural-log units]", "[%]")
    _axes(readout, "Readout: pixels ask at random times", "asked for [events/s]", "read [events/s]")
    for settings, colour in zip(sensors, _COLOURS, strict=False):
        rates = characteristics.noise_rates(settings, _WATCHED_LUX, seed)
        latencies = characteristics.step_latencies(settings, _LUX, seed)
        found = characteristics.thresholds(settings, seed=seed)
        shares = characteristics.step_responses(settings, seed)
        for style, hz, late_s, of_pixels, share in (
            ("-", rates.on_hz, latencies.on_s, found[0], shares.on),
            ("--", rates.off_hz, latencies.off_s, found[1], shares.off),
        ):
            line = {"color": colour, "linestyle": style, "linewidth": 1.2}
            noise.plot(rates.lux, np.where(hz > 0, hz, np.nan), **line)
            latency.plot(latencies.lux, late_s[1] * 1e6, **line)
            thresholds.plot(np.sort(of_pixels), np.linspace(0, 100, len(of_pixels)), **line)
            responses.plot(shares.steps, 100 * share, **line)
        hz = characteristics.bandwidth_hz(settings.front_end, _LUX)
        bandwidth.plot(_LUX, np.where(np.isinf(hz), np.nan, hz), color=colour)
        read = characteristics.read_rates(settings, _ASKED_PER_S, seed)
        readout.plot(_ASKED_PER_S, read, color=colour, label=settings.name)
    for panel in (noise, bandwidth, latency, readout):
        panel.set_yscale("log")
    readout.set_xscale("log")
    readout.legend(frameon=False, title="ON: full lines, OFF: broken ones")


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
        lines.append("* a guess, or another camera's")
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
    """Whether a source, or what it is said to be like, is none of this camera."""
    if source.startswith("as ") and source[3:] in settings.sources:
        return _is_default(settings, settings.sources[source[3:]])
    return source.startswith(("guess", "shared"))


def _short(value: Any) -> str:
    if isinstance(value, tuple):
        text = ", ".join(f"{each:g}" for each in value)
    else:
        text = value if isinstance(value, str) else "yes" if value is True else f"{value:g}"
    return text if len(text) <= _LONGEST_LISTED else text[: _LONGEST_LISTED - 2] + " …"
