"""``--out``: files, sockets and standard output by one spelling."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from clsim.events import Sink


def is_address(name: str) -> bool:
    """Tell whether an output is a socket address or standard output rather than a file."""
    return name == "-" or "://" in name


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
