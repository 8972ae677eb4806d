"""Host side of gate.cl: which pixels may fire, and the level of those that cannot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from clsim.detect.layout import CHUNK, Place
from clsim.opencl.workplace import Buffer

_LISTED = 64
"""Rows that one work-item lists on a CPU: it takes longer to wake its threads than to read a small picture."""


@dataclass(frozen=True)
class Level:
    """Where the current level of each pixel is: value (x, y) at ``start + y·row + x``."""

    values: Buffer
    start: int
    row: int


@dataclass(frozen=True)
class Counts:
    """How many pixels of a frame are not valid, cannot fire, may fire, and are new."""

    invalid: int
    kept: int
    solved: int
    fresh: int

    @property
    def listed(self) -> int:
        """Pixels that need a closer look."""
        return self.solved + self.fresh


@dataclass
class Levels:
    """Levels of all pixels at both ends of a time step, ``[H, span]`` [natural-log units], and the thresholds.

    Attributes:
        start: at the last frame; NaN before a pixel's first.
        end: at this frame.
        threshold_on: contrast threshold of ON events.
        threshold_off: contrast threshold of OFF events.
    """

    start: Buffer
    end: Buffer
    threshold_on: float
    threshold_off: float

    def advance(self) -> None:
        """Let the end of a step be the start of the next."""
        self.start, self.end = self.end, self.start


class Gate:
    """Sorts a frame's pixels into those that may fire and those that cannot.

    Attributes:
        flags: ``[H, span]`` bytes, what becomes of each pixel (packed.clh).
        counts: ``[H, 4]``, how many of each there are in a row.
        pixels: ``[H·span]``, after `collect` the pixels that may fire or are new, in raster order, as y·span + x.
    """

    def __init__(self, place: Place, macros: Mapping[str, object] | None = None) -> None:
        """Allocate memory, and build the kernels that all gates have."""
        self._place = place
        layout = place.layout
        listed = _LISTED if place.device.is_cpu else 1
        self._macros = {"CHUNK": CHUNK, "LISTED": listed, **(macros or {})}
        (self._list,) = place.kernels("detect/gate", ("list_pixels",), self._macros)
        self.flags = place.allocate(layout.image_shape, np.uint8)
        self.counts = place.allocate_seen((layout.height, 4), np.int32)
        self.pixels = place.allocate((layout.height * layout.span,), np.int32)
        self._lists = -(-layout.height // listed)

    def collect(self) -> Counts:
        """List the flagged pixels that may fire or are new, and count all."""
        layout = self._place.layout
        self._place.launch(self._list, (self._lists,), self.flags, self.counts, layout.height, layout.span, self.pixels)
        totals = self._place.seen(self.counts, layout.height).sum(axis=0)
        return Counts(*totals.tolist())


class LevelGate(Gate):
    """The level of every pixel is known: those that reach a threshold may fire."""

    def __init__(self, place: Place) -> None:
        """Build the kernels."""
        super().__init__(place)
        (self._test,) = place.kernels("detect/gate", ("gate_level",), self._macros)

    def test(self, packed: Buffer, start: int, level: Level, levels: Levels, references: Buffer) -> None:
        """Flag pixels by their ``level`` and write it into ``levels``; the packed frame is at ``start``."""
        layout = self._place.layout
        self._place.launch(
            self._test, (layout.height,), packed, np.int64(start), level.values, np.int64(level.row),
            np.int64(level.start), layout.pitch, layout.span, layout.width, references, levels.threshold_on,
            levels.threshold_off, levels.start, levels.end, self.flags, self.counts,
        )  # fmt: skip


class ModelGate(Gate):
    """Pixels whose model of the last event predicts that a threshold may be reached may fire."""

    def __init__(self, place: Place, macros: Mapping[str, object]) -> None:
        """Build the kernels; ``macros`` as `clsim.detect.models.model_macros` gives them."""
        super().__init__(place, macros)
        self._test, self._take = place.kernels("detect/gate", ("gate_model", "take_levels"), self._macros)
        self._no_boxes = place.allocate((1,))

    def test(
        self, packed: Buffer, start: int, boxes: Buffer | None, share: float, model: Buffer, levels: Levels,
        references: Buffer,
    ) -> None:  # fmt: skip
        """Flag pixels, and write into ``levels`` what is predicted for those that cannot fire.

        ``boxes`` are box means; with them a pixel may fire where they have moved by ``share`` of a threshold.
        """
        layout = self._place.layout
        self._place.launch(
            self._test, (layout.height,), packed, np.int64(start), self._no_boxes if boxes is None else boxes,
            layout.pitch, layout.span, layout.width, share, model, references, levels.threshold_on,
            levels.threshold_off, levels.start, levels.end, self.flags, self.counts,
        )  # fmt: skip

    def take_levels(self, count: int, fit: Buffer, levels: Levels) -> None:
        """Let the first ``count`` listed pixels take the level that was regressed for them."""
        self._place.launch(
            self._take, (-(-count // CHUNK),), self.pixels, count, fit, self._place.layout.span, levels.end
        )
