"""ES, the Event Stream format: 5 bytes an event after as many 127 µs steps as its time needs; origin bottom-left.

Source: https://github.com/neuromorphicsystems/event_stream
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from clsim.errors import InputError
from clsim.events.batch import EventBatch, empty_batch
from clsim.events.formats.filesink import ByteFile, FileSink, FlushPolicy, Limits
from clsim.events.formats.filesource import CutShortError, EventSource, damaged, open_binary

# An hour without events is 32 MB of time steps: the gap is bounded, not the time.
LIMITS = Limits("ES", size=2**16 - 1, gap_us=2**32)

_MAGIC = b"Event Stream"
_VERSION = bytes([2, 0, 0])
_DVS = 1
_STEP_US = 127
_EVENT_BYTES = 5
_HEADER_BYTES = 20


class EsSink(FileSink):
    """Writes records."""

    def __init__(self, path: Path, width: int, height: int, flush: FlushPolicy) -> None:
        """Create the file with its header; raises InputError when it cannot be."""
        super().__init__(path, width, height, LIMITS, flush)
        self._file = ByteFile(path, _MAGIC + _VERSION + struct.pack("<BHH", _DVS, width, height))
        self._stored_us = 0

    def _store(self, events: EventBatch) -> None:
        steps, rest = np.divmod(np.diff(events["t"], prepend=self._stored_us), _STEP_US)
        self._stored_us = int(events["t"][-1])
        end = np.cumsum(steps + _EVENT_BYTES)
        data = np.full(int(end[-1]), 0xFF, np.uint8)  # 0xFF is one time step
        records = np.empty(len(events), np.dtype([("head", "u1"), ("x", "<u2"), ("y", "<u2")]))
        records["head"] = rest << 1 | events["on"]
        records["x"] = events["x"]
        records["y"] = self.height - 1 - events["y"]
        data[end[:, None] + np.arange(-_EVENT_BYTES, 0)] = records.view(np.uint8).reshape(-1, _EVENT_BYTES)
        self._file.write(data.data)

    def _finish(self) -> None:
        self._file.close()


def open_sink(path: Path, width: int, height: int, flush: FlushPolicy) -> EsSink:
    """Open an ES writer."""
    return EsSink(path, width, height, flush)


def open_source(path: Path) -> EventSource:
    """Open an ES file of DVS events, or of an ATIS, whose measurements of light are left out."""
    with open_binary(path) as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise damaged(path, f"expected it to begin with {_MAGIC!r}")

    import faery

    decoder = faery.es.Decoder(path, 0)
    if decoder.event_type not in ("dvs", "atis"):
        raise InputError(
            f"{path}: holds Event Stream's events of the kind {decoder.event_type}, which tell no changes of "
            "brightness; expected dvs or atis"
        )
    width, height = decoder.dimensions

    return EventSource(path, width, height, _read(path, decoder, height))


def _read(path: Path, decoder: Any, height: int) -> Iterator[EventBatch]:
    end, last_us = _HEADER_BYTES, 0
    is_atis = decoder.event_type == "atis"
    with decoder:
        for packet in decoder:
            if is_atis:
                packet = packet[~packet["exposure"]]
            if len(packet) and int(packet["y"].max()) >= height:
                raise ValueError(f"an event at y = {packet['y'].max()} lies outside the sensor's {height} pixels")
            events = empty_batch(len(packet))
            events["t"], events["x"], events["y"] = packet["t"], packet["x"], height - 1 - packet["y"]
            events["on"] = packet["polarity" if is_atis else "on"]
            if not is_atis and len(events):
                steps = np.diff(events["t"], prepend=last_us) // _STEP_US
                end, last_us = end + _EVENT_BYTES * len(events) + int(steps.sum()), int(events["t"][-1])
            yield events
    if not is_atis and _ends_torn(path, end):
        raise CutShortError("within an event")


def _ends_torn(path: Path, end: int) -> bool:
    """Tell whether a file has more than steps of time behind the last whole event, which ends at byte ``end``."""
    with open_binary(path) as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(end, size - _EVENT_BYTES + 1))
        return bool(file.read().strip(b"\xff"))
