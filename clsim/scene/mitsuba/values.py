"""The values in Mitsuba's XML: numbers, words, points, and colours out of spectra."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from clsim.errors import InputError
from clsim.scene.files import named_file
from clsim.scene.light.spectra import EQUAL_ENERGY, blackbody_radiance, blackbody_rgb, rgb_of_light, rgb_of_reflectance
from clsim.scene.pictures.images import decode_srgb
from clsim.scene.world import Vec3, scaled


@dataclass
class Element:
    """An XML element and where it stands."""

    tag: str
    attributes: dict[str, str]
    place: str
    children: list[Element] = field(default_factory=list)


@dataclass(frozen=True)
class Color:
    """A colour, as opposed to three numbers."""

    rgb: Vec3


@dataclass(frozen=True)
class Setting:
    """Where a value stands.

    Attributes:
        folder: where its files lie.
        legacy: whether the file is of a version before 2.
        emits: whether it belongs to something that emits.
    """

    folder: Path
    legacy: bool
    emits: bool


def value_of(element: Element, attributes: dict[str, str], setting: Setting) -> Any:
    """Return what a property stands for; raises InputError with file and line."""
    place, tag, text = element.place, element.tag, attributes.get("value", "")
    if tag == "string":
        return text
    if tag == "boolean":
        if text.lower() not in ("true", "false"):
            raise InputError(f"{place}: got {text!r}, expected true or false")
        return text.lower() == "true"
    if tag in ("float", "integer"):
        return numbers(place, text, (1,))[0]
    if tag in ("point", "vector"):
        if "value" in attributes:
            return np.array(numbers(place, text, (3,)))
        return np.array([numbers(place, attributes.get(axis, "0"), (1,))[0] for axis in "xyz"])
    if tag == "blackbody":
        scale = numbers(place, attributes.get("scale", "1"), (1,))[0]
        r, g, b = blackbody_rgb(_temperature(place, attributes.get("temperature", text)))
        return Color((r * scale, g * scale, b * scale))
    if tag == "spectrum":
        return Color(_spectrum(element, attributes, setting))
    return Color(_color(place, tag, text))


def _spectrum(element: Element, attributes: dict[str, str], setting: Setting) -> Vec3:
    """Return the colour of a spectrum as Mitsuba 3 converts it: light as it is, reflectances as seen by daylight."""
    place, text = element.place, attributes.get("value", "")
    convert = rgb_of_light if setting.emits else rgb_of_reflectance
    if "type" in attributes:
        return _named_spectrum(element, attributes["type"], setting)
    if "filename" in attributes:
        return convert(*_table(place, file_of(place, attributes["filename"], setting.folder)))
    if ":" in text:
        pairs = [pair.split(":") for pair in re.split(r"[\s,]+", text.strip().strip(","))]
        if any(len(pair) != 2 for pair in pairs):
            raise InputError(f"{place}: got {text[:60]!r}, expected wavelength:value pairs")
        return convert(*_increasing(place, [[numbers(place, x, (1,))[0] for x in pair] for pair in pairs]))
    r, g, b = _color(place, "spectrum", text)
    if setting.emits and not setting.legacy and r == g == b and len(text.replace(",", " ").split()) == 1:
        return r * EQUAL_ENERGY[0], g * EQUAL_ENERGY[1], b * EQUAL_ENERGY[2]
    return r, g, b


def _named_spectrum(element: Element, kind: str, setting: Setting) -> Vec3:
    """Return the colour of a spectrum that is an object with properties of its own."""
    place = element.place
    own = {child.attributes.get("name", ""): child.attributes.get("value", "") for child in element.children}
    convert = rgb_of_light if setting.emits else rgb_of_reflectance
    if kind in ("d65", "uniform"):  # the white that all colours are balanced to
        value = numbers(place, own.get("value", own.get("scale", "1")), (1,))[0]
        return scaled(_color(place, "rgb", own.get("color", "1")), value)
    if kind == "blackbody":
        return blackbody_radiance(_temperature(place, own.get("temperature", "")))
    if kind in ("regular", "irregular"):
        values = numbers(place, own.get("values", ""), tuple(range(2, 10_000)))
        if kind == "irregular":
            wavelengths = numbers(place, own.get("wavelengths", ""), (len(values),))
        else:
            low, high = (numbers(place, own.get(f"wavelength_{end}", ""), (1,))[0] for end in ("min", "max"))
            wavelengths = np.linspace(low, high, len(values)).tolist()
        return convert(*_increasing(place, np.column_stack([wavelengths, values]).tolist()))
    raise InputError(
        f"{place}: got a spectrum of type {kind!r}, expected d65, uniform, blackbody, regular or irregular"
    )


def _temperature(place: str, text: str) -> float:
    temperature = numbers(place, text.strip().rstrip("kK"), (1,))[0]
    if not 100 <= temperature <= 100_000:
        raise InputError(f"{place}: temperature is {temperature:g} K, expected 100 to 100000")
    return temperature


def _table(place: str, path: Path) -> tuple[list[float], list[float]]:
    try:
        rows = np.loadtxt(path, comments="#", ndmin=2, dtype=np.float64)
    except (ValueError, OSError) as error:
        raise InputError(f"{path}: is no table of wavelengths and values ({error})") from None
    return _increasing(place, rows.tolist())


def _increasing(place: str, rows: list[list[float]]) -> tuple[list[float], list[float]]:
    """Return wavelengths and values; raises InputError unless the wavelengths increase."""
    table = np.array(rows, np.float64)
    if table.ndim != 2 or table.shape[1] != 2 or not np.isfinite(table).all() or (np.diff(table[:, 0]) <= 0).any():
        raise InputError(f"{place}: its spectrum is no table of increasing wavelengths and finite values")
    return table[:, 0].tolist(), table[:, 1].tolist()


def _color(place: str, tag: str, text: str) -> Vec3:
    if text.startswith("#"):
        if not re.fullmatch(r"#[0-9a-fA-F]{6}", text):
            raise InputError(f"{place}: got {text[:60]!r}, expected # and six hexadecimal digits")
        r, g, b = decode_srgb([int(text[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]).tolist()
        return r, g, b
    found = numbers(place, text, (1, 3))
    if tag == "srgb":
        found = decode_srgb(found).tolist()
    r, g, b = found if len(found) == 3 else found * 3
    return r, g, b


def shown(value: Any) -> str:
    """Return what a property is, on one line."""
    if isinstance(value, str | float | bool):
        return repr(value)
    if isinstance(value, Color):
        return "a colour"
    return "a point" if np.shape(value) == (3,) else "a transform"


def numbers(place: str, text: str, counts: tuple[int, ...]) -> list[float]:
    """Return the numbers in a text; raises InputError unless there are as many as one of the counts, all finite."""
    try:
        found = [float(word) for word in re.split(r"[\s,]+", text.strip())]
    except ValueError:
        found = []
    if len(found) not in counts or not all(np.isfinite(found)):
        raise InputError(f"{place}: got {text[:60]!r}, expected {' or '.join(map(str, counts))} numbers")
    return found


def file_of(place: str, name: str, folder: Path) -> Path:
    """Return the path of a file that a scene names; raises InputError if there is none."""
    try:
        return named_file(name, folder)
    except InputError as error:
        raise InputError(f"{place}: {error}") from None
