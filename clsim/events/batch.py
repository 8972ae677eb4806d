"""The event type that everything after the detector speaks."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
import numpy.typing as npt

from clsim.errors import Error

EVENT_DTYPE = np.dtype([("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("on", "?")])
"""t [µs], x to the right and y down from the top-left pixel, on = brightness rose."""

CAUSES = ("signal", "shot", "leak", "hot")
"""What causes events, by number: brightness, noise, a reference that leaks, a pixel that is hot.

It is what the largest part of the change since the pixel's last event is of: one that has leaked almost a threshold and
then sees a little light has a leak event.
"""
Causes: TypeAlias = npt.NDArray[np.uint8]
"""Of each event of a batch, its cause: an index of CAUSES."""
Objects: TypeAlias = npt.NDArray[np.uint32]
"""Of each event of a batch, the number of the object at its pixel; 0 is nothing."""
LABEL_TYPES = {"cause": "u1", "object": "<u4"}
"""What may stand beside events, in columns of these types."""
Labels: TypeAlias = tuple[str, ...]
"""Some of LABEL_TYPES."""

EventBatch: TypeAlias = npt.NDArray[Any]
"""Events as a one-dimensional array of EVENT_DTYPE, sorted by t and, within one t, by (y, x)."""


def empty_batch(count: int = 0, labels: Labels = ()) -> EventBatch:
    """Return an uninitialised batch of ``count`` events, with fields for ``labels`` too."""
    if not labels:
        return np.empty(count, dtype=EVENT_DTYPE)
    return np.empty(count, [*EVENT_DTYPE.descr, *((name, LABEL_TYPES[name]) for name in labels)])


def gather(batches: Iterable[EventBatch], labels: Labels = ()) -> EventBatch:
    """Return all batches as one array, which is empty where there are none; all have fields for ``labels``."""
    return np.concatenate([empty_batch(0, labels), *batches])


def with_causes(events: EventBatch, causes: Causes | None) -> EventBatch:
    """Return a copy of events that has a field ``cause``; without ``causes``, it is brightness."""
    batch = empty_batch(len(events), ("cause",))
    for name in EVENT_DTYPE.names or ():
        batch[name] = events[name]
    batch["cause"] = CAUSES.index("signal") if causes is None else causes
    return batch


class SinkError(Error):
    """A sink that was opened well can no longer be written: full disk, closed pipe, vanished folder.

    Its text is one sentence that names the file or address and the cause. The pipeline drops this sink, lets the
    others go on, and ends with an exit status other than 0.
    """


class Sink(Protocol):
    """Where batches go: a file, a socket, a view."""

    def write(self, events: EventBatch, end_us: int) -> None:
        """Take the events (possibly none) until ``end_us`` [µs]: silence carries time too.

        No event is later than ``end_us``, and none that follows in another call is earlier. The array may be reused by
        the caller afterwards.

        Raises SinkError when the medium fails, and clsim.errors.InputError for events it cannot hold.
        """
        ...

    def close(self) -> None:
        """Finish and release; whatever was written is readable afterwards. Safe to call twice."""
        ...


@runtime_checkable
class Labelling(Protocol):
    """A sink that may keep labels of each event beside it."""

    labelled: Labels
    """Which labels it keeps and so wants."""

    def write(
        self, events: EventBatch, end_us: int, causes: Causes | None = None, objects: Objects | None = None
    ) -> None:
        """Take the events and their labels until ``end_us`` [µs], as `Sink.write`."""
        ...


@runtime_checkable
class BriefFlush(Protocol):
    """A sink that waits for its readers when it closes, unless it is told not to."""

    def flush_briefly(self) -> None:
        """Begin to close, with little patience; ``close`` follows."""
        ...


@runtime_checkable
class Reporting(Protocol):
    """A sink that has figures for the summary of a run."""

    def report(self) -> dict[str, float]:
        """Return them by name, such as ``clients`` and ``dropped_events``."""
        ...


@runtime_checkable
class Exposed(Protocol):
    """A sink that may be open to others than the user."""

    warning: str | None
    """A sentence that says so; None if it is not."""
