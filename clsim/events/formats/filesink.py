"""What every file writer shares: checking events, gathering them, flushing in time, and naming what went wrong."""

from __future__ import annotations

import abc
import contextlib
import errno
import os
import platform
import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events.batch import EVENT_DTYPE, Causes, EventBatch, Labels, Objects, SinkError, empty_batch

STDOUT = Path("-")
"""The path that means standard output."""


@dataclass(frozen=True)
class FlushPolicy:
    """When gathered events go to the file: after so many of them, or so much time of theirs after the last flush.

    A killed process loses what was gathered since its last flush, never more. The wall clock has no say, so that the
    same events give the same bytes.
    """

    events: int = 65536
    interval_us: float = 10_000


@dataclass(frozen=True)
class Limits:
    """What a format can hold; times, gaps and spans must be smaller than these."""

    format: str
    size: int
    """Largest width and height."""
    end_us: int = 2**63
    """Time of an event."""
    gap_us: int = 2**63
    """Time from one event to the next, and from 0 to the first."""
    span_us: int = 2**63
    """Time from the first event to the last."""

    def check_size(self, path: Path, width: int, height: int) -> None:
        """Raise InputError for a sensor that the format cannot hold."""
        for name, size in (("width", width), ("height", height)):
            if not 1 <= size <= self.size:
                raise InputError(f"{path}: {name} {size} does not fit {self.format}, which holds 1 to {self.size}")


class FileSink(abc.ABC):
    """Checks, gathers and flushes; a format says how events are stored and how the file is finished."""

    def __init__(
        self,
        path: Path,
        width: int,
        height: int,
        limits: Limits,
        flush: FlushPolicy,
        *,
        labelled: Labels = (),
    ) -> None:
        """Check that the format can hold the sensor; opens nothing.

        What is stored has the fields ``labelled`` too.
        """
        limits.check_size(path, width, height)
        self.path = path
        self.width = width
        self.height = height
        self._limits = limits
        self._flush = flush
        self.labelled = labelled
        self._pending = empty_batch(flush.events, labelled)
        self._count = 0
        self._end_us = 0
        self._flushed_us = 0
        self._first_us: int | None = None
        self._last_us = 0
        self._failed = False
        self._closed = False

    @abc.abstractmethod
    def _store(self, events: EventBatch) -> None:
        """Hand one or more checked events to the operating system."""

    @abc.abstractmethod
    def _finish(self) -> None:
        """Complete the file after the last event and release it; called once."""

    def write(
        self, events: EventBatch, end_us: int, causes: Causes | None = None, objects: Objects | None = None
    ) -> None:
        """Take the events until ``end_us``; see Sink.write.

        ``causes`` and ``objects`` are those of each; without, it is brightness, and nothing.
        """
        self._check_open()
        if len(events):
            self._check(events)
        if end_us < self._last_us:
            raise InputError(f"{self.path}: `end_us` is {end_us}, before the event at {self._last_us} µs")
        if end_us < self._end_us:
            raise InputError(f"{self.path}: `end_us` goes back from {self._end_us} to {end_us}")
        self._end_us = end_us
        done = 0
        while done < len(events):
            taken = min(len(events) - done, len(self._pending) - self._count)
            place = self._pending[self._count : self._count + taken]
            if self.labelled:
                for name in EVENT_DTYPE.names or ():
                    place[name] = events[name][done : done + taken]
                for name, labels in (("cause", causes), ("object", objects)):
                    if name in self.labelled:
                        place[name] = 0 if labels is None else labels[done : done + taken]
            else:
                _raw(place)[:] = _raw(np.asarray(events[done : done + taken], EVENT_DTYPE))
            self._count += taken
            done += taken
            if self._count == len(self._pending):
                self.flush()
        if self._end_us - self._flushed_us >= self._flush.interval_us:
            self.flush()

    def flush(self) -> None:
        """Hand all gathered events to the operating system: a kill no longer loses them.

        Raises SinkError when the medium fails; the gathered events are then lost, those flushed before stay readable.
        """
        self._flushed_us = self._end_us
        count, self._count = self._count, 0
        if count:
            with self._noting_failures():
                self._store(self._pending[:count])

    def close(self) -> None:
        """Flush, complete the file and release it; safe to call twice.

        Raises SinkError when the medium fails, unless a write said so before.
        """
        if self._closed:
            return
        self._closed = True
        if self._failed:
            with contextlib.suppress(OSError):
                self._finish()
            return
        try:
            self.flush()
        finally:
            with naming_failures(self.path):
                self._finish()

    def abandon(self) -> None:
        """Release the file and forget what was gathered; a format that is all or nothing leaves nothing."""
        self._failed = True
        self.close()

    def _check_open(self) -> None:
        if self._closed or self._failed:
            raise SinkError(f"{self.path}: cannot be written any more; it was closed or writing failed before")

    @contextlib.contextmanager
    def _noting_failures(self) -> Iterator[None]:
        try:
            with naming_failures(self.path):
                yield
        except SinkError:
            self._failed = True
            raise

    def _check(self, batch: EventBatch) -> None:
        """Refuse what the format would wrap silently."""
        t = batch["t"]
        first, last = int(t[0]), int(t[-1])
        if first < 0:
            raise InputError(f"{self.path}: event time {first} µs is negative; expected 0 or later")
        if first < self._last_us:
            raise InputError(f"{self.path}: event time goes back from {self._last_us} µs to {first} µs")
        steps = np.diff(t)
        if steps.size and steps.min() < 0:
            at = int(np.argmin(steps))
            raise InputError(f"{self.path}: event time goes back from {t[at]} µs to {t[at + 1]} µs")
        if last >= self._limits.end_us:
            raise InputError(
                f"{self.path}: event time {last} µs is too late for {self._limits.format}, "
                f"which ends at {self._limits.end_us - 1} µs"
            )
        gap = max(first - self._last_us, int(steps.max()) if steps.size else 0)
        if gap >= self._limits.gap_us:
            raise InputError(
                f"{self.path}: {gap} µs without an event are too long for {self._limits.format}, "
                f"which bridges at most {self._limits.gap_us - 1} µs"
            )
        start = first if self._first_us is None else self._first_us
        if last - start >= self._limits.span_us:
            raise InputError(
                f"{self.path}: event time {last} µs is too late for {self._limits.format} that begins at {start} µs, "
                f"which spans at most {self._limits.span_us - 1} µs"
            )
        for axis, size in (("x", self.width), ("y", self.height)):
            largest = int(batch[axis].max())
            if largest >= size:
                raise InputError(
                    f"{self.path}: event at {axis} = {largest} lies outside the {size} pixels of the sensor"
                )
        self._first_us, self._last_us = start, last


def _raw(events: EventBatch) -> npt.NDArray[np.void]:
    """Return events as bytes, which are copied twenty times faster than fields one by one."""
    return events.view(f"V{EVENT_DTYPE.itemsize}")


class ByteFile:
    """A file or standard output, written without buffers: what was written survives the process."""

    def __init__(self, path: Path, head: bytes = b"") -> None:
        """Create or empty the file and write ``head``; raises InputError when that cannot be."""
        self.path = path
        try:
            if path == STDOUT:
                self._descriptor = os.dup(1)
            else:
                self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)
            self.size = 0
            self.write(head)
        except OSError as error:
            raise unwritable(path, error) from None

    def write(self, data: bytes | memoryview) -> None:
        """Append everything, or nothing and raise OSError; a file that was deleted meanwhile counts as an error.

        Standard output keeps what was written of a torn record: with ``>>`` it may hold what is not ours.
        """
        if self.path != STDOUT:  # which may well be a file without a name
            check_exists(self._descriptor)
        view = memoryview(data).cast("B")
        start = self.size
        try:
            while len(view):
                written = os.write(self._descriptor, view)
                self.size += written
                view = view[written:]
        except OSError:
            if self.path != STDOUT:
                with contextlib.suppress(OSError):  # a torn record would spoil the file for strict readers
                    os.ftruncate(self._descriptor, start)
                    os.lseek(self._descriptor, start, os.SEEK_SET)
                    self.size = start
            raise

    def write_at(self, offset: int, data: bytes) -> None:
        """Overwrite bytes written earlier."""
        os.pwrite(self._descriptor, data, offset)

    def seekable(self) -> bool:
        """Whether write_at works (not so for pipes)."""
        try:
            os.lseek(self._descriptor, 0, os.SEEK_CUR)
        except OSError:
            return False
        return self.path != STDOUT

    def close(self) -> None:
        """Release the file."""
        os.close(self._descriptor)


def check_exists(descriptor: int) -> None:
    """Raise FileNotFoundError if the open file has lost its name: what is written would be lost at close."""
    if os.fstat(descriptor).st_nlink == 0:
        raise FileNotFoundError(errno.ENOENT, "the file or its folder was deleted meanwhile")


def unwritable(path: Path, error: OSError) -> InputError:
    """Return the one sentence for a path that cannot be opened for writing."""
    return InputError(f"{path}: cannot be written ({error.strerror or error}); expected a file in a folder that exists")


@contextlib.contextmanager
def naming_failures(path: Path) -> Iterator[None]:
    """Turn a failure of the medium into a SinkError that names the file and the cause."""
    try:
        yield
    except OSError as error:
        name = "standard output" if path == STDOUT else str(path)
        raise SinkError(f"{name}: writing failed ({error.strerror or error})") from error


class PartFile:
    """A temporary name beside ``path`` for what is useless before it is complete.

    Where ``path`` is a symbolic link, what it points at is meant: the link stays.
    A killed process leaves the file behind; who writes ``path`` next removes it.
    """

    def __init__(self, path: Path, ending: str = "") -> None:
        """Create the file ``part``; raises InputError when its folder cannot be written or ``path`` is no file."""
        given, path = path, Path(os.path.realpath(path))
        self.path = path
        begin = f".{path.name}.{platform.node()}."
        _remove_left_parts(path.parent, begin)
        self.part = path.with_name(f"{begin}{os.getpid()}.part{ending}")
        try:
            if path.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
            if path.exists() and not path.is_file():
                raise OSError(errno.EINVAL, "it is no file, and only one can be replaced when all is written")
            self.part.open("wb").close()
        except OSError as error:
            raise unwritable(given, error) from None

    def complete(self) -> None:
        """Give the file its name."""
        os.replace(self.part, self.path)

    def discard(self) -> None:
        """Remove what is left of it."""
        with contextlib.suppress(OSError):
            self.part.unlink(missing_ok=True)


def _remove_left_parts(folder: Path, begin: str) -> None:
    """Remove what killed processes of this machine left of earlier attempts, and nothing of processes that run."""
    name = re.compile(re.escape(begin) + r"([0-9]+)\.(part|events)(\.[^.]+)?")
    with contextlib.suppress(OSError):  # the attempt to write will tell what is wrong with the folder
        for entry in os.scandir(folder):
            match = name.fullmatch(entry.name)
            if not match or process_runs(int(match[1])):
                continue
            if match[2] == "events" and entry.is_dir(follow_symlinks=False):
                shutil.rmtree(entry, ignore_errors=True)
            elif entry.is_file(follow_symlinks=False):
                os.unlink(entry)


def process_runs(pid: int) -> bool:
    """Tell whether a process of this machine runs, so that what it has begun is not to be removed."""
    if os.name != "posix":
        return True  # elsewhere signal 0 is a real one
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # it is somebody else's
        pass
    return True
