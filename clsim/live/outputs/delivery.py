"""Delivery of a run's events to its outputs, each by itself, so that none spoils another."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Protocol, runtime_checkable

from clsim.errors import Error, InputError
from clsim.events import Causes, EventBatch, Labelling, Objects, Sink, SinkError
from clsim.events.formats.filesink import PartFile
from clsim.events.sockets.closing import close_at_once
from clsim.frames import Frame
from clsim.live.outputs.sidecars import PoseFile
from clsim.truth.labels import Labeller

COMPLETING_S = 300.0
"""Until a file is given up whose disk does not answer."""


@runtime_checkable
class Recorder(Sink, Protocol):
    """A sink that stores frames with their events."""

    planes: tuple[str, ...]
    """Planes that it wants of each frame."""

    def record(self, frame: Frame, events: EventBatch, causes: Causes | None = None) -> None:
        """Take a frame and, in place of ``write``, the events of the step that led to it; all may be reused.

        ``causes`` are those of each event; None where brightness caused them all.
        """
        ...


@dataclass
class Output:
    """A sink, the name the user knows it by, and where its sidecar goes if it has one."""

    name: str
    sink: Sink
    error: str | None = None
    reader_left: bool = False
    """Whether the error is that nobody reads any longer, as with ``| head``."""
    sidecar: Path | None = None
    poses: PoseFile | None = None
    """Where the camera's pose at each frame goes, if it goes anywhere."""
    part: PartFile | None = None
    """What is written at first, where a file of that name is there; it takes the name with the first frame."""
    closed: bool = False
    lock: threading.Lock = field(default_factory=threading.Lock, repr=False)
    """Held while the sink is at work."""
    _waiting: Callable[[], None] | None = field(default=None, repr=False)

    @property
    def on_disk(self) -> bool:
        """Whether it is a file or a folder, and not a pipe, a device or an address, whose readers may stall."""
        path = Path(self.name)
        return self.sidecar is not None and not (path.is_fifo() or path.is_char_device())

    @property
    def waits(self) -> bool:
        """Whether the file that was there is still the older one, for want of a frame."""
        return self._waiting is not None

    def at_first_frame(self, use: Callable[[], None]) -> None:
        """Call ``use`` once the file has its name: now, or at `begin`."""
        if self.part is None:
            use()
        else:
            self._waiting = use

    def begin(self) -> None:
        """Take note of a frame: with the first one, the file takes its name."""
        if self._waiting is not None and self.part is not None:
            self.attempt(self.part.complete)
            self.attempt(self._waiting)
            self._waiting = None

    def fail(self, error: Exception) -> None:
        """Keep the first error, in words."""
        if self.error is None:
            self.error = str(error) if isinstance(error, Error | OSError) else f"{self.name}: {error!r}"
            if self.part is not None:
                self.error = self.error.replace(str(self.part.part), self.name)
            self.reader_left = isinstance(error.__cause__ or error, BrokenPipeError)

    def attempt(self, use: Callable[[], None]) -> None:
        """Call ``use`` of the sink, unless it failed or is closed; whatever that raises ends this output alone."""
        with self.lock:
            if self.error is None and not self.closed:
                try:
                    use()
                except Exception as error:
                    self.fail(error)

    def close(self, *, at_once: bool = False) -> None:
        """Close the sink, with patience for its readers unless ``at_once``; safe to call twice."""
        with self.lock:
            if not self.closed:
                try:
                    if at_once:
                        close_at_once(self.sink)
                    else:
                        self.sink.close()
                except Exception as error:
                    self.fail(error)
                if self.poses is not None:
                    with contextlib.suppress(OSError):  # what was lost of them was told when it was written
                        self.poses.close()
                if self.part is not None:
                    self.part.discard()
                self.closed = True


class Delivery:
    """Hands events, and frames to those that record them, to all outputs that have not failed."""

    def __init__(self, outputs: Sequence[Output]) -> None:
        """Deliver to ``outputs``, in this order."""
        self.outputs = list(outputs)
        wants = any(isinstance(each.sink, Labelling) and "object" in each.sink.labelled for each in outputs)
        self._labeller = Labeller() if wants else None
        self._objects: Objects | None = None

    def refuse_recorders(self, names: Sequence[str]) -> None:
        """Fail those outputs that record planes which are not among the frames' ``names``."""
        for output in self.outputs:
            if isinstance(output.sink, Recorder) and (missing := set(output.sink.planes) - set(names)):
                lacking = ", ".join(sorted(missing))
                output.fail(InputError(f"{output.name} records {lacking}, but frames have {', '.join(names)}"))

    def record(self, frame: Frame, events: EventBatch, causes: Causes | None = None) -> None:
        """Hand a frame, while it is there, and its events with their causes to the recorders."""
        if self._labeller is not None:
            self._objects = self._labeller.label(frame, events)["object"]
        for output in self.outputs:
            output.begin()
            if output.poses is not None:
                output.attempt(partial(output.poses.add, frame.index))
            if isinstance(output.sink, Recorder):
                output.attempt(partial(output.sink.record, frame, events, causes))

    def write(self, events: EventBatch, end_us: int, causes: Causes | None = None) -> None:
        """Hand the events until ``end_us`` [µs] to all that are no recorders, and labels to those who want them.

        Objects are those of the last frame that was recorded.

        Raises:
            SinkError: every output, recorders too, has failed.
        """
        for output in self.outputs:
            if not isinstance(output.sink, Recorder):
                sink = output.sink
                if isinstance(sink, Labelling) and sink.labelled:
                    output.attempt(partial(sink.write, events, end_us, causes, self._objects))
                else:
                    output.attempt(partial(sink.write, events, end_us))
        if self.outputs and all(output.error for output in self.outputs):
            raise SinkError("every output has failed: " + "; ".join(output.error or "" for output in self.outputs))

    def close(self) -> None:
        """Close all, the last first: files come last, and sockets may wait for their readers."""
        for output in reversed(self.outputs):
            output.close()

    def close_at_once(self, timeout_s: float) -> bool:
        """Close all at the same time, as well as that goes until the timeout [s]; False if a sink is still at work.

        Such a sink is given up: what its reader did not take is lost. A file is completed, for which there is
        `COMPLETING_S`: of some kinds nothing can be read before.
        """
        deadline = time.monotonic() + timeout_s
        closers = [
            threading.Thread(target=output.close, kwargs={"at_once": True}, name="clsim-close", daemon=True)
            for output in self.outputs
        ]
        for closer in closers:
            closer.start()
        for output, closer in zip(self.outputs, closers, strict=True):
            patience_s = COMPLETING_S if output.on_disk else 0.0
            closer.join(max(0.0, deadline + patience_s - time.monotonic()))
            if closer.is_alive():
                output.fail(SinkError(f"{output.name}: was not finished, for it takes no more events"))
        return not any(closer.is_alive() for closer in closers)
