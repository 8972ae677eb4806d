"""Standard streams that are closed or full must not cost anyone his files."""

from __future__ import annotations

import contextlib
import os
import sys
from typing import Any, TextIO, cast


class _Patient:
    """Standard error; what it cannot take is lost, and nothing else."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        with contextlib.suppress(OSError, ValueError):
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def keep_streams() -> None:
    """Open what is closed of standard input, output and error on nothing, and let standard error fail in silence.

    Otherwise the next file that is opened would get the number of the closed one, and libraries' messages with it.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free is this one
    if sys.stdout is None:
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115, it lasts as long as the program
    if sys.stderr is None:
        sys.stderr = open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    if not isinstance(sys.stderr, _Patient):
        sys.stderr = cast(TextIO, _Patient(sys.stderr))
