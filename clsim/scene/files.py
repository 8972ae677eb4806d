"""Where a scene's file may point.

A scene description (TOML, Mitsuba, pbrt) is its user's own: it may name any ordinary file, above its folder and through
links too, as in the renderers that it was written for. An asset (glTF, OBJ) often comes from strangers: it may name
what lies in its own folder, and in the folders that its user lists in the variable ``CLSIM_ASSET_FOLDERS``.
"""

from __future__ import annotations

import importlib.util
import os
import re
from pathlib import Path, PureWindowsPath
from urllib.parse import unquote

from clsim.errors import InputError

USD_ENDINGS = (".usd", ".usda", ".usdc", ".usdz")
FOLDERS = "CLSIM_ASSET_FOLDERS"
"""The environment variable with further folders for assets, separated as in ``PATH``."""


def need_usd(path: Path) -> None:
    """Raise InputError where the library that reads USD files is missing."""
    if importlib.util.find_spec("pxr") is None:
        raise InputError(f"{path}: USD files need usd-core; install it with: pip install 'clsim[usd]'")


def need_file(path: Path, expected: str) -> None:
    """Raise InputError where a file that a user gives is missing, or no ordinary one: a pipe may have no end."""
    if not os.path.isfile(path):  # False, unlike Path's, for names that are too long
        what = "is no ordinary file" if os.path.exists(path) else "no such file"
        raise InputError(f"{path}: {what}, expected {expected}")


def named_file(reference: str, folder: Path) -> Path:
    """Return the path of a file that a scene description names, relative to its folder.

    Raises:
        InputError: if it is an address, missing, or no ordinary file (a folder, a device, a pipe).
    """
    path = folder / _local(reference, folder)
    try:
        if path.is_file():
            return path
        found = path.exists()
    except (ValueError, OSError) as error:  # a NUL in the name, a loop of links
        raise InputError(f"{reference!r} is not a usable path ({error})") from None
    raise InputError(
        f"{reference!r} is no ordinary file" if found else f"the file {reference!r} is missing in {folder}"
    )


def asset_file(reference: str, folder: Path) -> Path:
    """Return the path that an asset names, relative to its folder; links inside the folder are followed.

    Raises:
        InputError: if it is an address, or leads out of the folder and of those in ``CLSIM_ASSET_FOLDERS``.
    """
    relative = _local(unquote(reference), folder)
    if "\0" in str(relative):
        raise InputError(f"{reference!r} is not a usable path (it has a NUL)")
    path = Path(os.path.normpath(folder.absolute() / relative))
    listed = [Path(os.path.abspath(entry)) for entry in os.environ.get(FOLDERS, "").split(os.pathsep) if entry]
    roots = (Path(os.path.normpath(folder.absolute())), *listed)
    if PureWindowsPath(reference).drive or not any(path.is_relative_to(root) for root in roots):
        raise InputError(
            f"{reference!r} is outside the folder {folder}, expected a file inside it or in a folder of {FOLDERS}"
        )
    return folder / relative


def _local(reference: str, folder: Path) -> Path:
    """Return a reference as a path; raises InputError if it is an address."""
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]+:", reference) or reference.startswith(("//", "\\\\")):
        raise InputError(f"{reference!r} is an address, expected a file, relative to {folder}")
    return Path(reference.replace("\\", "/"))
