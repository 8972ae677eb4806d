"""The words of EVT3, their encoder and decoder.

Source: https://docs.prophesee.ai/stable/data/encoding_formats/evt3.html
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from clsim.events.batch import EventBatch, empty_batch
from clsim.events.formats.filesource import CutShortError, open_binary

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
    """Yield the events of an EVT3 file whose words begin at byte ``start``; CutShortError tells of a torn last one."""
    with open_binary(path) as file:
        file.seek(start)
        while data := file.read(2 * _BLOCK_WORDS):
            yield decoder.decode(np.frombuffer(data, "<u2", len(data) // 2))
            if len(data) % 2:
                raise CutShortError("within a word")


class Evt3Decoder:
    """Turns words into events; time, row and vector base live on from one block of words to the next.

    Cameras send events outside the sensor. These, and those before the first upper time, which have no time, are left
    out and counted in ``dropped_events``. Upper times may go back a little, so that events are not in order.
    """

    def __init__(self, width: int | None, height: int | None) -> None:
        """Start before the first word."""
        self.dropped_events = 0
        self._width, self._height = width or 1 << 16, height or 1 << 16
        self._laps = -1
        self._high = 2 * _LAP_DROP + 0x1000  # above all: the first time word begins lap 0
        self._low = 0
        self._row = 0
        self._base = 0
        self._base_on = False

    def decode(self, words: npt.NDArray[np.uint16]) -> EventBatch:
        """Return the events of a block of words."""
        kind = words & np.uint16(0xF000)
        is_low, is_high, is_row = kind == TIME_LOW, kind == TIME_HIGH, kind == ADDR_Y
        times = self._times(words, is_low, is_high)
        rows = np.concatenate(([self._row], words[is_row] & 0x7FF)).astype(np.uint16)
        at, x, on = self._columns(words, kind)
        t = times[np.cumsum(is_low | is_high, dtype=np.int32)[at]]
        y = rows[np.cumsum(is_row, dtype=np.int32)[at]]
        self._row = int(rows[-1])
        return self._clean(t, x, y, on)

    def _times(
        self, words: npt.NDArray[np.uint16], is_low: npt.NDArray[np.bool_], is_high: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.int64]:
        """Return the time [µs] before the first time word, and after each; below 0 ahead of the first upper time."""
        found = np.flatnonzero(is_low | is_high)
        value = (words[found] & 0xFFF).astype(np.int64)
        high = is_high[found]
        highs = np.concatenate(([self._high], value[high]))
        change = np.diff(highs)
        laps = self._laps + np.concatenate(([0], np.cumsum(change <= -_LAP_DROP)))
        # A new upper time sets the lower bits to 0; a lower one, if they are not, follows.
        value[high] = 0
        lows = np.concatenate(([self._low], value))
        if not change.all():  # cameras repeat the upper time, which leaves the lower bits as they are
            told = np.arange(len(lows))
            told[1:][high] *= change != 0
            lows = lows[np.maximum.accumulate(told)]
        clock = (laps << 12 | highs)[np.concatenate(([0], np.cumsum(high)))]
        self._laps, self._high, self._low = int(laps[-1]), int(highs[-1]), int(lows[-1])
        return np.where(clock < 0, -1, clock << 12 | lows)

    def _columns(
        self, words: npt.NDArray[np.uint16], kind: npt.NDArray[np.uint16]
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
        """Return the word of each event, its column, and whether it is ON."""
        at = np.flatnonzero(kind == ADDR_X)
        x, on = (words[at] & 0x7FF).astype(np.int64), (words[at] & 0x800) != 0
        is_base = kind == BASE_X
        bases = np.concatenate(([self._base], words[is_base] & 0x7FF))
        base_on = np.concatenate(([self._base_on], (words[is_base] & 0x800) != 0))
        self._base, self._base_on = int(bases[-1]), bool(base_on[-1])
        vectors = np.flatnonzero((kind == VECT_12) | (kind == VECT_8))
        if not len(vectors):
            return at, x, on

        # A vector word describes the next 12 or 8 pixels of the row, from the base on.
        steps = np.where(kind[vectors] == VECT_12, 12, 8)
        walked = np.concatenate(([0], np.cumsum(steps)))
        first = np.concatenate(([0], np.searchsorted(vectors, np.flatnonzero(is_base))))  # vector after each base
        self._base += int(walked[-1] - walked[first[-1]])
        masks = words[vectors] & ((1 << steps) - 1).astype("<u2")
        bits = np.flatnonzero(np.unpackbits(masks.view(np.uint8), bitorder="little"))
        vector = bits >> 4
        base = np.cumsum(is_base, dtype=np.int32)[vectors[vector]]
        column = bases[base] + walked[vector] - walked[first[base]] + (bits & 15)
        at = np.concatenate((at, vectors[vector]))
        order = np.argsort(at, kind="stable")
        return at[order], np.concatenate((x, column))[order], np.concatenate((on, base_on[base]))[order]

    def _clean(
        self, t: npt.NDArray[np.int64], x: npt.NDArray[np.int64], y: npt.NDArray[np.uint16], on: npt.NDArray[np.bool_]
    ) -> EventBatch:
        """Return the events that have a time (-1 is none) and lie inside the sensor."""
        fits = (x < self._width) & (y < self._height) & (t >= 0)
        if not fits.all():
            self.dropped_events += len(t) - int(np.count_nonzero(fits))
            t, x, y, on = t[fits], x[fits], y[fits], on[fits]
        events = empty_batch(len(t))
        events["t"], events["x"], events["y"], events["on"] = t, x, y, on
        return events
