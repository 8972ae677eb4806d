"""The files of N-MNIST and N-Caltech101: 5 bytes an event, without a header: x, y, polarity and 23 bits of time.

An event at y = 240 is none, and tells that 2^13 µs are to be added to all that follow. Only read.

Source: Orchard et al., "Converting Static Image Datasets to Spiking Neuromorphic Datasets Using Saccades", 2015, and
the reader that came with it.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from clsim.events.batch import EventBatch, empty_batch
from clsim.events.formats.filesource import CHUNK_EVENTS, EventSource, damaged, open_binary

_EVENT_BYTES = 5
_OVERFLOW_Y, _OVERFLOW_US = 240, 1 << 13
_MOST_FALLS = 0.1


def open_source(path: Path) -> EventSource:
    """Open such a file; it tells nothing of the sensor."""
    with open_binary(path):
        size = path.stat().st_size
    if size % _EVENT_BYTES:
        raise damaged(path, f"its {size} bytes are no events of 5 bytes, as N-MNIST has them")
    return EventSource(path, None, None, _read(path))


def _read(path: Path) -> Iterator[EventBatch]:
    added_us = 0
    with open_binary(path) as file:
        while data := file.read(_EVENT_BYTES * CHUNK_EVENTS):
            rows = np.frombuffer(data, np.uint8).reshape(-1, _EVENT_BYTES).astype(np.int64)
            overflows = rows[:, 1] == _OVERFLOW_Y
            t = (rows[:, 2] & 127) << 16 | rows[:, 3] << 8 | rows[:, 4]
            t += added_us + _OVERFLOW_US * np.cumsum(overflows)
            added_us += _OVERFLOW_US * int(np.count_nonzero(overflows))
            if np.count_nonzero(t[1:] < t[:-1]) > _MOST_FALLS * len(t):
                raise ValueError("its times go up and down, as no recording's of N-MNIST do")
            events = empty_batch(len(rows))
            events["t"], events["x"], events["y"], events["on"] = t, rows[:, 0], rows[:, 1], rows[:, 2] >> 7
            yield events[~overflows]
