"""Host side of gate.cl and box.cl: which pixels may fire, and need a new regression."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from clsim.detect.config import DetectorConfig
from clsim.opencl.workplace import Buffer, Workplace


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


def model_macros(config: DetectorConfig) -> dict[str, object]:
    """Return the macros of kernels that know what pixels remember of their last event."""
    if config.method != "esim-ad":
        return {}
    return {"MODEL": 1, "RADIANCE": 1} if config.gate == "radiance" else {"MODEL": 1}


class Gate:
    """Sorts a frame's pixels into those that may fire and those that cannot.

    Attributes:
        flags: ``[H, span]`` bytes, what becomes of each pixel (common.clh).
        pixels: ``[H·span]``, after `test` the pixels that may fire or are new, in raster order, as y·span + x.
        boxes: box means of the radiance gate.
    """

    def __init__(self, workplace: Workplace, config: DetectorConfig) -> None:
        """Build the kernels of the method and gate."""
        self._workplace = workplace
        self._config = config
        layout = workplace.layout
        self._radiance = config.method == "esim-ad" and config.gate == "radiance"
        test = "gate_model" if config.method == "esim-ad" else "gate_level"
        self._test, self._count, self._list = workplace.kernels(
            "gate", (test, "count_flags", "list_pixels"), model_macros(config)
        )
        self.flags = workplace.allocate((layout.height, layout.span), np.uint8)
        self.pixels = workplace.allocate((layout.height * layout.span,), np.int32)
        self._counts = workplace.allocate((layout.height, 4), np.int32)
        self._start = workplace.allocate((layout.height,), np.int32)
        self._host_counts = np.zeros((layout.height, 4), dtype=np.int32)
        self._host_start = np.zeros(layout.height, dtype=np.int32)
        planes = layout.features + 4
        self.boxes = workplace.allocate(layout.image_shape(planes) if self._radiance else (1,))
        if self._radiance:
            self._box_rows, self._box_columns = workplace.kernels("box", ("box_rows", "box_columns"))
            self._row_sums = workplace.allocate(layout.image_shape(planes + 1))

    def average(self, packed: Buffer, start: int) -> None:
        """Take the box means of the packed frame that starts at ``start``."""
        if not self._radiance:
            return
        layout, reach = self._workplace.layout, self._config.box // 2
        self._workplace.launch(
            self._box_rows, layout.vectors, packed, np.int64(start), layout.pitch, layout.span, reach, self._row_sums
        )
        self._workplace.launch(
            self._box_columns, layout.vectors, self._row_sums, layout.height, layout.span, reach, self.boxes
        )

    def test_levels(self, packed: Buffer, start: int, level: Level, state: Buffer) -> None:
        """Flag pixels whose known level reaches a threshold."""
        layout, config = self._workplace.layout, self._config
        self._workplace.launch(
            self._test, layout.vectors, packed, np.int64(start), level.values, np.int64(level.row),
            np.int64(level.start), layout.pitch, layout.span, layout.width, config.threshold_on, config.threshold_off,
            state, self.flags,
        )  # fmt: skip

    def test_models(self, packed: Buffer, start: int, state: Buffer) -> None:
        """Flag pixels whose model of the last event predicts that a threshold may be reached."""
        layout, config = self._workplace.layout, self._config
        self._workplace.launch(
            self._test, layout.vectors, packed, np.int64(start), self.boxes, layout.pitch, layout.span,
            layout.width, config.threshold_on, config.threshold_off, config.gate_scale, state, self.flags,
        )  # fmt: skip

    def collect(self) -> Counts:
        """Count the flags and list the pixels that may fire or are new."""
        layout = self._workplace.layout
        self._workplace.launch(self._count, (layout.height,), self.flags, layout.width, layout.span, self._counts)
        counts = self._workplace.read(self._counts, self._host_counts)
        listed = counts[:, 2] + counts[:, 3]
        np.cumsum(listed[:-1], out=self._host_start[1:])
        totals = [int(total) for total in counts.sum(axis=0)]
        result = Counts(totals[0], totals[1], totals[2], totals[3])
        if result.listed:
            self._workplace.write(self._start, self._host_start)
            self._workplace.launch(
                self._list, (layout.height,), self.flags, self._start, layout.width, layout.span, self.pixels
            )
        return result
