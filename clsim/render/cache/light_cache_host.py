"""Host side of cached.py and light_cache.py: what is added to the cells, and how many paths pixels get."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.render.cache.cached_light import Gathering
from clsim.render.cache.cell_table import CellTable
from clsim.render.cache.first_frame import paths_wanted, unit_of
from clsim.render.cache.light_cache import LEVELS, Asked, Cell, Followed
from clsim.render.cache.light_updates import build_updates
from clsim.render.cache.path_store import PathStore
from clsim.render.cache.stored_hits import StoredHits
from clsim.render.cache.stored_hits_host import StoredHitsHost
from clsim.render.cache.stored_paths import Met
from clsim.render.device.launch import Threads, Tiles, record
from clsim.render.motion.standstill import have_moved
from clsim.render.primary.effort import Effort, PrimarySetup, primary_rays_for
from clsim.render.primary.ray_numbers import PrimaryRays
from clsim.render.primary.refinement import NextEvent
from clsim.render.primary.shadow_rays import Shadow
from clsim.scene import Sensor

KNOWN = 43.0
"""Where fewer paths than these tell of the light, a pixel traces all its paths …"""
_KNOWN_IN_FINEST = 16.0
"""… and where fewer than these, or than tell of a pixel in the first frame, tell of it in the finest cells, if the
cache holds direct light: what comes into view is soon known too."""
_PASSES_OF_FIRST = 2
"""Times that the first frame is rendered, at least: nothing was known when it was rendered first."""
_CELL_PX = 2.0
"""Largest width of the finest cells [pixels]; each level of coarser ones is twice as wide."""
_FINEST_IF_SMOOTH = 2
"""See `Asked`: few paths will do there."""
_ENOUGH_FOR_FINE = 4
"""Paths of a pixel whose light is unknown, from which on the finest cells are asked and added to."""
_ENOUGH_STORED = 64
"""Least number of stored paths with which cells tell how light has changed as well as coarser ones; in a picture that
is wider than so many pixels it is its width, as the change is smooth and cells are smaller there."""
_NEVER = math.inf
"""A threshold that no number of paths reaches, so that all paths are traced."""


def nothing_shown(device: Any) -> dict[str, Any]:
    """Return what `LightCacheHost.shown` does, for a launch that is recorded before there is a frame."""
    empty: dict[str, Any] = {"steering": Gathering()}
    shadows = ("shadows_before", Shadow), ("shadows_after", Shadow), ("passed", wp.float32)
    for name, kind in (
        ("cells", Cell),
        ("followed", Followed),
        ("own", wp.vec3),
        ("own_before", wp.vec3),
        ("learnt", wp.float32),
        *shadows,
    ):
        empty[name] = wp.zeros(1, dtype=kind, device=device)
    empty["light_passed"] = empty["passed"]
    return empty


def next_event(fires_at: tuple[float, float] | None, sensor: Sensor) -> Any:
    """Return a `NextEvent` of pixels with these contrast thresholds, None where nobody knows them."""
    event: Any = NextEvent()
    event.on, event.off = fires_at or (0.0, 0.0)
    event.scale, event.floor = sensor.scale, sensor.floor
    return event


def _finest_of(effort: Effort) -> int:
    """Return the first level of cells that is asked: where few paths are traced, fine cells would know next to none."""
    return 0 if effort.spp >= _ENOUGH_FOR_FINE else LEVELS - 1


class LightCacheHost:
    """The radiance cache's memory and launches, and how many paths pixels trace: few where the light is known.

    Attributes:
        effort: what holds from the next frame on; may be set from any thread.
        first_hit_rays: primary rays traced so far.
        paths: paths traced so far.
        light_s: time that updating the cache and tracing stored paths have taken so far, without the frames.
    """

    def __init__(
        self,
        width: int,
        height: int,
        effort: Effort,
        primary_setup: PrimarySetup,
        pace_hz: float | None,
        event: Any,
        first_frame_error: float,
        duplicate_every: int,
        store: PathStore | None,
        hits: StoredHitsHost | None,
        threads: Threads,
        device: Any,
    ) -> None:
        """Allocate a table without cells.

        Args:
            width: of the frames [pixels].
            height: of the frames [pixels].
            effort: what is spent on a pixel: ``spp`` paths where the light is unknown, else ``probe_spp``.
            primary_setup: what primary rays see.
            pace_hz: see `RenderOptions.light_hz`.
            event: a `NextEvent`: what pixels fire at; thresholds are 0 where nobody knows.
            first_frame_error: see there too.
            duplicate_every: see there too.
            store: paths that follow the light, None where nothing but the camera moves.
            hits: what stores what pixels see while the camera stands; None where that is of no use.
            threads: that add to cells.
            device: Warp's device.
        """
        pixels = width * height
        duplicate_every = -(-pixels // duplicate_every) if duplicate_every else 1
        self._sampled_twice: Any = wp.zeros((2, duplicate_every), dtype=wp.float32, device=device)
        self._duplicate_learnt: Any = wp.zeros((3, duplicate_every), dtype=wp.float32, device=device)
        self.effort = effort
        self.first_hit_rays = self.paths = 0
        self.light_s = 0.0
        self._device, self._threads = device, threads
        self._store, self._hits = store, hits
        self._primary_setup = primary_setup
        self._enough_stored = float(max(width, _ENOUGH_STORED))
        self._pace_hz = pace_hz
        self._tick = 0
        self._learns = True
        self._frames = 0
        self._update = 0
        self._found_more = False
        self._finest = _finest_of(effort)
        self._passes, self._wanted = _PASSES_OF_FIRST, 0.0
        self._unit: float | None = None
        self._first_frame_error = first_frame_error
        self._table = CellTable(pixels, store, device)
        self._own: Any = wp.zeros(pixels, dtype=wp.vec3, device=device)
        self._traced: Any = wp.zeros(pixels, dtype=wp.int32, device=device)
        self._event, self._rays = event, effort.first_hit_rays
        self._fired: Any = wp.full(pixels if event.on > 0 else 1, math.nan, dtype=wp.float32, device=device)
        self._rays_of: Any = wp.zeros(pixels, dtype=wp.int32, device=device)
        self._pose: npt.NDArray[np.float64] | None = None
        self._learnt: Any = wp.zeros(pixels, dtype=wp.float32, device=device)
        self._own_before, self._learnt_before = self._own, self._learnt
        if pace_hz is not None:
            self._own_before, self._learnt_before = wp.zeros_like(self._own), wp.zeros_like(self._learnt)
        # Of the last two frames, the newer one last, and when these are.
        room = pixels if pace_hz is not None else 1
        self._shadows: list[Any] = [wp.zeros(room, dtype=Shadow, device=device) for _ in range(2)]
        self._times_us: list[int] = []
        self._spent: Any = wp.zeros((2, pixels), dtype=wp.int32, device=device)
        self._make_room(effort.spp)

    @property
    def arguments(self) -> dict[str, Any]:
        """Arguments of the kernel without the scene and the frame; what `prepare` returns changes with each frame."""
        return {
            "steering": Gathering(),
            "stored": StoredHits(),
            "cells": self._table.cells,
            "followed": self._table.followed[1],
            "own": self._own,
            "traced": self._traced,
            "learnt": self._learnt,
            "fired": self._fired,
            "rays": self._rays_of,
            "own_before": self._own_before,
            "duplicate_learnt": self._duplicate_learnt,
            "duplicate_every": 0,
            "out_duplicate": self._sampled_twice,
            **self._found,
            "out_spent": self._spent,
            "out_shadows": self._shadows[1],
        }

    def prepare(self, index: int, time_us: int, pose: npt.NDArray[np.float64]) -> tuple[dict[str, Any], int]:
        """Return the arguments of the kernel that change with a frame, and the full number of paths.

        The camera is at a ``pose`` ``[4, 4]`` then.

        What the paths of the last frame found is added to the cache. At a pace, a frame that is too soon traces none.
        """
        effort = self.effort  # asked once: another thread may set it meanwhile
        self._learns = self._is_time(time_us)
        if self._store is not None:
            begun_s = time.perf_counter()
            self._store.follow(self._table.followed)
            self.light_s += time.perf_counter() - begun_s
        # Where paths follow the light, what is learnt of it is known at the end of a frame, and shown from the next
        # frame on that learns.
        follows = self._store is not None and self._frames > 0
        asked = self._asked()
        asked.finest_before = self._finest
        if self._store is not None:
            asked.frame = self._store.frame
        if self._learns:
            self._learn()
            asked.finest = self._finest = _finest_of(effort)
            if effort.spp != self._found["out_lights"].shape[0]:
                self._make_room(effort.spp)
        if self._learns or follows:
            # The first frame is rendered more than once, and what it learns is no gain over a frame before.
            asked.last_update = self._update if self._frames >= self._passes else -1
            if self._pace_hz is not None:
                wp.copy(self._own_before, self._own)
                wp.copy(self._learnt_before, self._learnt)
        if effort.first_hit_rays != self._rays:
            # Pixels are seen otherwise, and detectors take such a frame for a first one.
            self._rays = effort.first_hit_rays
            self._fired.fill_(math.nan)
            self._rays_of.zero_()
        self._gathering: Any = Gathering()
        last = self._frames + 1 >= self._passes
        # Nobody sees the first frame before it is rendered for the last time: until then only its paths count.
        self._gathering.primary_rays = (
            primary_rays_for(effort.first_hit_rays, self._primary_setup, cached=True) if last else PrimaryRays()
        )
        self._gathering.probe, self._gathering.every = effort.probe_spp if self._learns else 0, effort.every
        self._gathering.phase = self._frames
        if last:
            self._gathering.event = self._event
        self._gathering.known = KNOWN
        self._gathering.in_finest = max(self._wanted, _KNOWN_IN_FINEST) if self._finest == 0 else 0.0
        self._gathering.lamps = self._primary_setup.lamps
        if self._frames < self._passes and self._finds_all:
            self._gathering.in_finest = _NEVER
        self._gathering.anchored = self._store is not None
        stands = self._pose is not None and not have_moved(self._pose, pose)
        self._gathering.stands = stands and not (self._store is not None and self._store.lamps_moved)
        self._pose = pose
        self._gathering.cell = wp.vec2(*(_CELL_PX * width for width in self._primary_setup.pixel))
        self._gathering.asked = asked
        self._gathering.earlier = (self._learns or follows) and self._pace_hz is not None
        if self._times_us[-1:] != [time_us]:
            self.rest(time_us)
            self._shadows.reverse()
        self._gathering.tells_shadows = self._pace_hz is not None
        changed = {
            "steering": self._gathering,
            "cells": self._table.cells,
            "followed": self._table.followed[1],
            "duplicate_every": 0,
            **self._found,
        }
        changed["out_shadows"] = self._shadows[1]
        changed["stored"] = StoredHits()
        if self._hits is not None and self._store is not None and last:
            changed["stored"] = self._hits.prepare(pose, time_us * 1e-6, effort, self._store)
        return changed, effort.spp if self._learns else 0

    @property
    def shown(self) -> dict[str, Any]:
        """The arguments of a kernel that sees chosen pixels in the light that the last frame shows (retraced.py)."""
        own, learnt = self._own, self._learnt
        if self._gathering.earlier:
            own, learnt = self._own_before, self._learnt_before
        light = {"cells": self._table.cells, "followed": self._table.followed[1]}
        light |= {"own": self._own, "own_before": own, "learnt": learnt}
        shadows = {"shadows_before": self._shadows[0], "shadows_after": self._shadows[1]}
        return {"steering": self._gathering} | light | shadows

    @property
    def sampled_twice(self) -> npt.NDArray[np.float32]:
        """Two estimates of the luminance of every n-th pixel in raster order; see `View.sampled_twice`."""
        return np.asarray(self._sampled_twice.numpy(), np.float32)

    @property
    def step_us(self) -> tuple[int, int] | None:
        """Times of the last two frames; None where there are none, or the motion was restarted between them."""
        start_us, end_us = self._times_us if len(self._times_us) == 2 else (0, 0)
        return (start_us, end_us) if start_us < end_us else None

    def steady_shadows(self) -> npt.NDArray[np.bool_]:
        """Return which pixels show one triangle that the same rays found lit in the last two frames, ``[H·W]``."""
        before, after = (shadows.numpy() for shadows in self._shadows)
        alike = [before[name] == after[name] for name in ("triangle", "rays", "lit_rays")]
        return np.asarray(np.all(alike, axis=0) & (after["triangle"] > 0), np.bool_)

    def forget(self) -> None:
        """Empty all cells: the light is another one; or, where paths follow the light, trace these again."""
        if self._hits is not None:
            self._hits.forget()
        if self._store is not None:
            self._store.forget()
            return
        self._found_more = False
        self._table.forget()
        for each in (self._own, self._learnt, self._duplicate_learnt):
            each.zero_()
        self._frames, self._unit = 0, None
        self._times_us.clear()

    def rest(self, time_us: int) -> None:
        """Take notice of the time of a frame, which needs not be rendered where nothing has moved."""
        self._times_us = [*self._times_us[-1:], time_us]

    def cancel(self) -> None:
        """Do nothing: nobody is waited for."""

    def finish(self) -> bool:
        """Count what the frame took; return whether it is to be rendered again.

        That is so for the first frame: nothing was known when it was rendered.
        """
        spent = self._spent.numpy()
        first_hit_rays, paths = spent.sum(axis=1, dtype=np.int64)
        self.first_hit_rays += int(first_hit_rays)
        if self._hits is not None:
            self._hits.finish(int(np.count_nonzero(spent[0])))
        if not self._learns:
            return False
        self.paths += int(paths)
        self._found_more = True
        self._frames += 1
        if self._unit is None:
            lights, positions = (self._found[f"out_{name}"].numpy() for name in ("lights", "positions"))
            self._unit = unit_of(lights, positions)
            if self._store is not None:
                # What stored paths find may be added before the next paths tell.
                self._unit = self._store.unit = self._unit or 1.0
        if self._frames == 1:
            self._wanted = paths_wanted(lights, positions, self._first_frame_error)
            self._passes = max(math.ceil(self._wanted / len(lights)), _PASSES_OF_FIRST)
        if self._store is not None:
            # As long as all is where these paths met it.
            self._learn()
        return self._frames < self._passes

    @property
    def _finds_all(self) -> bool:
        """Whether paths find all light in the cache, and so many of them that fine cells are looked up."""
        return self._finest == 0 and not self._primary_setup.lamps

    def _asked(self) -> Any:
        """Return which cells are asked for the light as it is known; for no update is there a gain."""
        asked: Any = Asked()
        asked.last_update, asked.finest, asked.finest_if_smooth = -1, self._finest, _FINEST_IF_SMOOTH
        asked.follows, asked.enough_stored = self._store is not None, self._enough_stored
        asked.unit = self._unit or 1.0
        return asked

    def _is_time(self, time_us: int) -> bool:
        """Whether a frame learns: at a pace, the first one from each of its times on."""
        if self._pace_hz is None:
            return True
        # Times of frames are rounded to whole µs.
        before, self._tick = self._tick, math.floor((time_us + 1) * self._pace_hz / 1e6)
        return self._frames < self._passes or self._tick != before

    def _learn(self) -> None:
        """Keep what the paths of the last frame found, unless that is done."""
        if not self._found_more:
            return
        begun_s = time.perf_counter()
        self._found_more = False
        self._update += 1
        self._open.set_param_by_name("update", self._update)
        self._open.set_param_by_name("asked", self._asked())
        self._open_cells()
        while self._table.is_full and self._table.make_room(self._update, self.effort.every):
            self._open_cells()
        asked = self._asked()
        # Until something has changed, nothing needs to be asked how it was before.
        asked.follows = self._store is not None and self._store.followed
        table = {"sums": self._table.sums, "cells": self._table.cells}
        self._add.run(len(self._own), table | {"asked": asked, "followed": self._table.followed[1]})
        self._average.run(len(self._own), table)
        if self._store is not None:
            found = {name: self._found[f"out_{name}"] for name in ("positions", "normals", "met")}
            found |= {"spent": self._spent, "traced": self._traced, "rows": self._rows}
            self._store.store(found, asked, self._table.cells, self._table.followed)
            self.paths += self._store.take_count()
        self.light_s += time.perf_counter() - begun_s

    def _make_room(self, paths: int) -> None:
        """Allocate what the paths of a frame find, and record the launches that keep it."""
        shape = (paths, len(self._own))
        positions: Any = wp.zeros(shape, dtype=wp.vec4, device=self._device)
        normals: Any = wp.zeros(shape, dtype=wp.vec4, device=self._device)
        lights: Any = wp.zeros(shape, dtype=wp.vec3, device=self._device)
        rows: Any = wp.zeros((paths, LEVELS, shape[1]), dtype=wp.int32, device=self._device)
        met: Any = wp.zeros(shape if self._store else (1, 1), dtype=Met, device=self._device)
        self._rows = rows
        self._found = {"out_positions": positions, "out_normals": normals, "out_lights": lights, "out_met": met}
        found = {"spent": self._spent, "positions": positions}
        table = {"sums": self._table.sums, "cells": self._table.cells}
        kernels = build_updates()
        self._open = record(
            kernels.open_cells, shape[1], self._device, **found, normals=normals, asked=self._asked(), update=0,
            keys=self._table.keys, cells=self._table.cells, out_rows=rows, out_used=self._table.used,
        )  # fmt: skip
        told = {"normals": normals, "lights": lights, "asked": self._asked(), "followed": self._table.followed[1]}
        self._add = self._tiles(kernels.add_to_cells, **found, **table, rows=rows, **told)
        self._average = self._tiles(kernels.average, **found, **table, rows=rows)

    def _tiles(self, kernel: Any, **arguments: Any) -> Tiles:
        """Return launches of a kernel over the pixels by all threads."""
        return Tiles(
            self._threads, lambda tile: record(kernel, tile, self._device, first=0, **arguments),
            "first", len(self._own), None,
        )  # fmt: skip

    def _open_cells(self) -> None:
        self._open.set_param_by_name("keys", self._table.keys)
        self._open.set_param_by_name("cells", self._table.cells)
        self._open.launch()
