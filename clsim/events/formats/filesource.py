"""What every file reader shares: an iterator of checked batches in bounded memory."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

from clsim.errors import Error, InputError, Notice
from clsim.events.batch import CAUSES, EventBatch, Labels, gather
from clsim.events.formats.columns import ColumnError
from clsim.events.formats.order import Order
from clsim.events.sidecar import read_sidecar, sidecar_events, sidecar_path

CHUNK_EVENTS = 1 << 18
"""Readers yield about this many events at a time, at most."""


class CutShortError(Error):
    """Raised by readers behind the last whole events of a file whose end is missing; its text says where it ends."""


class EventSource:
    """Iterates over the batches of a file in order of time; ``width``, ``height`` are None where the file is silent.

    ``labelled`` tells which labels stand beside events in the file; batches have a field for those that were asked for.

    Damage found on the way raises InputError. The last record of a file that was cut, or whose writer was killed, may
    be torn: everything before it is delivered, and a Notice tells of it, or of a sidecar that knows of other events.
    Events out of order are put in their place or left out, and counted (`clsim.events.formats.order`). After
    `be_strict` all of these are damage.

    Attributes:
        format: name of the format that the file turned out to have; None where its ending tells all.
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
        format: str | None = None,
    ) -> None:
        """Take the batches a format's reader yields, which are checked when they pass, and what it left out so far.

        Batches have fields for ``labels``.
        """
        self.path = path
        self.width = width
        self.height = height
        self.labelled = labelled
        self.format = format
        self._labels = labels
        self._source = batches
        self._count = 0
        self._ended = False
        self._dropped_events = dropped_events
        self._set_order(strict=False)

    def be_strict(self) -> None:
        """Refuse events out of order and a missing end from now on; nothing must have been read before."""
        self._set_order(strict=True)

    def _set_order(self, *, strict: bool) -> None:
        self._strict = strict
        self._order = Order(self.path, strict=strict)
        self._batches = self._order.of(self._source)

    @property
    def dropped_events(self) -> int:
        """Number of events left out so far: outside the sensor, before the first time, or far out of order."""
        return self._dropped_events() + self._order.late_events

    @property
    def moved_events(self) -> int:
        """Number of events so far that came after later ones, and were put in their place."""
        return self._order.moved_events

    def __iter__(self) -> EventSource:
        """Return itself: a source is read once."""
        return self

    def __next__(self) -> EventBatch:
        """Return the next batch that has events."""
        while True:
            try:
                with naming_damage(self.path):
                    batch = next(self._batches)
            except CutShortError as cut:
                self._tell(f"ends {cut}, so it may be cut")
                raise StopIteration from None
            except StopIteration:
                if not self._ended and (doubt := self._doubt()) is not None:
                    self._tell(doubt)
                raise
            if len(batch):
                self._check(batch)
                return batch

    def read(self) -> EventBatch:
        """Return all events that are left as one array, empty where there are none, and close."""
        with self:
            return gather(self, self._labels)

    def close(self) -> None:
        """Release the file before its end."""
        for batches in (self._batches, self._source):
            close = getattr(batches, "close", None)
            if close is not None:
                close()

    def __enter__(self) -> EventSource:
        """Return itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Release the file."""
        self.close()

    def _tell(self, doubt: str) -> None:
        self._ended = True
        if self._strict:
            raise InputError(f"{self.path}: {doubt}; expected a whole recording (refused by `strict`)")
        warnings.warn(f"{self.path}: {doubt}", Notice, stacklevel=1)

    def _doubt(self) -> str | None:
        """Return what the sidecar tells against a file that was read to its end, in words."""
        self._ended = True
        told = None if self._labels else sidecar_events(read_sidecar(self.path))
        count = self._count + self.dropped_events
        if told is None or told == count:
            return None
        sidecar = sidecar_path(self.path)
        if told < 0:
            return f"its run has not ended, or was killed, as {sidecar} tells, so that its last events may be missing"
        why = "it may be cut" if count < told else "the two may be of different runs"
        return f"has {count:,} events, but {sidecar} tells of {told:,}, so {why}"

    def _check(self, batch: EventBatch) -> None:
        if int(batch["t"][0]) < 0:
            raise InputError(f"{self.path}: event {self._count} has time {batch['t'][0]} µs; expected 0 or later")
        for axis, size in (("x", self.width), ("y", self.height)):
            largest = int(batch[axis].max())
            if size is not None and largest >= size:
                raise InputError(f"{self.path}: an event at {axis} = {largest} lies outside the sensor's {size} pixels")
        if "cause" in self._labels and (largest := int(batch["cause"].max())) >= len(CAUSES):
            raise InputError(f"{self.path}: an event has cause {largest}; expected 0 to {len(CAUSES) - 1}")
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
    except ColumnError as error:
        raise InputError(f"{path}: {error}") from None
    except (StopIteration, CutShortError, InputError, MemoryError):
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
