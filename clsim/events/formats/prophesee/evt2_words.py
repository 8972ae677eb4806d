"""The words of EVT2, EVT2.1 and EVT4: an upper time when it changes, then words of events that carry the lower 6 bits.

Sources: https://docs.prophesee.ai/stable/data/encoding_formats/evt2.html, evt21.html and evt4.html beside it.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from clsim.events.batch import EventBatch, empty_batch
from clsim.events.formats.filesource import CutShortError, open_binary
from clsim.events.formats.laps import Laps

Encoding = Literal["evt2", "evt21", "evt21-legacy", "evt4"]
_TIME_HIGH = {"evt2": 0x8, "evt21": 0x8, "evt21-legacy": 0x8, "evt4": 0xE}
_OFF = {"evt2": 0x0, "evt21": 0x0, "evt21-legacy": 0x0, "evt4": 0xA}
"""Type of an OFF event; that of an ON event is one more, those of EVT4's vectors are two more."""
_LOW_BITS, _HIGH_BITS, _VECTOR = 6, 28, 32
_BLOCK_BYTES = 1 << 18


class _Found(NamedTuple):
    """Words of events of a block: where they stand, and which of the 32 pixels from their column on they are about."""

    heads: npt.NDArray[np.uint32]
    at: npt.NDArray[np.int64]
    masks: npt.NDArray[np.uint32] | None


class Evt2Decoder:
    """Turns words into events; time lives on from one block of words to the next.

    Events outside the sensor and those before the first upper time, which have no time, are left out and counted in
    ``dropped_events``.
    """

    def __init__(self, encoding: Encoding, width: int | None, height: int | None) -> None:
        """Start before the first word."""
        self.dropped_events = 0
        self.word_bytes = 8 if encoding.startswith("evt21") else 4
        self._encoding = encoding
        self._width, self._height = width or 1 << 16, height or 1 << 16
        self._high = -1
        self._laps = Laps(1 << _HIGH_BITS)
        self._rest = np.empty(0, "<u4")

    @property
    def waits(self) -> bool:
        """Whether the last word needs one that follows."""
        return len(self._rest) > 0

    def decode(self, data: bytes) -> EventBatch:
        """Return the events of a block of whole words, which follows those before."""
        words = np.frombuffer(data, "<u4")
        if self._encoding == "evt4":
            words = np.concatenate((self._rest, words))
        heads, masks = self._split(words)
        kinds = heads >> 28
        is_high = kinds == _TIME_HIGH[self._encoding]
        highs = self._laps.unroll((heads[is_high] & 0xFFFFFFF).astype(np.int64))
        highs = np.concatenate(([self._high], highs))
        self._high = int(highs[-1])
        found = self._events(heads, kinds, masks)
        high = highs[np.cumsum(is_high, dtype=np.int32)[found.at]]
        return self._batch(found, high)

    def _split(self, words: npt.NDArray[np.uint32]) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.uint32] | None]:
        """Return the words that tell what they are, and the words of 32 pixels that belong to them."""
        if self._encoding == "evt2":
            return words, None
        if self._encoding != "evt4":
            pairs = words.reshape(-1, 2)
            return (pairs[:, 0], pairs[:, 1]) if self._encoding == "evt21-legacy" else (pairs[:, 1], pairs[:, 0])
        # The word behind the head of a vector is its mask, whatever it looks like: of words in a row that look like
        # heads, every other one is.
        alike = (words >> 28 == 0xC) | (words >> 28 == 0xD)
        index = np.arange(len(words))
        begins = np.maximum.accumulate(np.where(alike & ~np.concatenate(([False], alike[:-1])), index, 0))
        is_vector = alike & ((index - begins) % 2 == 0)
        if len(words) and is_vector[-1]:
            self._rest, words, is_vector = words[-1:], words[:-1], is_vector[:-1]
        else:
            self._rest = words[:0]
        is_mask = np.concatenate(([False], is_vector[:-1])) if len(words) else is_vector
        masks = np.ones(len(words), "<u4")
        masks[is_vector] = words[is_mask]
        return words[~is_mask], masks[~is_mask]

    def _events(
        self, heads: npt.NDArray[np.uint32], kinds: npt.NDArray[Any], masks: npt.NDArray[np.uint32] | None
    ) -> _Found:
        off = _OFF[self._encoding]
        at = np.flatnonzero((kinds >= off) & (kinds <= off + (3 if self._encoding == "evt4" else 1)))
        return _Found(heads[at], at, None if masks is None else masks[at])

    def _batch(self, found: _Found, high: npt.NDArray[np.int64]) -> EventBatch:
        heads, _, masks = found
        on = (heads >> 28 & 1) != 0
        low, x, y = heads >> 22 & 0x3F, heads >> 11 & 0x7FF, heads & 0x7FF
        if masks is not None:
            bits = np.unpackbits(np.ascontiguousarray(masks, "<u4").view(np.uint8), bitorder="little")
            word, step = np.nonzero(bits.reshape(-1, _VECTOR))
            high, on, low, x, y = high[word], on[word], low[word], x[word] + step, y[word]
        fits = (x < self._width) & (y < self._height) & (high >= 0)
        if not fits.all():
            self.dropped_events += len(x) - int(np.count_nonzero(fits))
            high, on, low, x, y = high[fits], on[fits], low[fits], x[fits], y[fits]
        events = empty_batch(len(x))
        events["t"] = high << _LOW_BITS | low
        events["x"], events["y"], events["on"] = x, y, on
        return events


def decode_file(path: Path, start: int, decoder: Evt2Decoder) -> Iterator[EventBatch]:
    """Yield the events of a file whose first word is at byte ``start``.

    Raises CutShortError where the last word is torn, or the one that belongs to it is missing.
    """
    size = decoder.word_bytes
    with open_binary(path) as file:
        file.seek(start)
        while data := file.read(_BLOCK_BYTES):
            yield decoder.decode(data[: len(data) // size * size])
            if len(data) % size:
                raise CutShortError("within a word")
    if decoder.waits:
        raise CutShortError("within a vector of events")
