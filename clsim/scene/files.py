"""Where a scene's file may point: into its own folder, and nowhere else."""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import unquote

from clsim.errors import InputError


def inside_folder(reference: str, folder: Path) -> Path:
    """Return a file's reference as a path relative to its folder.

    Raises:
        InputError: if it is an address, an absolute path, or leads out of the folder (symbolic links included).
    """
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]*:", reference) or reference.startswith("//"):
        raise InputError(f"{reference!r} is an address, expected a file in {folder}")
    relative = Path(unquote(reference).replace("\\", "/"))
    root = folder.resolve()
    try:
        outside = relative.is_absolute() or not (root / relative).resolve().is_relative_to(root)
    except (ValueError, OSError) as error:  # a NUL in the name, a loop of links
        raise InputError(f"{reference!r} is not a usable path ({error})") from None
    if outside:
        raise InputError(f"{reference!r} is outside the folder {folder}, expected a file inside it")
    return relative
