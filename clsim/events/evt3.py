"""EVT3, Prophesee's RAW format of 16-bit words: time, row and column are sent when they change.

All of it is read (evt3_words.py). Only single events are written (EVT_ADDR_X), no vectors: faery writes VECT words on
their own, which Prophesee's decoder does not expect. The 24 bits of time wrap every 16.8 s. Decoders count the wraps,
so the last and the first time word of every lap are always sent; a file that begins late begins with two words for
each earlier lap.

Source: https://docs.prophesee.ai/stable/data/encoding_formats/evt3.html
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from clsim.events.batch import EventBatch
from clsim.events.evt3_words import ADDR_X, ADDR_Y, TIME_HIGH, TIME_LOW
from clsim.events.filesink import ByteFile, FileSink, FlushPolicy, Limits
from clsim.events.prophesee import open_raw_source, raw_header

# 65536 laps: at most 256 KiB of time words in a row.
LIMITS = Limits("EVT3", size=2**11, end_us=2**40)

_LAP = np.array([TIME_HIGH | 0xFFF, TIME_HIGH], "<u2")


class Evt3Sink(FileSink):
    """Writes words."""

    def __init__(self, path: Path, width: int, height: int, flush: FlushPolicy) -> None:
        """Create the file with its header; raises InputError when it cannot be."""
        super().__init__(path, width, height, LIMITS, flush)
        self._file = ByteFile(path, raw_header("3", width, height))
        self._time_us = -1
        self._row = -1

    def _store(self, events: EventBatch) -> None:
        t, y = events["t"], events["y"]
        before = np.concatenate(([self._time_us], t[:-1]))
        laps = (t >> 24) - (np.maximum(before, 0) >> 24)
        new_high = (t >> 12) != (before >> 12)
        new_low = t != before
        new_row = np.diff(y.astype(np.int32), prepend=self._row) != 0
        self._time_us, self._row = int(t[-1]), int(y[-1])

        # Each event's words end with its column; before that, as far as needed: laps, high, low, row.
        column = np.cumsum(2 * laps + new_high + new_low + new_row + 1) - 1
        row = column - 1
        low = row - new_row
        high = low - new_low
        words = np.empty(int(column[-1]) + 1, "<u2")
        words[column] = ADDR_X | events["on"].astype("<u2") << 11 | events["x"]
        words[row[new_row]] = ADDR_Y | y[new_row]
        words[low[new_low]] = TIME_LOW | (t[new_low] & 0xFFF)
        words[high[new_high]] = TIME_HIGH | (t[new_high] >> 12 & 0xFFF)
        for index in np.flatnonzero(laps):
            end = high[index]
            words[end - 2 * laps[index] : end] = np.tile(_LAP, laps[index])
        self._file.write(words.data)

    def _finish(self) -> None:
        try:
            end, last = self._end_us >> 12, self._time_us >> 12
            if last < end < 1 << 28 and not self._failed:  # the recording lasted longer than its events
                laps = (end >> 12) - (max(last, 0) >> 12)
                self._file.write(np.append(np.tile(_LAP, laps), TIME_HIGH | end & 0xFFF).astype("<u2").data)
        finally:
            self._file.close()


def open_sink(path: Path, width: int, height: int, flush: FlushPolicy) -> Evt3Sink:
    """Open an EVT3 writer."""
    return Evt3Sink(path, width, height, flush)


open_source = open_raw_source
