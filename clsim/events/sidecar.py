"""The sidecar: a JSON file beside an event file that says how it was made."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from clsim.events.formats.filesink import unwritable
from clsim.events.sockets.address import is_address


def sidecar_path(name: str | os.PathLike[str]) -> Path | None:
    """Return where the sidecar of an event file goes: its name with ``.json`` behind; None for an address."""
    name = os.fspath(name)
    return None if is_address(name) else Path(f"{name}.json")


def read_sidecar(name: str | os.PathLike[str]) -> dict[str, Any]:
    """Return what the sidecar of the event file ``name`` tells; nothing if there is none, or it is something else."""
    path = sidecar_path(name)
    if path is None:
        return {}
    try:
        found = json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def sidecar_size(about: dict[str, Any]) -> tuple[int, int] | None:
    """Return the sensor's width and height that a sidecar tells."""
    camera = about.get("camera")
    if not isinstance(camera, dict):
        return None
    width, height = camera.get("width"), camera.get("height")
    if not (isinstance(width, int) and isinstance(height, int)):
        return None
    return (width, height) if min(width, height) > 0 and max(width, height) <= 1 << 16 else None


def sidecar_events(about: dict[str, Any]) -> int | None:
    """Return how many events a sidecar of clsim tells of; -1 for a run that did not end, None for nothing."""
    summary = about.get("summary")
    if "clsim_version" not in about:
        return None
    if "converted_from" in about:
        told = about.get("events")
    elif isinstance(summary, dict):
        told = summary.get("events")
    else:
        return -1 if about.get("complete") is False else None
    return told if isinstance(told, int) and told >= 0 else None


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
