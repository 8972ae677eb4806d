"""EVT3, Prophesee's RAW format of 16-bit words: time, row and column are sent when they change.

All of it is read (evt3_words.py). Only single events are written (EVT_ADDR_X), no vectors: faery writes VECT words on
their own, which Prophesee's decoder does not expect. The 24 bits of time wrap every 16.8 s. Decoders count the wraps,
so the last and the first time word of every lap are always sent; a file that begins late begins with two words for
each earlier lap.

Source: https://docs.prophesee.ai/stable/data/encoding_formats/evt3.html
"""

from __future__ import annotations

from pathlib import Path

from clsim.events.batch import EventBatch
from clsim.events.formats.filesink import ByteFile, FileSink, FlushPolicy, Limits
from clsim.events.formats.prophesee.evt3_words import Evt3Encoder
from clsim.events.formats.prophesee.raw import open_raw_source, raw_header

# 65536 laps: at most 256 KiB of time words in a row.
LIMITS = Limits("EVT3", size=2**11, end_us=2**40)


class Evt3Sink(FileSink):
    """Writes words."""

    def __init__(self, path: Path, width: int, height: int, flush: FlushPolicy) -> None:
        """Create the file with its header; raises InputError when it cannot be."""
        super().__init__(path, width, height, LIMITS, flush)
        self._file = ByteFile(path, raw_header("3", width, height))
        self._encoder = Evt3Encoder()

    def _store(self, events: EventBatch) -> None:
        self._file.write(self._encoder.encode(events).data)

    def _finish(self) -> None:
        try:
            if not self._failed:  # the recording may have lasted longer than its events
                self._file.write(self._encoder.silence(self._end_us).data)
        finally:
            self._file.close()


def open_sink(path: Path, width: int, height: int, flush: FlushPolicy) -> Evt3Sink:
    """Open an EVT3 writer."""
    return Evt3Sink(path, width, height, flush)


open_source = open_raw_source
