"""The words of EVT3, their encoder and decoder.

Source: https://docs.prophesee.ai/stable/data/encoding_formats/evt3.html
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from clsim.events.batch import EventBatch, empty_batch
from clsim.events.filesource import open_binary

ADDR_Y, ADDR_X, BASE_X, VECT_12, VECT_8 = 0x0, 0x2000, 0x3000, 0x4000, 0x5000
TIME_LOW, TIME_HIGH = 0x6000, 0x8000
_LAP = np.array([TIME_HIGH | 0xFFF, TIME_HIGH], "<u2")
_LAP_DROP = 1 << 11  # so far the upper time goes back where the clock begins anew; OpenEB's rule
_BLOCK_WORDS = 1 << 16  # up to 12 events each


class Evt3Encoder:
    """Turns events into words; time and row live on from one batch to the next, and are sent when they change."""

    def __init__(self) -> None:
        """Start before the first word."""
        self._time_us = -1
        self._row = -1

    def encode(self, events: EventBatch, *, afresh: bool = False) -> npt.NDArray[np.uint16]:
        """Return the words of events, which follow those before; ``afresh`` sends time and row again."""
        if not len(events):
            return np.empty(0, "<u2")
        t, y = events["t"], events["y"]
        before = np.concatenate(([self._time_us], t[:-1]))
        laps = (t >> 24) - (np.maximum(before, 0) >> 24)
        new_high = (t >> 12) != (before >> 12)
        new_low = t != before
        new_row = np.diff(y.astype(np.int32), prepend=self._row) != 0
        if afresh:
            new_high[0] = new_low[0] = new_row[0] = True
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
        return words

    def silence(self, end_us: int) -> npt.NDArray[np.uint16]:
        """Return the words that tell that nothing happens until ``end_us``; none where time has not gone on."""
        end, last = end_us >> 12, self._time_us >> 12
        if not last < end < 1 << 28:
            return np.empty(0, "<u2")
        laps = (end >> 12) - (max(last, 0) >> 12)
        return np.append(np.tile(_LAP, laps), TIME_HIGH | end & 0xFFF).astype("<u2")


def decode_file(path: Path, start: int, decoder: Evt3Decoder) -> Iterator[EventBatch]:
    """Yield the events of an EVT3 file whose first word is at byte ``start``; a torn last word is left out."""
    with open_binary(path) as file:
        file.seek(start)
        while data := file.read(2 * _BLOCK_WORDS):
            yield decoder.decode(np.frombuffer(data, "<u2", len(data) // 2))


class Evt3Decoder:
    """Turns words into events; time, row and vector base live on from one block of words to the next.

    Cameras send events outside the sensor and upper times that go back a little. Those events, and events earlier than
    a block before theirs, are left out and counted in ``dropped_events``.
    """

    def __init__(self, width: int | None, height: int | None) -> None:
        """Start before the first word; events ahead of the first time word are left out."""
        self.dropped_events = 0
        self._width, self._height = width or 1 << 16, height or 1 << 16
        self._last_us = 0
        self._laps = -1
        self._high = 2 * _LAP_DROP + 0x1000  # above all: the first time word begins lap 0
        self._low = 0
        self._row = 0
        self._base = 0
        self._base_on = 0

    def decode(self, words: npt.NDArray[np.uint16]) -> EventBatch:
        """Return the events of a block of words."""
        kind = words & 0xF000
        value = (words & 0xFFF).astype(np.int64)
        is_high, is_base = kind == TIME_HIGH, kind == BASE_X

        highs = np.concatenate(([self._high], value[is_high]))
        laps = self._laps + np.cumsum(np.diff(highs, prepend=highs[0]) <= -_LAP_DROP)
        clock = laps << 12 | highs
        at_high = np.cumsum(is_high)
        # A new upper time sets the lower bits to 0; a lower one, if they are not, follows.
        is_new = is_high.copy()
        is_new[is_high] = np.diff(highs) != 0
        lows = _held(np.where(is_new, 0, value), is_new | (kind == TIME_LOW), self._low)
        rows = _held(value & 0x7FF, kind == ADDR_Y, self._row)

        # A vector word describes the next 12 or 8 pixels of the row, from the base on.
        step = np.where(kind == VECT_12, 12, np.where(kind == VECT_8, 8, 0))
        walked = np.cumsum(step) - step
        bases = _held(value & 0x7FF, is_base, self._base) + walked - _held(walked, is_base, 0)
        base_on = _held(value >> 11, is_base, self._base_on)

        masks = np.where(kind == ADDR_X, 1, np.where(step == 8, value & 0xFF, np.where(step == 12, value, 0)))
        masks[clock[at_high] < 0] = 0
        source = np.flatnonzero(masks)
        if step.any():
            word, bit = np.nonzero(masks[source, None] >> np.arange(12) & 1)
            word = source[word]
        else:
            word, bit = source, np.zeros_like(source)
        single = kind[word] == ADDR_X
        events = empty_batch(len(word))
        events["t"] = clock[at_high[word]] << 12 | lows[word]
        events["x"] = np.where(single, value[word] & 0x7FF, bases[word] + bit)
        events["y"] = rows[word]
        events["on"] = np.where(single, value[word] >> 11, base_on[word])

        if len(words):
            self._laps, self._high = int(laps[-1]), int(highs[-1])
            self._low, self._row, self._base_on = int(lows[-1]), int(rows[-1]), int(base_on[-1])
            self._base = int(bases[-1] + step[-1])
        return self._clean(events)

    def _clean(self, events: EventBatch) -> EventBatch:
        """Return the events inside the sensor in the order of their times."""
        fits = (events["x"] < self._width) & (events["y"] < self._height) & (events["t"] >= self._last_us)
        if not fits.all():
            self.dropped_events += len(events) - int(np.count_nonzero(fits))
            events = events[fits]
        if len(events):
            if (events["t"][1:] < events["t"][:-1]).any():
                events = events[np.argsort(events["t"], kind="stable")]
            self._last_us = int(events["t"][-1])
        return events


def _held(values: npt.NDArray[np.int64], new: npt.NDArray[np.bool_], before: int) -> npt.NDArray[np.int64]:
    """Return at each word the latest of the values marked ``new``, ``before`` ahead of the first."""
    latest = np.maximum.accumulate(np.where(new, np.arange(1, len(new) + 1), 0)) if len(new) else np.zeros(0, np.int64)
    return np.concatenate(([before], values))[latest]
