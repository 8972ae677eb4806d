"""DAT, Prophesee's older format: 8 bytes an event, t in 32 bits, x and y in 14 bits each, polarity in 4.

Source: https://docs.prophesee.ai/stable/data/file_formats/dat.html
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from clsim.events.batch import EventBatch
from clsim.events.filesink import ByteFile, FileSink, FlushPolicy, Limits
from clsim.events.prophesee import open_dat_source

LIMITS = Limits("DAT", size=2**14, end_us=2**32)

_EVENT_CD, _EVENT_BYTES = 12, 8


class DatSink(FileSink):
    """Writes records."""

    def __init__(self, path: Path, width: int, height: int, flush: FlushPolicy) -> None:
        """Create the file with its header; raises InputError when it cannot be."""
        super().__init__(path, width, height, LIMITS, flush)
        header = f"% Data file containing CD events.\n% Version 2\n% Height {height}\n% Width {width}\n"
        self._file = ByteFile(path, header.encode() + bytes([_EVENT_CD, _EVENT_BYTES]))

    def _store(self, events: EventBatch) -> None:
        words = np.empty((len(events), 2), "<u4")
        words[:, 0] = events["t"]
        words[:, 1] = events["x"] | events["y"].astype("<u4") << 14 | events["on"].astype("<u4") << 28
        self._file.write(words.data)

    def _finish(self) -> None:
        self._file.close()


def open_sink(path: Path, width: int, height: int, flush: FlushPolicy) -> DatSink:
    """Open a DAT writer."""
    return DatSink(path, width, height, flush)


open_source = open_dat_source
