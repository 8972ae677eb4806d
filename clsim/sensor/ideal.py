"""Host side of sensor_ideal.cl: the ideal pixel, which fires whenever brightness has moved by a contrast threshold."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.events import Causes, EventBatch, empty_batch
from clsim.opencl.path import BrightnessPath
from clsim.opencl.workplace import Buffer, Grid, Workplace

_CHUNK = 64
"""Pixels of the path's list that one work-item turns into events."""
_MOST_OF_A_PIXEL = 1000
"""Events of one pixel in one step (MAX_EVENTS in sensor_ideal.cl)."""
_WRITTEN = np.dtype([("t", np.int64), ("x", np.uint16), ("y", np.uint16), ("on", np.uint32)])
"""An event as kernels write it (Event in sensor_ideal.cl)."""
_PORTION = 1 << 20
"""Events that are written at a time, at most: more of a step come in several portions, so memory does not grow."""


@dataclass(frozen=True)
class Thresholds:
    """When a pixel fires.

    Attributes:
        on: contrast threshold of ON events [natural-log units], > 0.
        off: contrast threshold of OFF events, > 0.
        at_step_ends: at most one event a pixel and step, at the step's end, whose level is the new reference; else one
            for each threshold crossed, brightness being linear in time, and the reference moves by the threshold.
    """

    on: float
    off: float
    at_step_ends: bool = False


@dataclass(frozen=True)
class Fired:
    """What happened in a step.

    Attributes:
        events: sorted by t, then (y, x).
        crossings: int32, for each listed pixel of the path: how many events, negative where the last is OFF; on the
            device.
        many_crossings: pixels with more than 3 crossings, and without knots.
        most_crossings: the most crossings of a pixel without knots.
        capped: events left out because a pixel had more than 1000.
        causes: uint8, of each event (see `clsim.events.CAUSES`); None where brightness causes them all.
        lost: events that the readout had no time for.
    """

    events: EventBatch
    crossings: Buffer
    many_crossings: int = 0
    most_crossings: int = 0
    capped: int = 0
    causes: Causes | None = None
    lost: int = 0


class IdealPixels:
    """Pixels without noise, delay or rest.

    Attributes:
        references: ``[H, span]``, level of each pixel's last event [natural-log units]; NaN before its first level.
    """

    def __init__(self, place: Workplace[Grid], thresholds: Thresholds) -> None:
        """Build the kernels; no pixel has a reference."""
        self._place, self._thresholds = place, thresholds
        self._kernels = {False: self._build({})}
        pixels = place.layout.height * place.layout.span
        chunks = -(-pixels // _CHUNK)
        self.references = place.allocate(place.layout.image_shape, fill=np.nan)
        self._crossings = place.allocate((pixels,), np.int32)
        self._from = place.allocate((pixels, 3))
        self._counts = place.allocate((chunks, 4), np.int64)
        self._host_counts = np.zeros((chunks, 4), dtype=np.int64)
        self._starts = place.allocate((chunks,), np.int32)
        self._capacity = min(max(pixels, _CHUNK * _MOST_OF_A_PIXEL), _PORTION)
        self._out = Buffer(place.allocate((2 * self._capacity,), np.int64).memory, (self._capacity,), _WRITTEN)
        self._host_out = np.empty(self._capacity, dtype=_WRITTEN)

    def _build(self, more: dict[str, object]) -> list[Any]:
        macros: dict[str, object] = {"CHUNK": _CHUNK, **more}
        if self._thresholds.at_step_ends:
            macros["FRAME_RULE"] = 1
        return self._place.kernels("sensor_ideal", ("decide_events", "emit_events"), macros)

    def _for(self, path: BrightnessPath) -> tuple[Any, Any, tuple[Buffer, ...]]:
        """Return the kernels for a path, and what they take of its knots: none where only the step's end counts."""
        knots = None if self._thresholds.at_step_ends else path.knots
        if knots is not None and True not in self._kernels:
            self._kernels[True] = self._build({"KNOTS": 1})
        decide, emit = self._kernels[knots is not None]
        return decide, emit, () if knots is None else (knots.offsets, knots.times_ns, knots.levels)

    def forget(self) -> None:
        """Take all references back: the next level of each pixel is its first."""
        self._place.write(self.references, np.full(self.references.shape, np.nan, dtype=self._place.real))

    def step(self, path: BrightnessPath) -> Fired:
        """Return the events of a time step and move the references of the pixels that fired."""
        if path.count == 0:
            return Fired(empty_batch(), self._crossings)
        place, thresholds = self._place, self._thresholds
        decide, _, knots = self._for(path)
        chunks = -(-path.count // _CHUNK)
        place.launch(
            decide, (chunks,), path.pixels, path.count, path.start, path.end, *knots, thresholds.on, thresholds.off,
            self.references, self._crossings, self._from, self._counts,
        )  # fmt: skip
        counts = place.read(self._counts, self._host_counts[:chunks])
        total, many, capped = (int(value) for value in counts[:, :3].sum(axis=0))
        most = int(counts[:, 3].max())
        batch = empty_batch(total)
        done = 0
        for first, last in self._portions(counts[:, 0]):
            done += self._write(path, first, counts[first:last, 0], batch[done:])
        return Fired(self._sorted(batch), self._crossings, many, most, capped)

    def _portions(self, events: npt.NDArray[np.int64]) -> Iterator[tuple[int, int]]:
        """Yield runs of chunks, first and last + 1, that fit the buffers; ``events`` counts those of each chunk."""
        ends = np.cumsum(events)
        first, before = 0, 0
        while before < ends[-1]:
            last = int(np.searchsorted(ends, before + self._capacity, side="right"))
            yield first, last
            first, before = last, int(ends[last - 1])

    def _write(self, path: BrightnessPath, first: int, events: npt.NDArray[np.int64], out_batch: EventBatch) -> int:
        """Write the events of the chunks from ``first`` on, in raster order, and return how many there are."""
        place, thresholds = self._place, self._thresholds
        _, emit, knots = self._for(path)
        starts = np.zeros(len(events), dtype=np.int32)
        np.cumsum(events[:-1], out=starts[1:])
        total = int(events.sum())
        writing = place.begin_write(self._starts, starts)
        place.launch(
            emit, (len(events),), path.pixels, path.count, first, self._crossings, self._from, self._starts,
            place.layout.span, np.int64(path.start_us), np.int64(path.end_us - path.start_us), *knots, thresholds.on,
            thresholds.off, self._out,
        )  # fmt: skip
        written = place.read(self._out, self._host_out[:total])
        writing.wait()
        for name in out_batch.dtype.names or ():
            out_batch[name][:total] = written[name]
        return total

    def _sorted(self, batch: EventBatch) -> EventBatch:
        # In raster order already: a stable sort by time is all that is left to do.
        if self._thresholds.at_step_ends:
            return batch
        return batch[np.argsort(batch["t"], kind="stable")]
