"""A sensor file from what was fitted: each number with its error and where it is from."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence

from clsim.sensor.fit.flicker import FlickerFit
from clsim.sensor.fit.still import StillFit
from clsim.sensor.fit.uniform import Rates, UniformFit

_SHORTEST_REST_US = 20.0
"""A lamp that is no exact sine, or noise, looks like a shorter one."""
Row = tuple[str, "tuple[float, float] | None", str]
"""A number's name, "stage.number", with its standard error; None where there is none of it. And what it is of."""
PHOTONS = ("look.photons_per_lux", "look.dark_photons", "look.s")
"""What is told of even scenes and no sensor file holds."""


def fitted_rows(still: StillFit, flicker: FlickerFit | None) -> Iterator[Row]:
    """Yield what was fitted, in the order of a sensor file."""
    if flicker is not None:
        yield "threshold.on", flicker.on, "lamp"
        yield "threshold.off", flicker.off, "lamp"
        yield "threshold.mismatch", flicker.mismatch, "lamp"
    yield "noise.on_hz", still.noise_hz, "OFF events of the still scene: noise is taken to be of both polarities alike"
    yield "noise.off_hz", still.noise_hz, "still scene"
    yield "noise.spread_decades", still.noise_decades, "still scene"
    leaks = still.leak_hz[0] > 3 * still.leak_hz[1]
    yield "leak.hz", still.leak_hz if leaks else None, "still scene"
    yield "leak.spread_decades", _own_spread(still, flicker) if leaks else None, "still scene"
    hot = bool(still.hot.any())
    yield "defects.hot_share", still.hot_share if hot else None, "still scene"
    yield "defects.hot_hz", still.hot_hz, "still scene"
    yield "defects.hot_spread_decades", still.hot_decades, "still scene"
    if flicker is not None:
        yield "defects.dead_share", flicker.silent_share if flicker.silent_share[0] > 0 else None, "lamp"
        rests = flicker.rest_us[0] > max(3 * flicker.rest_us[1], _SHORTEST_REST_US)
        yield "refractory.us", flicker.rest_us if rests else None, "lamp"


def uniform_rows(found: UniformFit) -> Iterator[Row]:
    """Yield what even scenes in several lights told: thresholds and leak, and the photons of a look."""
    of = f"noise in several lights, off by {found.misfit:.2g} squared errors on average"
    yield "threshold.on", found.on, of
    yield "threshold.off", found.off, of
    for name, number in (("hz", found.leak_hz), ("parasitic_hz_per_lux", found.leak_hz_per_lux)):
        yield f"leak.{name}", number if number[0] > 2 * number[1] else None, of
    for name, told in zip(PHOTONS, (found.photons_per_lux, found.dark_photons, found.look_s), strict=True):
        yield name, told, of


def noise_table(rates: Sequence[Rates], found: UniformFit) -> str:
    """Return the lines of ``[noise]`` that say the rates in each light, those of leak taken off ON events."""
    rising = sorted(rates, key=lambda each: each.lux)
    leaks = [found.leak_hz[0] + found.leak_hz_per_lux[0] * each.lux for each in rising]
    columns = {
        "lux": [each.lux for each in rising],
        "on_hz": [max(0.0, each.on_hz[0] - leak) for each, leak in zip(rising, leaks, strict=True)],
        "off_hz": [each.off_hz[0] for each in rising],
    }
    lines = [f"{name} = [{', '.join(f'{value:.5g}' for value in column)}]" for name, column in columns.items()]
    return "\n".join(["[noise]", *lines, "spread_decades = 0.0"])


def _own_spread(still: StillFit, flicker: FlickerFit | None) -> tuple[float, float]:
    """Return the leak's spread without that of the thresholds over which pixels leak, if it is known."""
    spread, error = still.leak_decades
    if flicker is None:
        return spread, error
    of_thresholds = flicker.mismatch[0] / flicker.on[0] / math.log(10)
    return max(spread**2 - of_thresholds**2, 0.0) ** 0.5, error


def sensor_file(
    name: str, size: tuple[int, int], rows: Sequence[Row], told: str, base: str | None = None, more: str = ""
) -> str:
    """Return the text of a sensor file.

    Args:
        name: of the sensor.
        size: width and height [pixels].
        rows: see `fitted_rows`.
        told: what the numbers are from, such as the recordings' names.
        base: the sensor that says what was not fitted. What was looked for and not seen is 0, whatever it says; but no
            threshold is.
        more: tables that stand there as they are.
    """
    lines = ["# Fitted by `clsim sensor fit`.", f"name = {_quoted(name)}"]
    if base is not None:
        lines.append(f"base = {_quoted(base)}")
    lines += ["", "[optics]", f"width = {size[0]}", f"height = {size[1]}"]
    sources = {"optics.width": told, "optics.height": told}
    stage = ""
    for row, number, of in rows:
        if row in PHOTONS or (number is None and (base is None or row.startswith("threshold"))):
            continue
        group, key = row.split(".")
        if group != stage:
            lines += ["", f"[{group}]"]
            stage = group
        value, told_error = (0.0, "none seen") if number is None else (number[0], f"± {number[1]:.2g}")
        lines.append(f"{key} = {value:.5g}")
        sources[row] = f"{told_error}; {of}; {told}"
    lines += ["", more] if more else []
    lines += ["", "[sources]", *(f"{_quoted(key)} = {_quoted(source)}" for key, source in sources.items())]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    # What JSON writes is TOML too.
    return json.dumps(text, ensure_ascii=False)
