"""Host side of stored_paths.py: which paths are stored, and which are traced again."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.render.accel.geometry import mat34
from clsim.render.accel.upload_geometry import Places
from clsim.render.cache.light_cache import Followed
from clsim.render.cache.stored_paths import FOLLOWED_SUMS, StoredPath, build_storing
from clsim.render.cache.trails import PLACES, Moved
from clsim.render.device.arrays import write
from clsim.render.device.launch import Threads, Tiles, record
from clsim.render.motion.standstill import have_moved

_TILE = 2048
"""Paths of a launch on a CPU; on a GPU all are one, for each launch takes as long as its slowest path."""


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
        unit: of the light that cells hold, see `Asked`.
    """

    def __init__(
        self,
        kernel: Any,
        data: MovingScene,
        settings: Any,
        most: int,
        every: int,
        threads: Threads,
        *,
        limited: bool,
    ) -> None:
        """Make room for none.

        Args:
            kernel: that of `make_replay`.
            data: what is rendered.
            settings: the `Settings` of the frames.
            most: paths that are stored in a cell.
            every: frames in which each path is traced once where lamps move.
            threads: that trace.
            limited: whether paths have limits (`path_limits.py`): where no lamp changes its brightness.
        """
        self._data, self._settings, self._most, self._every = data, settings, most, every
        self._limited = limited
        self._device = data.device
        self.paths = self.stored = self._taken = 0
        self.frame = 0
        self.followed = False
        self.unit = 1.0
        self._count: Any = wp.zeros(1, dtype=wp.int32, device=self._device)
        self._movement = Movement(data.places(), self._device)
        self._all_again = False
        self._lamps, self._lamps_moved = data.lamp_poses(), False
        self._paths: Any = wp.zeros(0, dtype=StoredPath, device=self._device)
        self._trails: Any = wp.zeros(0, dtype=wp.vec3, device=self._device)
        self._allocate(1)
        self._kernel = kernel
        kernels = build_storing()

        def tiles(record_tile: Any, size: int | None = None, count: str | None = None) -> Tiles:
            return Tiles(threads, record_tile, "first", 1 << 30, size, count)

        self._replay = tiles(self._record_replay, _TILE if threads.on_cpu else None, "count")
        self._add = tiles(lambda tile: self._record(kernels.add_paths, tile, unit=1.0, found=self._found))
        self._average = tiles(lambda tile: self._record(kernels.average_paths, tile, frame=0))

    @property
    def moved(self) -> Any:
        """What has moved since the frame before, a `Moved`."""
        return self._movement.moved

    @property
    def lamps_moved(self) -> bool:
        """Whether lamps have, too."""
        return self._lamps_moved

    def forget(self) -> None:
        """Trace all again: lights have changed."""
        self._all_again = True

    def take_count(self) -> int:
        """Return how many paths were traced since this was asked last."""
        count, self._taken = self.paths - self._taken, self.paths
        return count

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
        self._tell(first, table, joining=True)

    def _choose(self, found: dict[str, Any], asked: Any, cells: Any, table: tuple[Any, Any]) -> int:
        """Store paths as far as there is room, and return how many there would be with those."""
        self._count.fill_(self.stored)
        given = [found[name] for name in ("spent", "positions", "normals", "traced", "met", "rows")]
        wp.launch(
            build_storing().choose_paths, dim=len(found["traced"]), device=self._device,
            inputs=[*given, self._most, self._limited, asked, cells, table[1], table[0], self._paths, self._count],
        )  # fmt: skip
        return int(self._count.numpy()[0])

    def follow(self, table: tuple[Any, Any]) -> None:
        """Trace again what may have changed since the last frame."""
        self.frame += 1
        moved = self._movement.to(self._data.places())
        lamps = self._data.lamp_poses()
        lights = bool(have_moved(self._lamps, lamps).any())
        # Where lamps come to rest, what paths found while these moved is not extrapolated any longer.
        self._all_again = self._all_again or (self._lamps_moved and not lights)
        self._lamps, self._lamps_moved = lamps, lights
        if not (lights or self._all_again or moved):
            return
        steady = lights and not self._all_again and self._every > 1
        every = 1 if self._all_again else self._every if lights else 0
        self._all_again = False
        self.followed = True
        self._trace(0, every)
        self._tell(0, table, steady=steady)

    def move(self, rows: Any, before: tuple[Any, Any], table: tuple[Any, Any]) -> None:
        """Go along with cells that were moved to other ``rows``, and forget the paths of those that were forgotten."""
        kernels = build_storing()
        if self.stored:
            wp.launch(kernels.move_rows, dim=self.stored, inputs=[self._paths, rows], device=self._device)
            known = (self._paths.numpy()["rows"][: self.stored] >= 0).any(axis=1)
            if not known.all():
                self._keep(np.flatnonzero(known))
        wp.launch(kernels.move_followed, dim=len(rows), inputs=[rows, *before, *table], device=self._device)

    def _keep(self, which: npt.NDArray[np.int64]) -> None:
        """Forget all paths but these."""
        for each in (self._paths, self._trails):
            kept: Any = wp.array(each.numpy()[which], dtype=each.dtype, device=self._device)
            wp.copy(each, kept, count=kept.size)
        self.stored = len(which)

    def _trace(self, first: int, every: int) -> None:
        # Other views of the scene have stores of their own.
        geometry = self._data.scene.geometry
        geometry.trails = self._trails
        self._data.scene.geometry = geometry
        changed = {
            "scene": self._data.scene, "settings": self._settings, "every": every, "turn": self.frame,
            "moved": self._movement.moved, "of_moved": self._movement.instances, "paths": self._paths,
            "out_found": self._found, "out_traced": self._traced,
        }  # fmt: skip
        self._replay.run(self.stored, changed, first)

    def _tell(self, first: int, table: tuple[Any, Any], *, joining: bool = False, steady: bool = False) -> None:
        """Add what paths found to their cells, and tell these."""
        changed = {"joining": joining, "steady": steady, "paths": self._paths, "traced_again": self._traced}
        changed |= {"sums": table[0], "followed": table[1]}
        self._add.run(self.stored, changed | {"unit": self.unit, "found": self._found}, first)
        self._average.run(self.stored, changed | {"frame": self.frame}, first)
        self.paths += int(np.count_nonzero(self._traced.numpy()[first : self.stored]))

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

    def _record_replay(self, tile: int) -> Any:
        return record(
            self._kernel, tile, self._device, scene=self._data.scene, settings=self._settings, first=0, count=1,
            every=0, turn=0, moved=self._movement.moved, of_moved=self._movement.instances,
            paths=self._paths, out_found=self._found, out_traced=self._traced,
        )  # fmt: skip

    def _record(self, kernel: Any, tile: int, **more: Any) -> Any:
        sums, followed = self.table(1)
        return record(
            kernel, tile, self._device, first=0, joining=False, steady=False, paths=self._paths,
            traced_again=self._traced, sums=sums, followed=followed, **more,
        )  # fmt: skip


class Movement:
    """What has moved from one frame to the next.

    Attributes:
        moved: what trails are compared with.
        instances: of each instance whether it has moved, on the device.
    """

    def __init__(self, places: Places, device: Any) -> None:
        """Make room for as many as may ever move."""
        self._last = places
        boxes = 2 * max(1, len(places.moving))
        self._corners: list[Any] = [wp.zeros(boxes, dtype=wp.vec3, device=device) for _ in range(2)]
        self._tree: Any = wp.Bvh(*self._corners)
        self.instances: Any = wp.zeros(max(1, places.count), dtype=wp.int32, device=device)
        self.moved = Moved()
        self.moved.tree = self._tree.id
        self.moved.lowers, self.moved.uppers = self._corners
        self.moved.counts = self._counts = wp.zeros(boxes, dtype=wp.bool, device=device)
        self.moved.into_boxes = self._into_boxes = wp.zeros(boxes, dtype=mat34, device=device)

    def to(self, now: Places) -> bool:
        """Tell what has moved until ``now``, and return whether anything has."""
        before, self._last = self._last, now
        changed = have_moved(before.poses, now.poses) | (now.deforming & (before.time != now.time))
        of_instances = np.zeros(self.instances.shape[0], np.int32)
        of_instances[now.moving] = changed
        self.instances.assign(of_instances)
        self.moved.any = bool(changed.any())
        if changed.any():
            boxes = np.concatenate([before.boxes, now.boxes])  # [2n, 2, 3]
            twice = np.concatenate([changed, changed])
            self.moved.lower = boxes[twice, 0].min(axis=0)
            self.moved.upper = boxes[twice, 1].max(axis=0)
            for corners, values in zip(self._corners, np.moveaxis(boxes, 1, 0), strict=True):
                write(corners, values.astype(np.float32))
            self._tree.rebuild()
            write(self._counts, twice)
            write(self._into_boxes, np.concatenate([before.into_boxes, now.into_boxes]).astype(np.float32))
        return self.moved.any
