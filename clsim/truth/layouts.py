"""The layouts of data sets that truth is written in, by the ending of their names."""

from __future__ import annotations

import importlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from clsim.errors import InputError
from clsim.events.sockets.address import is_address
from clsim.truth.names import truth_names

if TYPE_CHECKING:
    from clsim.truth.record import About, Layout


@dataclass(frozen=True)
class LayoutKind:
    """One layout: its name, endings, the module that writes it, and what of truth it can hold.

    Attributes:
        name: what it is called.
        endings: of the names of its files or folders.
        module: within clsim.truth.formats; has ``open_layout(path, about)``.
        holds: names of `TRUTH_NAMES`.
        folder: whether it is a folder.
        calibrated: whether it always tells intrinsics, which not every lens has.
    """

    name: str
    endings: tuple[str, ...]
    module: str
    holds: tuple[str, ...]
    folder: bool = False
    calibrated: bool = False

    def load(self) -> Any:
        """Import the module."""
        return importlib.import_module(f"clsim.truth.formats.{self.module}")


_ALL = (
    "intensity", "image", "depth", "distance", "normal", "albedo", "ids", "flow", "backward-flow", "labels",
    "poses", "imu",
)  # fmt: skip
_DSEC = ("intensity", "image", "depth", "ids", "flow", "backward-flow", "poses", "imu")
LAYOUTS = (
    LayoutKind("clsim", (".h5", ".hdf5"), "hdf5", _ALL),
    LayoutKind("dsec", (".dsec",), "dsec", _DSEC, folder=True, calibrated=True),
    LayoutKind("mvsec", (".mvsec",), "mvsec", ("intensity", "image", "depth", "flow", "poses", "imu"), folder=True),
    LayoutKind("ecd", (".ecd",), "ecd", ("intensity", "image", "depth", "poses", "imu"), folder=True, calibrated=True),
    LayoutKind("tumvie", (".tumvie",), "tumvie", ("intensity", "image", "poses", "imu"), folder=True, calibrated=True),
    LayoutKind("event_utils", (".event_utils",), "event_utils", ("intensity", "image", "flow"), folder=True),
    LayoutKind("tum", (".tum",), "tum", ("poses",)),
    LayoutKind("ros", (".mcap", ".db3", ".bag"), "ros", ("intensity", "image", "depth", "flow", "poses", "imu")),
)
"""Every layout. A file that is one with truth may be a plain event file without."""


def layout_of(name: str) -> LayoutKind | None:
    """Return the layout that the ending of an output's name tells; None for other outputs."""
    if is_address(name):
        return None
    plain = name.rstrip("/").lower()
    return next((kind for kind in LAYOUTS if plain.endswith(kind.endings)), None)


def held_by(outputs: Sequence[str], asked: Sequence[str]) -> tuple[str, ...]:
    """Return what is recorded of the truth that is asked for; ``all`` is all that one of the outputs can hold.

    Raises:
        InputError: a name is unknown, or fits none of the outputs.
    """
    names = truth_names(asked)
    if not names or not outputs:
        return names
    kinds = [(name, kind) for name in outputs if (kind := layout_of(name)) is not None]
    if not kinds:
        endings = ", ".join(ending for kind in LAYOUTS for ending in kind.endings)
        raise InputError(f"`truth` needs an output that can hold it; name one in `outputs` that ends in {endings}")
    for name in asked:
        if name != "all" and not any(name in kind.holds for _, kind in kinds):
            able = ", ".join(kind.endings[0] for kind in LAYOUTS if name in kind.holds)
            raise InputError(f"`truth` {name} fits none of the outputs; name one in `outputs` that ends in {able}")
    return tuple(name for name in names if any(name in kind.holds for _, kind in kinds))


def check_place(name: str) -> None:
    """Raise InputError where a layout could not be written, without touching anything."""
    kind, path = layout_of(name), Path(name)
    if not os.path.isdir(path.parent):
        raise InputError(f"{name}: there is no folder {path.parent}")
    if kind is not None and kind.folder:
        if os.path.exists(path) and (not os.path.isdir(path) or os.listdir(path)):
            raise InputError(f"{name}: is there already; expected a new name or an empty folder")
    elif os.path.isdir(path):
        raise InputError(f"{name} is a folder, expected a file")
    if not os.access(path if os.path.exists(path) else path.parent, os.W_OK):
        raise InputError(f"{name}: permission denied")


def open_layout(name: str, about: About) -> Layout:
    """Open an output that has a layout; raises InputError when it cannot be."""
    kind = layout_of(name)
    assert kind is not None, "only outputs with a layout are opened here"
    if kind.calibrated and about.camera.get("model") == "orthographic":
        raise InputError(f"{name}: needs intrinsics as OpenCV has them, and an orthographic camera has none")
    layout: Layout = kind.load().open_layout(Path(name), about)
    return layout
