"""Host side of stored_paths.py: which paths are stored, and which are traced again."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.render.accel.geometry import mat34
from clsim.render.accel.upload_geometry import Places, into_boxes
from clsim.render.cache.light_cache import Followed
from clsim.render.cache.stored_paths import FOLLOWED_SUMS, StoredPath, build_storing
from clsim.render.cache.trails import PLACES
from clsim.render.device.arrays import write
from clsim.render.device.launch import Tiles, record

_TILE = 2048
"""Paths of a launch on a CPU; on a GPU all are one, for each launch takes as long as its slowest path."""
_MOST_BOXES = 16
"""Pairs of boxes that trails are compared with; of more instances several share one."""


class MovingScene(Protocol):
    """A scene on a device, as far as stored paths need it."""

    device: Any
    scene: Any

    @property
    def instance_count(self) -> int:
        """How many instances rays meet."""

    def places(self) -> Places:
        """Return where all that moves is now."""

    def lamp_poses(self) -> npt.NDArray[np.float64]:
        """Return where what moves and shines is now ``[n, 4, 4]``."""


class PathStore:
    """Stored paths, traced again where instances move or lights change.

    Attributes:
        paths: how many were traced again so far.
        stored: how many there are.
        frame: number of the last frame.
        followed: whether anything was ever traced again.
    """

    def __init__(
        self, kernel: Any, data: MovingScene, settings: Any, most: int, every: int, threads: int | None
    ) -> None:
        """Make room for none.

        Args:
            kernel: that of `make_replay`.
            data: what is rendered.
            settings: the `Settings` of the frames.
            most: paths that are stored in a cell.
            every: frames in which each path is traced once where lamps move.
            threads: that trace; None takes one a core.
        """
        self._data, self._settings, self._most, self._every = data, settings, most, every
        self._device = data.device
        self.paths = self.stored = self._taken = 0
        self.frame = 0
        self.followed = False
        self._count: Any = wp.zeros(1, dtype=wp.int32, device=self._device)
        self._boxes: Any = wp.zeros(2 * _MOST_BOXES, dtype=mat34, device=self._device)
        self._corners: Any = wp.zeros(2 + 4 * _MOST_BOXES, dtype=wp.vec3, device=self._device)
        self._moved: Any = wp.zeros(max(1, data.instance_count), dtype=wp.int32, device=self._device)
        self._all_again = False
        self._last, self._lamps, self._lamps_moved = data.places(), data.lamp_poses(), False
        self._paths: Any = wp.zeros(0, dtype=StoredPath, device=self._device)
        self._trails: Any = wp.zeros(0, dtype=wp.vec3, device=self._device)
        self._allocate(1)
        self._kernel = kernel
        count = "pixels"
        tile = _TILE if self._device.is_cpu else None
        self._tiles = Tiles(self._record, "first_pixel", 1 << 30, tile, threads, self._device.is_cpu, count)

    def forget(self) -> None:
        """Trace all again: lights have changed."""
        self._all_again = True

    def take_count(self) -> int:
        """Return how many paths were traced since this was asked last."""
        count, self._taken = self.paths - self._taken, self.paths
        return count

    def cancel(self) -> None:
        """Trace nothing more; safe from any thread."""
        self._tiles.cancel()

    def close(self) -> None:
        """End the threads; safe to call twice."""
        self._tiles.close()

    def table(self, rows: int) -> tuple[Any, Any]:
        """Return the sums of so many cells, and the `Followed` of each."""
        sums: Any = wp.zeros((rows, FOLLOWED_SUMS), dtype=wp.int64, device=self._device)
        followed: Any = wp.zeros(rows, dtype=Followed, device=self._device)
        return sums, followed

    def store(self, found: dict[str, Any], asked: Any, cells: Any, table: tuple[Any, Any]) -> None:
        """Store some paths of a frame, and trace them.

        Args:
            found: of the frame's paths: how many each pixel ``spent`` and ever ``traced``, their ``positions`` and
                ``normals``, what they ``met``, and the ``rows`` of their cells.
            asked: which cells tell how the light has changed.
            cells: all cells, to which they were added.
            table: what is known of them here.
        """
        first = self.stored
        count = self._choose(found, asked, cells, table)
        if count > len(self._paths):
            self._allocate(count + count // 4)
            count = self._choose(found, asked, cells, table)
        self.stored = count
        self._trace(first, every=1)
        self._add(first, table, joining=True)

    def _choose(self, found: dict[str, Any], asked: Any, cells: Any, table: tuple[Any, Any]) -> int:
        """Store paths as far as there is room, and return how many there would be with those."""
        self._count.fill_(self.stored)
        given = [found[name] for name in ("spent", "positions", "normals", "traced", "met", "rows")]
        wp.launch(
            build_storing().choose_paths, dim=len(found["traced"]), device=self._device,
            inputs=[*given, self._most, asked, cells, table[1], table[0], self._paths, self._count],
        )  # fmt: skip
        return int(self._count.numpy()[0])

    def follow(self, table: tuple[Any, Any]) -> None:
        """Trace again what may have changed since the last frame."""
        self.frame += 1
        places = self._data.places()
        boxes, corners, moved = _moved_boxes(self._last, places)
        lamps = self._data.lamp_poses()
        lights = not np.array_equal(lamps, self._lamps)
        # Where lamps come to rest, what paths found while these moved is not extrapolated any longer.
        self._all_again = self._all_again or (self._lamps_moved and not lights)
        self._lamps, self._lamps_moved = lamps, lights
        self._last = places
        if not (lights or self._all_again or moved.any()):
            return
        steady = lights and not self._all_again and self._every > 1
        every = 1 if self._all_again else self._every if lights else 0
        self._all_again = False
        if len(boxes):
            write(self._boxes, boxes)
            write(self._corners, corners.reshape(-1, 3))
        self._moved.assign(moved.astype(np.int32))
        self.followed = True
        self._trace(0, every, len(boxes))
        self._add(0, table, steady=steady)

    def move(self, rows: Any, before: tuple[Any, Any], table: tuple[Any, Any]) -> None:
        """Go along with cells that were moved to other ``rows``."""
        kernels = build_storing()
        if self.stored:
            wp.launch(kernels.move_rows, dim=self.stored, inputs=[self._paths, rows], device=self._device)
        wp.launch(kernels.move_followed, dim=len(rows), inputs=[rows, *before, *table], device=self._device)

    def _trace(self, first: int, every: int, boxes: int = 0) -> None:
        count = self.stored - first
        if count <= 0:
            return
        # Other views of the scene have stores of their own.
        geometry = self._data.scene.geometry
        geometry.trails = self._trails
        self._data.scene.geometry = geometry
        changed = {
            "scene": self._data.scene, "settings": self._settings, "first_path": first, "every": every,
            "turn": self.frame, "box_count": boxes, "boxes": self._boxes, "corners": self._corners,
            "moved": self._moved, "paths": self._paths,
            "out_found": self._found, "out_traced": self._traced,
        }  # fmt: skip
        self._tiles.run(count, changed)

    def _add(self, first: int, table: tuple[Any, Any], *, joining: bool = False, steady: bool = False) -> None:
        count = self.stored - first
        if count <= 0:
            return
        kernels, of = build_storing(), [first, joining, steady]
        wp.launch(
            kernels.add_paths, dim=count, inputs=[*of, self._paths, self._found, self._traced, *table],
            device=self._device,
        )  # fmt: skip
        wp.launch(
            kernels.average_paths, dim=count, inputs=[*of, self.frame, self._paths, self._traced, *table],
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

    def _record(self, tile: int) -> Any:
        return record(
            self._kernel, tile, self._device, scene=self._data.scene, settings=self._settings, first_pixel=0, pixels=1,
            first_path=0, every=0, turn=0, boxes=self._boxes, corners=self._corners, box_count=0, moved=self._moved,
            paths=self._paths, out_found=self._found, out_traced=self._traced,
        )  # fmt: skip


def _moved_boxes(
    before: Places, now: Places
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
    """Return boxes around where instances are and were that have moved, and which have.

    The first are the matrices that make each the cube from −1 to 1, ``[n, 3, 4]``. The second are corners along the
    axes: those around all boxes, and then around each, ``[1 + n, 2, 3]``; none where nothing has moved.
    """
    moved = np.zeros(now.count, bool)
    moved[now.moving] = np.any(before.poses != now.poses, axis=(1, 2)) | (now.deforming & (before.time != now.time))
    mine = moved[now.moving]
    if not mine.any():
        return np.zeros((0, 3, 4), np.float32), np.zeros((0, 2, 3), np.float32), moved
    if mine.sum() <= _MOST_BOXES:
        boxes = np.concatenate([before.into_boxes[mine], now.into_boxes[mine]])
        corners = np.concatenate([before.boxes[mine], now.boxes[mine]])
    else:
        first = np.arange(_MOST_BOXES) * mine.sum() // _MOST_BOXES
        pairs = np.concatenate([before.boxes[mine], now.boxes[mine]], axis=1)  # [n, 4, 3]
        lower = np.minimum.reduceat(pairs.min(axis=1), first)
        upper = np.maximum.reduceat(pairs.max(axis=1), first)
        boxes = into_boxes(np.broadcast_to(np.eye(4), (_MOST_BOXES, 4, 4)), lower, upper)
        corners = np.stack([lower, upper], axis=1)
    around = np.stack([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])
    return boxes.astype(np.float32), np.concatenate([around[None], corners]).astype(np.float32), moved
