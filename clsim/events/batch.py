"""The event type that everything after the detector speaks."""

from __future__ import annotations

from typing import Any, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from clsim.errors import Error

EVENT_DTYPE = np.dtype([("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("on", "?")])
"""t [µs], x to the right and y down from the top-left pixel, on = brightness rose."""

EventBatch: TypeAlias = npt.NDArray[Any]
"""Events as a one-dimensional array of EVENT_DTYPE, sorted by t and, within one t, by (y, x)."""


def empty_batch(count: int = 0) -> EventBatch:
    """Return an uninitialised batch of ``count`` events."""
    return np.empty(count, dtype=EVENT_DTYPE)


class SinkError(Error):
    """A sink that was opened well can no longer be written: full disk, closed pipe, vanished folder.

    Its text is one sentence that names the file or address and the cause. The pipeline drops this sink, lets the
    others go on, and ends with an exit status other than 0.
    """


class Sink(Protocol):
    """Where batches go: a file, a socket, a view."""

    def write(self, batch: EventBatch) -> None:
        """Take one frame's events (possibly none). The batch may be reused by the caller afterwards.

        Raises SinkError when the medium fails, and clsim.errors.InputError for events it cannot hold.
        """
        ...

    def close(self) -> None:
        """Finish and release; whatever was written is readable afterwards. Safe to call twice."""
        ...
