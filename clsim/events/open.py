"""Any file or address of events as an iterator."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from clsim.errors import InputError
from clsim.events.batch import Labels
from clsim.events.formats.filesource import EventSource
from clsim.events.sidecar import read_sidecar, sidecar_size
from clsim.events.sockets.address import is_address
from clsim.events.sockets.stream_source import SocketSource
from clsim.values import read_value


def open_events(
    path_or_url: str | PathLike[str], *, labels: Labels = (), strict: bool = False
) -> EventSource | SocketSource:
    """Open an event file, ``tcp://HOST:PORT``, ``unix://PATH`` or ``udp://HOST:PORT?size=WIDTHxHEIGHT``.

    ``stereo.bag#/davis/left/events`` is one topic of a bag of ROS that has several, or one camera of an HDF5 file.

    Returns an iterator of EventBatch that reads on as it is asked, in bounded memory; its ``width`` and ``height`` are
    None for files that do not tell. A socket's iterator waits for events and ends when the sender does. Either can be
    closed early, or used in a ``with`` block.

    Args:
        path_or_url: the file or address.
        labels: further fields of the batches, of "cause" and "object"; HDF5 and Parquet files that were written with
            them have these.
        strict: whether events of a file that are out of order are an error, and a missing end too. Else those up to
            0.1 s late are put in their place, and others left out; ``moved_events`` and ``dropped_events`` count them.
            Of a file that seems cut, `clsim.errors.Notice` warns once all is read that can be.

    >>> for batch in clsim.open("events.aedat4"):  # doctest: +SKIP
    ...     print(batch["t"][0], len(batch))

    Raises:
        InputError: the file or address cannot be used, its events have no such labels, or, while iterating, its
            contents are damaged.
    """
    name = read_value("path_or_url", path_or_url, str)
    labels = read_value("labels", labels, tuple[str, ...])
    if is_address(name):
        from clsim.events.sockets.sources import open_socket_source

        if labels:
            raise InputError(f"{name}: events of a stream have no {', '.join(labels)}; expected a file")
        return open_socket_source(name)
    from clsim.events.files import open_source

    return open_source(name, labels=labels, strict=strict)


def sensor_size(name: str, source: EventSource | SocketSource, given: tuple[int, int] | None) -> tuple[int, int]:
    """Return the width and height of the sensor of an open source.

    What the user gives counts first, then what the source tells, then its sidecar; else the file is read through once
    for the smallest sensor that holds its events.
    """
    if given is not None:
        return given
    size = least_size(name, source)
    if size == (0, 0):
        raise InputError(f"{Path(name)}: holds no events, so its sensor size is unknown; give it with `resolution`")
    return size


def least_size(name: str, source: EventSource | SocketSource) -> tuple[int, int]:
    """Return the size that an open source or its sidecar tells, else the smallest that holds its events."""
    if source.width is not None and source.height is not None:
        return source.width, source.height
    return sidecar_size(read_sidecar(name)) or _smallest_size(name)


def _smallest_size(name: str) -> tuple[int, int]:
    width = height = 0
    with open_events(name) as source:
        for batch in source:
            width = max(width, int(batch["x"].max()) + 1)
            height = max(height, int(batch["y"].max()) + 1)
    return width, height
