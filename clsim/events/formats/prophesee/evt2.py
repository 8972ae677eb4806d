"""EVT2, Prophesee's RAW format of 32-bit words: upper time bits when they change, then one word an event.

An event word is type (0 off, 1 on), lower 6 bits of t, 11 bits of x, 11 bits of y; a time word is type 8 and t >> 6.

Source: https://docs.prophesee.ai/stable/data/encoding_formats/evt2.html
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from clsim.events.batch import EventBatch
from clsim.events.formats.filesink import ByteFile, FileSink, FlushPolicy, Limits
from clsim.events.formats.prophesee.raw import open_raw_source, raw_header

LIMITS = Limits("EVT2", size=2**11, end_us=2**34)

_TIME_HIGH = 8 << 28


class Evt2Sink(FileSink):
    """Writes words."""

    def __init__(self, path: Path, width: int, height: int, flush: FlushPolicy) -> None:
        """Create the file with its header; raises InputError when it cannot be."""
        super().__init__(path, width, height, LIMITS, flush)
        self._file = ByteFile(path, raw_header("2", width, height))
        self._high = -1

    def _store(self, events: EventBatch) -> None:
        high = events["t"] >> 6
        new = np.diff(high, prepend=self._high) != 0
        self._high = int(high[-1])
        at = np.arange(len(events)) + np.cumsum(new)
        words = np.empty(int(at[-1]) + 1, "<u4")
        words[at[new] - 1] = _TIME_HIGH | high[new]
        on = events["on"].astype("<u4") << 28
        low = (events["t"] & 63).astype("<u4") << 22
        words[at] = on | low | events["x"].astype("<u4") << 11 | events["y"]
        self._file.write(words.data)

    def _finish(self) -> None:
        try:
            end = self._end_us >> 6
            if self._high < end < 1 << 28 and not self._failed:  # the recording lasted longer than its events
                self._file.write(np.array([_TIME_HIGH | end], "<u4").data)
        finally:
            self._file.close()


def open_sink(path: Path, width: int, height: int, flush: FlushPolicy) -> Evt2Sink:
    """Open an EVT2 writer."""
    return Evt2Sink(path, width, height, flush)


open_source = open_raw_source
