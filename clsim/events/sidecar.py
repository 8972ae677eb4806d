"""The sidecar: a JSON file beside an event file that says how it was made."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from clsim.events.filesink import unwritable


def sidecar_path(path: str | os.PathLike[str]) -> Path:
    """Return where the sidecar of an event file goes: its name with ``.json`` behind."""
    return Path(f"{os.fspath(path)}.json")


def write_sidecar(path: Path, info: dict[str, Any]) -> None:
    """Write ``info`` to the sidecar ``path`` so that a reader never sees half of one.

    Raises clsim.errors.InputError when the folder cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        try:
            temporary.write_text(json.dumps(info, indent=2) + "\n", encoding="utf-8")
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise unwritable(path, error) from None
