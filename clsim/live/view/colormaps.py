"""Colour maps for event images, told apart by people of every colour vision.

Each map joins a colour for "nothing" to one ramp for OFF and one for ON, on a dark and on a light ground. The pairs
differ in hue *and* stay apart when the difference of red and green is taken away. One more map has a ramp for each
cause of events, in hues of Okabe and Ito (Color Universal Design, 2008), and one for each colour filter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from clsim.errors import require_choice
from clsim.events import CAUSES

Theme = Literal["dark", "light"]
Lut = npt.NDArray[np.uint8]

ZERO = 128
"""Index of "nothing" in a table; OFF lies below it down to 1, ON above it up to 255."""
DEFAULT = "blue-orange"
CAUSE = "cause"
"""The map of causes: index CAUSE_LEVELS · cause is "nothing", and from there the ramp of that cause goes up."""
CAUSE_LEVELS = 256 // len(CAUSES)
FILTER = "filter"
"""The map of colour filters, likewise; the rest of the table is not used."""


@dataclass(frozen=True)
class _Ramps:
    rest: str
    off: tuple[str, ...]
    on: tuple[str, ...]


_MAPS: dict[str, dict[Theme, _Ramps]] = {
    "blue-orange": {
        "dark": _Ramps("0b0e14", ("1a5a9e", "3d9bff", "a8d3ff"), ("a85a0a", "ff9d2e", "ffd9a0")),
        "light": _Ramps("ffffff", ("a9cff5", "1f6fd0", "08306b"), ("ffcf94", "e2660a", "7f2f00")),
    },
    "purple-green": {
        "dark": _Ramps("0d0c11", ("6a2c9c", "b060f5", "d8a8ff"), ("1d7a40", "4fd684", "9cf7bf")),
        "light": _Ramps("ffffff", ("d3b7e3", "7b2f96", "3f0050"), ("a9dfb0", "1a8043", "00441b")),
    },
    "violet-yellow": {
        "dark": _Ramps("0c0b12", ("4a35a8", "7c68f5", "b3a8ff"), ("8a7600", "ffdf3d", "ffee8a")),
        "light": _Ramps("ffffff", ("bcb3f0", "5a45c9", "241070"), ("f4dd7a", "c79a00", "6b5000")),
    },
    "grey": {
        "dark": _Ramps("70757d", ("454a51", "14171b", "000000"), ("a3a8af", "e4e7ea", "ffffff")),
        "light": _Ramps("9aa0a8", ("62676e", "2a2e33", "000000"), ("cbd0d6", "f2f4f6", "ffffff")),
    },
}
_FILTER_RAMPS: dict[Theme, dict[str, tuple[str, ...]]] = {
    "dark": {
        "red": ("8a1f1f", "ff4a3d", "ff8f85"),
        "green": ("1a6b2a", "3fd65a", "9cf7ac"),
        "blue": ("24409c", "4f7dff", "a3bcff"),
    },
    "light": {
        "red": ("ffb3ab", "e02b1d", "7f0f07"),
        "green": ("a9dfb0", "1a9a3a", "00441b"),
        "blue": ("b3c4ff", "2a55e0", "081f6b"),
    },
}
_CAUSE_RAMPS: dict[Theme, dict[str, tuple[str, ...]]] = {
    "dark": {
        "signal": ("1f5f86", "56b4e9", "8fd0f5"),
        "shot": ("8a5f00", "e69f00", "ffc24d"),
        "leak": ("04684c", "00b484", "3fdcae"),
        "hot": ("8d9299", "f2f4f6", "ffffff"),
    },
    "light": {
        "signal": ("a9d6f0", "2f8fcc", "0b4a75"),
        "shot": ("ffd58a", "e08a00", "8a5200"),
        "leak": ("8fdcc3", "009e73", "005a41"),
        "hot": ("9aa0a8", "2a2e33", "000000"),
    },
}
_KIND_RAMPS = {CAUSE: _CAUSE_RAMPS, FILTER: _FILTER_RAMPS}
NAMES = tuple(_MAPS)
"""Those of ON and OFF."""
KINDS = tuple(_KIND_RAMPS)
"""Those of kinds of events."""


def lut(name: str = DEFAULT, theme: Theme = "dark") -> Lut:
    """Return the table uint8 ``[256, 3]`` of a map; raises InputError for an unknown name."""
    require_choice("the colour map", name, (*NAMES, *KINDS))
    if name in _KIND_RAMPS:
        nothing = _rgb(_MAPS[DEFAULT][theme].rest)
        kinds = _KIND_RAMPS[name][theme].values()
        parts = [_ramp([nothing, *map(_rgb, ramp)], CAUSE_LEVELS) for ramp in kinds]
        return np.resize(np.rint(np.concatenate(parts)), (256, 3)).astype(np.uint8)
    ramps = _MAPS[name][theme]
    rest = _rgb(ramps.rest)
    table = np.empty((256, 3))
    table[ZERO:] = _ramp([rest, *map(_rgb, ramps.on)], 256 - ZERO)
    table[1 : ZERO + 1] = _ramp([rest, *map(_rgb, ramps.off)], ZERO)[::-1]
    table[0] = table[1]
    return np.rint(table).astype(np.uint8)


def _rgb(text: str) -> npt.NDArray[np.float64]:
    return np.array([int(text[i : i + 2], 16) for i in (0, 2, 4)], dtype=np.float64)


def _ramp(stops: list[npt.NDArray[np.float64]], count: int) -> npt.NDArray[np.float64]:
    at = np.linspace(0.0, len(stops) - 1.0, count)
    table = np.array(stops)
    return np.stack([np.interp(at, np.arange(len(stops)), table[:, c]) for c in range(3)], axis=1)
