"""``--out``: files, sockets and standard output by one spelling."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from clsim.errors import InputError
from clsim.events import Sink


def is_address(name: str) -> bool:
    """Tell whether an output is a socket address or standard output rather than a file."""
    return name == "-" or "://" in name


def check_output(name: str) -> None:
    """Raise InputError where a file could not be opened for events, without touching it."""
    if is_address(name):
        return
    from clsim.events.files import format_of

    path = Path(name)
    format_of(path)
    if path.is_dir():
        raise InputError(f"{name} is a folder, expected a file for events")
    if not path.parent.is_dir():
        raise InputError(f"{name}: there is no folder {path.parent}")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise InputError(f"{name}: permission denied")


def open_output(name: str, width: int, height: int) -> Sink:
    """Open a file, ``tcp://``, ``udp://``, ``unix://`` or ``-`` for events; raises InputError if it cannot be."""
    if is_address(name):
        from clsim.events.sockets import open_socket_sink

        return open_socket_sink(name, width, height)
    from clsim.events.files import open_sink

    return open_sink(name, width, height)


def sidecar_path(name: str) -> Path | None:
    """Return where an output's sidecar goes, None for what is no file."""
    return None if is_address(name) else Path(f"{name}.json")


def write_sidecar(path: Path, info: dict[str, Any]) -> None:
    """Write a sidecar so that a reader never sees half of one."""
    from clsim.events.sidecar import write_sidecar as write

    write(path, info)
