"""The memory of the cache's cells: a table that grows, and forgets what has long been out of sight."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from clsim.render.cache.light_cache import Cell, Followed
from clsim.render.cache.light_grid import BLOCK
from clsim.render.cache.light_updates import SUMS, build_updates
from clsim.render.cache.path_store import PathStore

_CELLS_PER_PIXEL = 1
"""Of the first table, half of which may be in use: it doubles where that is too few, and a large one takes time."""
_LARGEST_TABLE = 1 << 22
"""Cells beyond which those that no path has reached lately are forgotten: 736 MiB, and 1,296 where something moves."""
_REMEMBERED = 128
"""Frames after which a cell that no path has reached may be forgotten: whether something came near its stored paths has
then cost about what it costs to trace and store them anew, …"""
_ROUNDS_REMEMBERED = 8
"""… unless each pixel had fewer turns to trace a path meanwhile: those few that reach a small cell take a while."""


class CellTable:
    """All cells, in rows that their keys are hashed to.

    Attributes:
        keys: of the cell in each row, 0 where there is none.
        sums: of what paths found there.
        cells: what is known by them.
        followed: the sums of the stored paths of each cell, and what these tell; of one row if no paths are stored.
        used: how many rows are in use, and how many cells found none.
    """

    def __init__(self, pixels: int, store: PathStore | None, device: Any) -> None:
        """Allocate a table without cells for frames of so many pixels.

        Args:
            pixels: of a frame.
            store: paths that follow the light, None where nothing but the camera moves.
            device: Warp's device.
        """
        self._store, self._device = store, device
        self.used: Any = wp.zeros(2, dtype=wp.int32, device=device)
        self.followed: tuple[Any, Any] = (
            wp.zeros((1, 1), dtype=wp.int64, device=device),
            wp.zeros(1, dtype=Followed, device=device),
        )
        self._allocate(1 << int(np.ceil(np.log2(max(_CELLS_PER_PIXEL * pixels, BLOCK)))))

    def forget(self) -> None:
        """Empty all cells."""
        for each in (self.keys, self.sums, self.cells, self.used):
            each.zero_()

    @property
    def is_full(self) -> bool:
        """Whether cells are hard to find, or were not found at all."""
        used, missed = self.used.numpy()
        return bool(used > self.cells.shape[0] // 2 or missed > 0)

    def make_room(self, update: int, every: int) -> bool:
        """Move the cells to a table twice as large, or forget those long unseen; return whether there is more room.

        Where paths are stored, those of cells out of sight take time in each frame. So cells are forgotten there as
        soon as half of them are out of sight, and else only where the table would be too large.

        Args:
            update: number of the last update.
            every: frames in which each pixel traces a path.
        """
        used = int(self.used.numpy()[0])
        rows = self.cells.shape[0]
        oldest = max(0, update - max(_REMEMBERED, _ROUNDS_REMEMBERED * every))
        larger: bool = 2 * rows <= _LARGEST_TABLE
        if larger and self._store is not None:
            cells = self.cells.numpy()
            larger = 2 * np.count_nonzero((cells["key"] != 0) & (cells["update"] >= oldest)) > used
        sums, source, followed = self.sums, self.cells, self.followed
        self._allocate(2 * rows if larger else rows)
        moved: Any = wp.zeros(rows, dtype=wp.int32, device=self._device)
        self.used.zero_()
        to = [self.keys, self.sums, self.cells, self.used]
        inputs = [sums, source, 0 if larger else oldest, *to, moved]
        wp.launch(build_updates().move_cells, dim=rows, inputs=inputs, device=self._device)
        if self._store is not None:
            self._store.move(moved, followed, self.followed)
        return larger or bool(self.used.numpy()[0] < used)

    def _allocate(self, rows: int) -> None:
        self.keys: Any = wp.zeros(rows, dtype=wp.int64, device=self._device)
        self.sums: Any = wp.zeros((rows, SUMS), dtype=wp.int64, device=self._device)
        self.cells: Any = wp.zeros(rows, dtype=Cell, device=self._device)
        if self._store is not None:
            self.followed = self._store.table(rows)
