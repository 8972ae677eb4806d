"""Events into any file or address, for programs that have some."""

from __future__ import annotations

from os import PathLike
from types import TracebackType

import numpy as np

from clsim.errors import InputError
from clsim.events.batch import EVENT_DTYPE, EventBatch
from clsim.events.outputs import FileOptions, check_output, open_output
from clsim.values import read_value


class EventWriter:
    """Writes to one file or address; complete once it is closed, be it by a ``with`` block."""

    def __init__(self, path: str | PathLike[str], width: int, height: int, *, format: str | None = None) -> None:
        """Open a file, ``tcp://``, ``udp://``, ``unix://`` or ``-``. A file that exists is replaced.

        Args:
            path: the file or address.
            width: of the sensor [pixels].
            height: of the sensor [pixels].
            format: name of a format, where the ending of the name shall not decide.

        >>> with clsim.write("events.h5", 346, 260) as out:  # doctest: +SKIP
        ...     out.write(events, end_us=10_000)

        Raises:
            InputError: the path or address cannot be used, or the format cannot hold the sensor.
        """
        name = read_value("path", path, str)
        width, height = read_value("width", width, int), read_value("height", height, int)
        options = FileOptions(format=format)
        options.check([name])
        check_output(name, width, height, options)
        self._sink = open_output(name, width, height, options)
        self._name = name

    def write(self, events: EventBatch, end_us: int) -> None:
        """Append events, an array of clsim.EVENT_DTYPE sorted by time, possibly empty, until ``end_us`` [µs].

        None may be later than ``end_us``, and none that follows in another call earlier.

        Raises:
            InputError: the array is another, an event lies outside the sensor, or its time does not fit the format.
            SinkError: the file or address can no longer be written.
        """
        if not isinstance(events, np.ndarray):
            raise InputError(f"{self._name}: events are {type(events).__name__}; expected an array of {EVENT_DTYPE}")
        end_us = read_value("end_us", end_us, int)
        if events.dtype != EVENT_DTYPE or events.ndim != 1:
            raise InputError(
                f"{self._name}: events are {events.dtype} {list(events.shape)}; expected one row of {EVENT_DTYPE}"
            )
        self._sink.write(events, end_us)

    def close(self) -> None:
        """Complete the file, or disconnect; safe to call twice. Raises SinkError when that fails."""
        self._sink.close()

    def __enter__(self) -> EventWriter:
        """Return itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Close."""
        self.close()
