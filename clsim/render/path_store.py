"""Host side of stored_paths.py: which paths are stored, and which are traced again."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from clsim.render.kernel_input import Settings
from clsim.render.launch import Tiles, record
from clsim.render.light_cache import Followed
from clsim.render.scene_data import SceneData
from clsim.render.stored_paths import FOLLOWED_SUMS, Met, StoredPath, build_storing
from clsim.render.trails import PLACES

_TILE = 2048
"""Paths of a launch."""
_MOST_BOXES = 16
"""Pairs of boxes that trails are compared with; of more things several share one."""


class PathStore:
    """Paths that are traced again where things move or lights change.

    Attributes:
        paths: how many were traced again so far.
        stored: how many there are.
    """

    def __init__(self, kernel: Any, data: SceneData, settings: Any, most: int, threads: int | None) -> None:
        """Make room for none.

        Args:
            kernel: that of `make_replay`.
            data: what is rendered.
            settings: the `Settings` of the frames.
            most: paths that are stored in a cell.
            threads: that trace; None takes one a core.
        """
        self._data, self._settings, self._most = data, settings, most
        self._device = data.device
        self.paths = self.stored = self._taken = 0
        self._first_joined = 0
        self._count: Any = wp.zeros(1, dtype=wp.int32, device=self._device)
        self._boxes: Any = wp.zeros(4 * _MOST_BOXES, dtype=wp.vec3, device=self._device)
        self._moved: Any = wp.zeros(max(1, data.instance_count), dtype=wp.int32, device=self._device)
        self._all_again = False
        self._last = data.places()
        self._allocate(1)
        self._kernel = kernel
        count = "pixels"
        self._tiles = Tiles(self._record, "first_pixel", 1 << 30, _TILE, threads, self._device.is_cpu, count)

    def forget(self) -> None:
        """Trace all again: lights have changed."""
        self._all_again = True

    def take_count(self) -> int:
        """Return how many paths were traced since this was asked last."""
        count, self._taken = self.paths - self._taken, self.paths
        return count

    def close(self) -> None:
        """End the threads."""
        self._tiles.close()

    def table(self, rows: int) -> tuple[Any, Any, Any]:
        """Return sums, sums of references, and what those who look read, of so many cells."""
        sums: Any = wp.zeros((rows, FOLLOWED_SUMS), dtype=wp.int64, device=self._device)
        references: Any = wp.zeros((rows, 3), dtype=wp.int64, device=self._device)
        followed: Any = wp.zeros(rows, dtype=Followed, device=self._device)
        return sums, references, followed

    def store(self, found: dict[str, Any], table: tuple[Any, Any, Any], update: int, paths: int) -> None:
        """Store paths of a frame of which there are ``paths``, and trace them."""
        sums, _, followed = table
        if self.stored + paths > len(self._paths):
            self._allocate(max(2 * len(self._paths), self.stored + paths))
        kernels = build_storing()
        spent, traced = found["spent"], found["traced"]
        wp.launch(
            kernels.choose_paths, dim=len(traced), device=self._device,
            inputs=[spent, found["positions"], traced, found["met"], found["rows"], self._most, update, sums, followed,
                    self._paths, self._count],
        )  # fmt: skip
        self._first_joined, self.stored = self.stored, int(self._count.numpy()[0])
        self._trace(self._first_joined, True)
        self._add(self._first_joined, True, table)

    def follow(self, table: tuple[Any, Any, Any]) -> None:
        """Trace again what may have changed since the last frame."""
        places = self._data.places()
        boxes, moved = _moved_boxes(self._last, places)
        lights = self._all_again or (self._data.features.lamps_move and bool(len(moved) and places.time != self._last.time))
        self._last = places
        if not lights and not moved.any():
            return
        self._all_again = False
        if len(boxes):
            rows = boxes.reshape(-1, 3).astype(np.float32)
            wp.copy(self._boxes, wp.array(rows, dtype=wp.vec3, device=self._device), count=len(rows))
        self._moved.assign(moved.astype(np.int32))
        self._trace(0, lights, len(boxes))
        self._add(0, False, table)

    def move(self, rows: Any, before: tuple[Any, Any, Any], table: tuple[Any, Any, Any]) -> None:
        """Go along with cells that were moved to other ``rows``."""
        kernels = build_storing()
        if self.stored:
            wp.launch(kernels.move_rows, dim=self.stored, inputs=[self._paths, rows], device=self._device)
        wp.launch(kernels.move_followed, dim=len(rows), inputs=[rows, *before, *table], device=self._device)

    def _trace(self, first: int, all_again: bool, boxes: int = 0) -> None:
        count = self.stored - first
        if count <= 0:
            return
        changed = {
            "scene": self._data.scene, "settings": self._settings, "first_path": first, "all_again": all_again,
            "box_count": boxes, "boxes": self._boxes, "moved": self._moved, "paths": self._paths,
            "out_found": self._found, "out_traced": self._traced,
        }  # fmt: skip
        self._tiles.run(count, changed)

    def _add(self, first: int, joining: bool, table: tuple[Any, Any, Any]) -> None:
        count = self.stored - first
        if count <= 0:
            return
        sums, _, followed = table
        kernels = build_storing()
        inputs = [first, joining, self._first_joined, self._paths, self._found, self._traced, sums]
        wp.launch(kernels.add_paths, dim=count, inputs=inputs, device=self._device)
        wp.launch(
            kernels.average_paths, dim=count, inputs=[first, self._paths, self._traced, sums, followed],
            device=self._device,
        )  # fmt: skip
        self.paths += int(self._traced.numpy()[first : self.stored].sum())

    def _allocate(self, room: int) -> None:
        """Make room for so many paths, and keep those there are."""
        paths: Any = wp.zeros(room, dtype=StoredPath, device=self._device)
        trails: Any = wp.zeros((room, 2 * PLACES), dtype=wp.vec3, device=self._device)
        if self.stored:
            wp.copy(paths, self._paths, count=self.stored)
            wp.copy(trails, self._trails, count=self.stored * 2 * PLACES)
        self._paths, self._trails = paths, trails
        self._found: Any = wp.zeros(room, dtype=wp.vec3, device=self._device)
        self._traced: Any = wp.zeros(room, dtype=wp.int32, device=self._device)
        geometry = self._data.scene.geometry
        geometry.trails = trails
        self._data.scene.geometry = geometry

    def _record(self, tile: int) -> Any:
        return record(
            self._kernel, tile, self._device, scene=self._data.scene, settings=self._settings, first_pixel=0, pixels=1,
            first_path=0, all_again=False, boxes=self._boxes, box_count=0, moved=self._moved, paths=self._paths,
            out_found=self._found, out_traced=self._traced,
        )  # fmt: skip


def _moved_boxes(before: Any, now: Any) -> tuple[Any, Any]:
    """Return boxes ``[n, 2, 3]`` of where instances are and were that have moved, and which have."""
    moved = np.zeros(now.count, bool)
    moved[now.moving] = np.any(before.poses != now.poses, axis=(1, 2)) | (now.deforming & (before.time != now.time))
    mine = moved[now.moving]
    pairs = np.stack([before.boxes[mine], now.boxes[mine]], axis=1)  # [n, 2, 2, 3]
    if len(pairs) > _MOST_BOXES:
        first = np.arange(_MOST_BOXES) * len(pairs) // _MOST_BOXES
        lower = np.minimum.reduceat(pairs[:, :, 0], first)
        upper = np.maximum.reduceat(pairs[:, :, 1], first)
        pairs = np.stack([lower, upper], axis=2)
    return pairs.reshape(-1, 2, 3), moved
