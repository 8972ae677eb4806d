"""One EXR file as arrays of its display window: windows, parts, luminance and chroma.

Source: Kainz et al., Technical Introduction to OpenEXR, https://openexr.com
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.frames.frame import FloatArray
from clsim.frames.primaries import luminance_weights, to_rec709

_MOST_PIXELS = 1 << 27
_WINDOWS = ("dataWindow", "displayWindow")


class _Window(NamedTuple):
    left: int
    top: int
    right: int
    bottom: int

    @property
    def shape(self) -> tuple[int, int]:
        return self.bottom - self.top + 1, self.right - self.left + 1


def read_channels(
    file: Path, *, colours: bool = True, check_size: Callable[[int, int], None] | None = None
) -> tuple[dict[str, npt.NDArray[Any]], dict[str, Any]]:
    """Read all channels ``[H, W]``, of a multi-part file as ``part.channel``, and the first part's header.

    H and W are those of the display window. Pixels that a part's data window does not hold are 0, depths of Blender's
    are infinite there. Of files of luminance, with or without chroma, R, G and B are made. Colours are Rec. 709's, or
    with ``colours`` false as they are. ``check_size`` is told the width and height of the largest window before any
    pixel is read.

    Raises:
        InputError: the file cannot be read, is deep, or its parts have different display windows.
    """
    import OpenEXR

    channels: dict[str, npt.NDArray[Any]] = {}
    try:
        with OpenEXR.File(str(file), header_only=True) as exr:
            parts = len(exr.parts)
            for part in exr.parts:
                _check_kind(file, part, parts)
            if check_size is not None:
                shapes = [_window(file, part.header, name).shape for part in exr.parts for name in _WINDOWS]
                check_size(*max(shapes, key=math.prod)[::-1])
        with OpenEXR.File(str(file), separate_channels=True) as exr:
            # OpenEXR drops parts whose pixels it cannot read, with no more than a warning.
            if len(exr.parts) < parts:
                raise InputError(f"{file} is truncated or damaged: its pixels cannot be read")
            header: dict[str, Any] = dict(exr.parts[0].header)
            shown = _window(file, header, "displayWindow")
            for part in exr.parts:
                if _window(file, part.header, "displayWindow") != shown:
                    raise InputError(f"{file}: its parts have different display windows, expected one picture")
                held = _window(file, part.header, "dataWindow")
                for name, channel in part.channels.items():
                    full = _full_name(part.name(), name) if parts > 1 else name
                    pixels = _spread(channel.pixels, (channel.xSampling, channel.ySampling), held)
                    channels[full] = _placed(pixels, held, shown, np.inf if full.endswith("Depth.Z") else 0)
    except (OSError, RuntimeError, ValueError, TypeError) as error:
        if isinstance(error, InputError):
            raise
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(f"cannot read {file} as EXR: {reason}") from None
    if not channels:
        raise InputError(f"{file} has no channels")
    _add_colours(channels, header)
    if colours:
        _to_rec709(channels, header)
    return channels, header


def held_pixels(header: dict[str, Any]) -> FloatArray:
    """Return 1 where a part of that header holds pixels of the display window ``[H, W]``, else 0."""
    held, shown = (_window(Path(), header, name) for name in _WINDOWS)
    return np.asarray(_placed(np.ones(held.shape, np.float32), held, shown, 0))


def _check_kind(file: Path, part: Any, parts: int) -> None:
    if "deep" in str(part.type()):
        which = f", in its part {part.name()}" if parts > 1 else ""
        raise InputError(f"{file} is a deep image{which}, with many depths in a pixel; expected a flat one")


def _window(file: Path, header: dict[str, Any], name: str) -> _Window:
    least, most = header[name]
    window = _Window(int(least[0]), int(least[1]), int(most[0]), int(most[1]))
    height, width = window.shape
    if min(height, width) < 1 or height * width > _MOST_PIXELS:
        raise InputError(f"{file}: its {name} has {width}×{height} pixels, expected 1 to {_MOST_PIXELS} of them")
    return window


def _placed(pixels: npt.NDArray[Any], held: _Window, shown: _Window, fill: float) -> npt.NDArray[Any]:
    """Return what the display window shows of the pixels of a data window."""
    if held == shown:
        return pixels
    if pixels.dtype.kind in "iu":
        fill = 0
    canvas = np.full(shown.shape, fill, pixels.dtype)
    left, right = max(held.left, shown.left), min(held.right, shown.right) + 1
    top, bottom = max(held.top, shown.top), min(held.bottom, shown.bottom) + 1
    if left < right and top < bottom:
        canvas[top - shown.top : bottom - shown.top, left - shown.left : right - shown.left] = pixels[
            top - held.top : bottom - held.top, left - held.left : right - held.left
        ]
    return canvas


def _spread(pixels: npt.NDArray[Any], sampling: tuple[int, int], held: _Window) -> npt.NDArray[Any]:
    """Return a channel that has only every so manyth sample at all pixels, linear between them."""
    across, down = sampling
    if (across, down) == (1, 1) or pixels.shape == held.shape:
        return pixels
    from scipy.ndimage import map_coordinates

    height, width = held.shape
    places = np.meshgrid(np.arange(height) / down, np.arange(width) / across, indexing="ij")
    return np.asarray(map_coordinates(pixels.astype(np.float32), places, order=1, mode="nearest"))


def _add_colours(channels: dict[str, npt.NDArray[Any]], header: dict[str, Any]) -> None:
    """Make R, G and B of luminance Y, and of RY = (R - Y) / Y and BY = (B - Y) / Y where there are these."""
    if "Y" not in channels or {"R", "G", "B", "X"} & set(channels):
        return
    luminance: FloatArray = channels["Y"].astype(np.float32)
    if "RY" not in channels or "BY" not in channels:
        channels |= dict.fromkeys("RGB", luminance)
        return
    red, green, blue = luminance_weights(header.get("chromaticities", ()))
    channels["R"] = (channels["RY"].astype(np.float32) + 1) * luminance
    channels["B"] = (channels["BY"].astype(np.float32) + 1) * luminance
    channels["G"] = (luminance - np.float32(red) * channels["R"] - np.float32(blue) * channels["B"]) / np.float32(green)


def _to_rec709(channels: dict[str, npt.NDArray[Any]], header: dict[str, Any]) -> None:
    """Make colours of a file's own primaries, as ACES has, those of Rec. 709."""
    matrix = to_rec709(header.get("chromaticities", ()))
    if matrix is None:
        return
    for group in [name[:-1] for name in channels if name == "R" or (name.endswith(".R") and "Variance" not in name)]:
        names = [f"{group}{letter}" for letter in "RGB"]
        if set(names) <= set(channels):
            colours = np.stack([channels[name].astype(np.float32) for name in names])
            channels |= dict(zip(names, np.tensordot(matrix, colours, 1), strict=True))


def _full_name(part: str | None, channel: str) -> str:
    """Join part and channel names: A.B + R, A.B + B.R and B + A.B.R all give A.B.R."""
    if not part:
        return channel
    parts, names = part.split("."), channel.split(".")
    for overlap in range(min(len(parts), len(names) - 1), 0, -1):
        if parts[-overlap:] == names[:overlap]:
            return ".".join(parts + names[overlap:])
    return channel if parts[-1] in names else f"{part}.{channel}"
