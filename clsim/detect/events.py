"""Host side of events.cl: levels become events."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.detect.config import DetectorConfig
from clsim.detect.gate import Gate, Level, model_macros
from clsim.detect.wlr import History, Regression
from clsim.events import EventBatch, empty_batch
from clsim.opencl.workplace import Buffer, Workplace

_CHUNK = 64
"""Pixels of the list that one work-item turns into events."""


@dataclass(frozen=True)
class Interval:
    """A time step: from the last processed frame to this one [µs]."""

    start_us: int
    end_us: int


@dataclass(frozen=True)
class Fired:
    """A step's events, how many pixels had more than 3 crossings, the most of any, and how many were left out."""

    events: EventBatch
    many_crossings: int
    most_crossings: int
    capped: int


class EventRule:
    """Applies the event rule to the listed pixels and keeps references, levels and models up to date."""

    def __init__(
        self, workplace: Workplace, config: DetectorConfig, gate: Gate, packed: Buffer, regression: Regression | None
    ) -> None:
        """Build the kernels; ``regression`` where pixels keep a model of their last event."""
        self._workplace = workplace
        self._config = config
        self._gate = gate
        self._packed = packed
        self._regression = regression
        macros: dict[str, object] = {"CHUNK": _CHUNK, **model_macros(config)}
        if config.event_rule == "frame":
            macros["FRAME_RULE"] = 1
        self._decide, self._emit = workplace.kernels("events", ("decide_events", "emit_events"), macros)
        layout = workplace.layout
        pixels = layout.height * layout.span
        chunks = -(-pixels // _CHUNK)
        self._fired = workplace.allocate((pixels,), np.int32)
        self._from = workplace.allocate((pixels, 3))
        self._counts = workplace.allocate((chunks, 4), np.int32)
        self._host_counts = np.zeros((chunks, 4), dtype=np.int32)
        self._start = workplace.allocate((chunks,), np.int32)
        self._grow(max(pixels // 4, 1024))

    def _grow(self, capacity: int) -> None:
        """Make room for ``capacity`` events of one step."""
        kinds: tuple[npt.DTypeLike, ...] = (np.int64, np.uint16, np.uint16, np.uint8)
        self._out = [self._workplace.allocate((capacity,), kind) for kind in kinds]
        self._host_out: list[npt.NDArray[Any]] = [np.empty(capacity, dtype=kind) for kind in kinds]

    def apply(self, count: int, level: Level, state: Buffer, history: History, interval: Interval) -> Fired:
        """Decide about the first ``count`` pixels of the gate's list and return their events, sorted."""
        layout, config = self._workplace.layout, self._config
        chunks = -(-count // _CHUNK)
        model: tuple[object, ...] = ()
        if self._regression is not None:
            fit = self._regression
            model = (
                self._packed, np.int64(fit.packed_size), fit.extremes, np.int64(fit.extremes_size), history.frames,
                history.slot, fit.slots, layout.pitch, self._gate.boxes, fit.fit,
            )  # fmt: skip
        self._workplace.launch(
            self._decide, (chunks,), self._gate.pixels, count, self._gate.flags, level.values, np.int64(level.row),
            np.int64(level.start), layout.span, config.threshold_on, config.threshold_off, state, *model,
            self._fired, self._from, self._counts,
        )  # fmt: skip
        counts = self._workplace.read(self._counts, self._host_counts[:chunks])
        total, many, capped = (int(value) for value in counts[:, :3].sum(axis=0, dtype=np.int64))
        most = int(counts[:, 3].max())
        if total == 0:
            return Fired(empty_batch(), many, most, capped)
        if total > self._out[0].shape[0]:
            self._grow(2 * total)
        start = np.zeros(chunks, dtype=np.int32)
        np.cumsum(counts[:-1, 0], out=start[1:])
        self._workplace.write(self._start, start)
        step_us = interval.end_us - interval.start_us
        self._workplace.launch(
            self._emit, (chunks,), self._gate.pixels, count, self._fired, self._from, self._start, layout.span,
            np.int64(interval.start_us), np.int64(step_us), config.threshold_on, config.threshold_off, *self._out,
        )  # fmt: skip
        return Fired(self._sorted(total), many, most, capped)

    def _sorted(self, total: int) -> EventBatch:
        # The kernel wrote them in raster order: a stable sort by time is all that is left to do.
        t, x, y, on = (
            self._workplace.read(out, host[:total]) for out, host in zip(self._out, self._host_out, strict=True)
        )
        batch = empty_batch(total)
        if self._config.event_rule == "frame":
            batch["t"], batch["x"], batch["y"], batch["on"] = t, x, y, on
            return batch
        order = np.argsort(t, kind="stable")
        batch["t"], batch["x"], batch["y"], batch["on"] = t[order], x[order], y[order], on[order]
        return batch
