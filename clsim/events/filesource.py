"""What every file reader shares: an iterator of checked batches in bounded memory."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

import numpy as np

from clsim.errors import InputError
from clsim.events.batch import CAUSES, EventBatch, Labels, gather

CHUNK_EVENTS = 1 << 18
"""Readers yield about this many events at a time, at most."""


class EventSource:
    """Iterates over the batches of a file in order of time; ``width``, ``height`` are None where the file is silent.

    ``labelled`` tells which labels stand beside events in the file; batches have a field for those that were asked for.

    Damage found on the way raises InputError. The last record of a file whose writer was killed may be torn: it is
    left out, and everything before it is delivered.
    """

    def __init__(
        self,
        path: Path,
        width: int | None,
        height: int | None,
        batches: Iterator[EventBatch],
        dropped_events: Callable[[], int] = lambda: 0,
        *,
        labelled: Labels = (),
        labels: Labels = (),
    ) -> None:
        """Take the batches a format's reader yields, which are checked when they pass, and what it left out so far.

        Batches have fields for ``labels``.
        """
        self.path = path
        self.width = width
        self.height = height
        self.labelled = labelled
        self._labels = labels
        self._batches = batches
        self._last_us = 0
        self._count = 0
        self._dropped_events = dropped_events

    @property
    def dropped_events(self) -> int:
        """Number of events left out so far because they lie outside the sensor, or come too late."""
        return self._dropped_events()

    def __iter__(self) -> EventSource:
        """Return itself: a source is read once."""
        return self

    def __next__(self) -> EventBatch:
        """Return the next batch that has events."""
        while True:
            with naming_damage(self.path):
                batch = next(self._batches)
            if len(batch):
                self._check(batch)
                return batch

    def read(self) -> EventBatch:
        """Return all events that are left as one array, empty where there are none, and close."""
        with self:
            return gather(self, self._labels)

    def close(self) -> None:
        """Release the file before its end."""
        close = getattr(self._batches, "close", None)
        if close is not None:
            close()

    def __enter__(self) -> EventSource:
        """Return itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Release the file."""
        self.close()

    def _check(self, batch: EventBatch) -> None:
        t = batch["t"]
        if int(t[0]) < self._last_us:
            raise InputError(
                f"{self.path}: event {self._count} has time {t[0]} µs, before {self._last_us} µs; expected rising times"
            )
        steps = np.diff(t)
        if steps.size and steps.min() < 0:
            at = int(np.argmax(steps < 0))
            raise InputError(
                f"{self.path}: event {self._count + at + 1} has time {t[at + 1]} µs, before {t[at]} µs; "
                "expected rising times"
            )
        for axis, size in (("x", self.width), ("y", self.height)):
            largest = int(batch[axis].max())
            if size is not None and largest >= size:
                raise InputError(f"{self.path}: an event at {axis} = {largest} lies outside the sensor's {size} pixels")
        if "cause" in self._labels and (largest := int(batch["cause"].max())) >= len(CAUSES):
            raise InputError(f"{self.path}: an event has cause {largest}; expected 0 to {len(CAUSES) - 1}")
        self._last_us = int(t[-1])
        self._count += len(batch)


def open_binary(path: Path) -> BinaryIO:
    """Open a file for reading; raises InputError when that cannot be."""
    try:
        return path.open("rb")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected an event file") from None


@contextlib.contextmanager
def naming_damage(path: Path) -> Iterator[None]:
    """Turn whatever a decoder raises into an InputError that names the file."""
    try:
        yield
    except (StopIteration, InputError, MemoryError):
        raise
    except Exception as error:
        raise damaged(path, error) from error
    except BaseException as error:
        # Libraries made with pyo3 panic with a BaseException of their own; Ctrl-C and exit must pass.
        if type(error).__name__ != "PanicException":
            raise
        raise damaged(path, error) from error


def damaged(path: Path, cause: object) -> InputError:
    """Return the one sentence for a file that is not what its name says."""
    text = str(cause).strip().splitlines()
    return InputError(f"{path}: is damaged or of another format ({text[0] if text else type(cause).__name__})")
