"""The event type that everything after the detector speaks."""

from __future__ import annotations

from typing import Any, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

EVENT_DTYPE = np.dtype([("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("on", "?")])
"""t [µs], x to the right and y down from the top-left pixel, on = brightness rose."""

EventBatch: TypeAlias = npt.NDArray[Any]
"""Events as a one-dimensional array of EVENT_DTYPE, sorted by t and, within one t, by (y, x)."""


class SinkError(Exception):
    """A sink failed while it was written: its text names the sink and the cause (a full disk, a closed pipe)."""


def empty_batch(count: int = 0) -> EventBatch:
    """Return an uninitialised batch of ``count`` events."""
    return np.empty(count, dtype=EVENT_DTYPE)


class Sink(Protocol):
    """Where batches go: a file, a socket, a view."""

    def write(self, batch: EventBatch) -> None:
        """Take one frame's events (possibly none). The batch may be reused by the caller afterwards."""
        ...

    def close(self) -> None:
        """Finish and release; whatever was written is readable afterwards. Safe to call twice."""
        ...
