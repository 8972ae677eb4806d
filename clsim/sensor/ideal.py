"""Host side of ideal.cl: the ideal pixel, which fires whenever brightness has moved by a contrast threshold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.events import EVENT_DTYPE, Causes, EventBatch, empty_batch
from clsim.opencl.path import BrightnessPath
from clsim.opencl.workplace import Buffer, Grid, Workplace

_CHUNK, _LARGEST_CHUNK = 64, 1024
"""Pixels of the path's list that one work-item turns into events, at least and at most."""
_FEW = 16
"""Chunks up to which one work-item of a CPU turns all of them into events."""
_CHUNKS = 2048
"""Work-items up to which they do not grow: each sums up what those before it write."""
_MOST_OF_A_PIXEL = 1000
"""Events of one pixel in one step (MAX_EVENTS in ideal.cl)."""
_PORTION = 1 << 20
"""Events that are written at a time, at most, and more than a work-item has: memory does not grow with a step's."""


@dataclass(frozen=True)
class Thresholds:
    """When a pixel fires.

    Attributes:
        on: contrast threshold of ON events [natural-log units], > 0.
        off: contrast threshold of OFF events, > 0.
        at_step_ends: at most one event a pixel and step, at the step's end, whose level is the new reference; else one
            for each threshold crossed, brightness being linear in time, and the reference moves by the threshold.
        linear_light: between the ends of a step without knots, light is linear in time, and not its logarithm.
    """

    on: float
    off: float
    at_step_ends: bool = False
    linear_light: bool = False


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
        chunks = min(-(-pixels // _CHUNK), max(_CHUNKS, -(-pixels // _LARGEST_CHUNK)))
        self.references = place.allocate(place.layout.image_shape, fill=np.nan)
        self._crossings = place.allocate((pixels,), np.int32)
        self._from = place.allocate((pixels, 3))
        self._counts = place.allocate_seen((chunks, 4), np.int64)
        self._few = _FEW if place.device.is_cpu else 0
        self._capacity = min(max(pixels, _chunk(pixels) * _MOST_OF_A_PIXEL), _PORTION)
        self._out = place.allocate_seen((self._capacity,), EVENT_DTYPE)

    def _build(self, more: dict[str, object]) -> list[Any]:
        rules = {"FRAME_RULE": self._thresholds.at_step_ends, "LINEAR_LIGHT": self._thresholds.linear_light}
        macros = more | {name: 1 for name, holds in rules.items() if holds}
        return self._place.kernels("sensor/ideal", ("decide_events", "emit_events", "fire_events"), macros)

    def _for(self, path: BrightnessPath) -> tuple[list[Any], tuple[Buffer, ...]]:
        """Return the kernels for a path, and what they take of its knots: none where only the step's end counts."""
        knots = None if self._thresholds.at_step_ends else path.knots
        if knots is not None and True not in self._kernels:
            self._kernels[True] = self._build({"KNOTS": 1})
        kernels = self._kernels[knots is not None]
        return kernels, () if knots is None else (knots.offsets, knots.times_ns, knots.levels)

    def forget(self) -> None:
        """Take all references back: the next level of each pixel is its first."""
        self._place.write(self.references, np.full(self.references.shape, np.nan, dtype=self._place.real))

    def restart(self) -> None:
        """Forget; nothing is ever on its way."""
        self.forget()

    def step(self, path: BrightnessPath) -> Fired:
        """Return the events of a time step and move the references of the pixels that fired."""
        if path.count == 0:
            return Fired(empty_batch(), self._crossings)
        chunk = _chunk(path.count)
        chunks = -(-path.count // chunk)
        self._fire(path, chunk, chunks)
        counts = self._place.seen(self._counts, chunks)
        total, many, capped, _ = counts.sum(axis=0).tolist()
        most = int(counts[:, 3].max())
        batch = self._place.seen(self._out, total) if total <= self._capacity else self._portions(path, chunk, counts)
        return Fired(self._sorted(batch), self._crossings, many, most, capped)

    def _fire(self, path: BrightnessPath, chunk: int, chunks: int) -> None:
        """Decide what fires, and write the events before anyone knows how many there are: as a rule they have room."""
        place, thresholds = self._place, self._thresholds
        (decide, _, fire), knots = self._for(path)
        if chunks > self._few:
            place.launch(
                decide, (chunks,), path.pixels, path.count, chunk, path.start, path.end, *knots, thresholds.on,
                thresholds.off, self.references, self._crossings, self._from, self._counts,
            )  # fmt: skip
            self._emit(path, chunk, 0, chunks)
            return
        place.launch(
            fire, (1,), path.pixels, path.count, chunk, path.start, path.end, np.int64(self._capacity),
            place.layout.span, np.int64(path.start_us), np.int64(path.end_us - path.start_us), *knots, thresholds.on,
            thresholds.off, self.references, self._crossings, self._from, self._counts, self._out,
        )  # fmt: skip

    def _emit(self, path: BrightnessPath, chunk: int, first: int, chunks: int) -> None:
        """Let the work-items from ``first`` on write their events, in raster order, as far as there is room."""
        place, thresholds = self._place, self._thresholds
        (_, emit, _), knots = self._for(path)
        place.launch(
            emit, (chunks - first,), path.pixels, path.count, chunk, first, self._crossings, self._from, self._counts,
            np.int64(self._capacity), place.layout.span, np.int64(path.start_us),
            np.int64(path.end_us - path.start_us), *knots, thresholds.on, thresholds.off, self._out,
        )  # fmt: skip

    def _portions(self, path: BrightnessPath, chunk: int, counts: npt.NDArray[np.int64]) -> EventBatch:
        """Return more events than there is room for, of which the first were written."""
        ends = np.cumsum(counts[:, 0])
        batch = empty_batch(int(ends[-1]))
        first, done = 0, 0
        while done < len(batch):
            if first:
                self._emit(path, chunk, first, len(counts))
            first = int(np.searchsorted(ends, done + self._capacity, side="right"))
            end = int(ends[first - 1])
            batch[done:end] = self._place.seen(self._out, end - done)
            done = end
        return batch

    def _sorted(self, batch: EventBatch) -> EventBatch:
        # In raster order already: a stable sort by time is all that is left to do.
        if self._thresholds.at_step_ends:
            return np.array(batch)
        order = np.argsort(batch["t"], kind="stable")
        return np.take(batch, order)  # an index takes ten times as long


def _chunk(pixels: int) -> int:
    """Return how many of so many listed pixels one work-item handles."""
    return min(max(_CHUNK, -(-pixels // _CHUNKS)), _LARGEST_CHUNK)
