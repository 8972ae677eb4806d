"""AEDAT4 with images beside the events, written by dv-processing in a process of its own.

Its MonoCameraWriter writes in a thread that ends the whole process when the disk is full, so it must not be ours. The
process also outlives a kill of ours: it completes the file with what it was given.
"""

from __future__ import annotations

import contextlib
import os
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt

from clsim.events.aedat4 import LIMITS
from clsim.events.batch import EventBatch, SinkError
from clsim.events.files import need_library
from clsim.events.filesink import FileSink, FlushPolicy, check_exists, naming_failures, unwritable

RECORD_HEAD = struct.Struct("<cqI")
"""What stands before each record in the pipe: kind, time of an image [µs], bytes that follow."""
EVENTS, IMAGE = b"E", b"I"

_CAUSE = "Failed to write with error: '"


class Aedat4FramesSink(FileSink):
    """Writes one packet of events a flush, and one an image."""

    def __init__(self, path: Path, width: int, height: int, flush: FlushPolicy | None = None) -> None:
        """Create the file; raises InputError when it cannot be, or when dv-processing is missing."""
        super().__init__(path, width, height, LIMITS, flush or FlushPolicy())
        need_library(path, "`frames`", "dv_processing", "dv")
        try:
            self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)
        except OSError as error:
            raise unwritable(path, error) from None
        package_folder = str(Path(__file__).parents[2])
        search = os.pathsep.join(part for part in (package_folder, os.environ.get("PYTHONPATH")) if part)
        self._writer = subprocess.Popen(
            [sys.executable, "-m", "clsim.events.aedat4_frames_writer", str(path.absolute()), str(width), str(height)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": search},
            start_new_session=True,  # Ctrl-C is for us; the writer ends with its input
        )
        self._said = ""

    @property
    def writer_pid(self) -> int:
        """Process that writes the file."""
        return self._writer.pid

    def write_image(self, time_us: int, image: npt.NDArray[np.uint8]) -> None:
        """Take an image ``[H, W, 3]``, in the order blue, green, red that DV keeps; events before it go first.

        Raises SinkError when the medium fails.
        """
        if self._closed or self._failed:
            raise SinkError(f"{self.path}: cannot be written any more; it was closed or writing failed before")
        if image.shape != (self.height, self.width, 3) or image.dtype != np.uint8:
            raise ValueError(f"expected 8 bits [{self.height}, {self.width}, 3], got {image.dtype} {image.shape}")
        self.flush()
        try:
            with naming_failures(self.path):
                self._send(IMAGE, time_us, np.ascontiguousarray(image).data)
        except SinkError:
            self._failed = True
            raise

    def _store(self, events: EventBatch) -> None:
        self._send(EVENTS, 0, events.view(np.uint8).data)

    def _send(self, kind: bytes, time_us: int, data: memoryview) -> None:
        check_exists(self._descriptor)
        pipe = self._writer.stdin
        assert pipe is not None
        try:
            pipe.write(RECORD_HEAD.pack(kind, time_us, data.nbytes))
            pipe.write(data)
            pipe.flush()
        except OSError:
            raise self._failure() from None

    def _finish(self) -> None:
        pipe = self._writer.stdin
        assert pipe is not None
        try:
            with contextlib.suppress(OSError):
                pipe.close()
            failure = self._failure()
            if self._writer.returncode and not self._failed:
                raise failure
        finally:
            os.close(self._descriptor)

    def _failure(self) -> OSError:
        """Wait for the writer's end and return what it said of it."""
        assert self._writer.stderr is not None
        if not self._writer.stderr.closed:
            with self._writer.stderr as stream:
                self._said = stream.read().decode(errors="replace")
        status = self._writer.wait()
        _, found, cause = self._said.partition(_CAUSE)
        return OSError(cause.partition("'")[0] if found else f"dv-processing's writer ended with status {status}")
