"""Host side of pixel.cl: pixels with the faults of a camera's."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events import Causes, EventBatch, empty_batch
from clsim.opencl.path import BrightnessPath
from clsim.opencl.workplace import Buffer, Grid, Workplace
from clsim.sensor.ideal import Fired
from clsim.sensor.readout import Bus, Pool, Requests
from clsim.sensor.settings import SensorSettings
from clsim.sensor.stage import Context

_CHUNK = 64
"""Pixels that one work-item runs."""
_ROOM = 64
"""Events of a work-item in one step for which there is always room."""
_SPARE = 4
"""How many times the room of a mean work-item all may have, so that few steps are run again."""
_KEPT = 1 << 20
"""Events for all of which room may be kept that other steps took; of large sensors it is what all may have."""
_KINDS = {"t": np.int64, "x": np.uint16, "y": np.uint16, "on": np.uint8, "cause": np.uint8}
REQUEST = np.dtype(list(_KINDS.items()))
"""An event that a pixel asks for, t in ns."""


class RealPixels:
    """Pixels by the stages of `SensorSettings`.

    Attributes:
        references: ``[H, span]``, level from which a detector may count each pixel's way to a threshold [natural-log
            units]; NaN before its first level.
    """

    def __init__(self, place: Workplace[Grid], settings: SensorSettings, context: Context, seed: int = 0) -> None:
        """Build the kernels; no pixel has a reference.

        Raises:
            InputError: the device has no float64.
        """
        if "cl_khr_fp64" not in place.device.context.devices[0].extensions:
            raise InputError(f"a sensor other than ideal needs an OpenCL device with float64, got {place.device.name}")
        self._place = place
        layout = place.layout
        self._pixels = layout.height * layout.span
        self._chunks = -(-self._pixels // _CHUNK)
        macros, constants, planes = _build_of(settings, context)
        self._macros = macros | {"CHUNK": _CHUNK}
        self._seed = np.uint64(seed)
        names = ("make_pixels", "run_pixels", "gather_events", "list_fired")
        make, self._run, self._gather, self._list = place.kernels("sensor/pixel", names, self._macros)
        self._with_knots: tuple[Any, Any, Buffer] | None = None
        self._constants = place.allocate((len(constants),), np.float64)
        place.write(self._constants, np.array(constants))
        self._own = place.allocate((planes["P"], self._pixels), np.float64)
        place.launch(make, (self._chunks,), self._constants, self._seed, self._pixels, layout.span, self._own)
        self._state, self._next_state = (place.allocate((planes["S"], self._pixels), np.float64) for _ in range(2))
        self.references = place.allocate(layout.image_shape)
        self._fired = place.allocate((self._pixels,), np.int32)
        self._crossings = place.allocate((self._pixels,), np.int32)
        self._counts = place.allocate((self._chunks, 4), np.int64)
        self._host_counts = np.zeros((self._chunks, 4), dtype=np.int64)
        self._starts = place.allocate((self._chunks,), np.int32)
        self._rooms = place.allocate((self._chunks + 1,), np.int64)
        self._make_room(np.full(self._chunks, _ROOM))
        self._gathered = self._allocate(0)
        self._bus = None if settings.readout.is_perfect else Bus(place, settings.readout)
        self._stamp_us = settings.readout.stamp_us
        self.restart()

    def forget(self) -> None:
        """Take all references and filters back: the next level of each pixel is its first, under which it rests."""
        state = np.zeros(self._state.shape)
        state[0] = np.nan
        self._place.write(self._state, state)
        self._place.write(self.references, np.full(self.references.shape, np.nan, dtype=self._place.real))

    def restart(self) -> None:
        """Forget, and let nothing be on its way off the chip: time may begin anew."""
        self.forget()
        self._asked, self._stamped = Pool(REQUEST), Pool(REQUEST)
        if self._bus is not None:
            self._bus.forget()

    def step(self, path: BrightnessPath) -> Fired:
        """Return the events of a time step, as far as their stamps lie in it, and move the pixels' state."""
        kernel, knots = self._for(path)
        counts = self._launch(kernel, path, knots)
        needed = np.maximum(counts[:, 0], _ROOM)
        if (needed > self._room).any():
            # The state that went in is still there: run again, with room.
            all_have = min(2 * int(needed.max()), int(_SPARE * needed.mean()))
            room = np.maximum(needed, all_have)
            # What is busy in turn would make each step run twice.
            kept = np.maximum(room, self._room)
            self._make_room(kept if kept.sum() <= max(_KEPT, _SPARE * _ROOM * self._chunks) else room)
            counts = self._launch(kernel, path, knots)
        self._state, self._next_state = self._next_state, self._state
        if path.count:
            size = (-(-path.count // _CHUNK),)
            self._place.launch(self._list, size, path.pixels, path.count, self._fired, self._crossings)
        events, causes, lost = self._read_out(self._collect(counts[:, 0]), path.end_us)
        many, capped = (int(value) for value in counts[:, 1:3].sum(axis=0))
        return Fired(events, self._crossings, many, int(counts[:, 3].max()), capped, causes, lost)

    def _for(self, path: BrightnessPath) -> tuple[Any, tuple[Buffer, ...]]:
        """Return the kernel for a path, and what it takes of its knots."""
        if path.knots is None:
            return self._run, ()
        place = self._place
        if self._with_knots is None:
            find, run = place.kernels("sensor/pixel", ("find_rows", "run_pixels"), self._macros | {"KNOTS": 1})
            self._with_knots = find, run, place.allocate((self._pixels,), np.int32)
        find, run, rows = self._with_knots
        place.fill(rows, -1)
        if path.count:
            place.launch(find, (-(-path.count // _CHUNK),), path.pixels, path.count, rows)
        return run, (rows, path.knots.offsets, path.knots.times_ns, path.knots.levels)

    def _launch(self, kernel: Any, path: BrightnessPath, knots: tuple[Buffer, ...]) -> npt.NDArray[np.int64]:
        place, layout = self._place, self._place.layout
        place.launch(
            kernel, (self._chunks,), self._constants, self._seed, self._own, self._state, self._pixels, layout.span,
            layout.width, np.int64(path.start_us * 1000), np.int64(path.end_us * 1000), path.start, path.end, *knots,
            self._rooms, self._next_state, self.references, self._fired, *self._events, self._counts,
        )  # fmt: skip
        return place.read(self._counts, self._host_counts)

    def _collect(self, counts: npt.NDArray[np.int64]) -> Requests:
        """Return what the work-items requested, in raster order of the pixels."""
        place = self._place
        starts = np.zeros(self._chunks, dtype=np.int32)
        np.cumsum(counts[:-1], out=starts[1:])
        total = int(counts.sum())
        if total > self._gathered[0].shape[0]:
            self._gathered = self._allocate(2 * total)
        requests = np.empty(total, dtype=REQUEST)
        if total:
            place.write(self._starts, starts)
            place.launch(
                self._gather, (self._chunks,), self._counts, self._starts, self._rooms, *self._events, *self._gathered
            )
            for name, buffer in zip(_KINDS, self._gathered, strict=True):
                requests[name] = place.read(buffer, np.empty(total, buffer.dtype))
        return requests

    def _read_out(self, requests: Requests, end_us: int) -> tuple[EventBatch, Causes, int]:
        """Return the events up to ``end_us``, what caused each, and how many were lost on the way."""
        lost = 0
        requests = self._asked.pass_on(requests, end_us * 1000)
        if self._bus is not None:
            order = np.lexsort((requests["x"], requests["y"], requests["t"]))
            requests, lost = self._bus.run(requests[order], end_us * 1000)
        stamp_ns = 1000 * self._stamp_us
        requests["t"] = -(-requests["t"] // stamp_ns) * stamp_ns
        events, causes = _sorted(self._stamped.pass_on(requests, end_us * 1000))
        return events, causes, lost

    def _make_room(self, room: npt.NDArray[np.int64]) -> None:
        """Let each work-item have room for so many events: one that is busy does not need all to have its room."""
        self._room = room
        ends = np.cumsum(room)
        self._place.write(self._rooms, np.concatenate([[0], ends]))
        self._events = self._allocate(int(ends[-1]))

    def _allocate(self, count: int) -> list[Buffer]:
        return [self._place.allocate((count,), kind) for kind in _KINDS.values()]


def _sorted(requests: Requests) -> tuple[EventBatch, Causes]:
    """Return events by t, then (y, x), and what caused each."""
    order = np.lexsort((requests["x"], requests["y"], requests["t"]))
    events = empty_batch(len(requests))
    events["t"] = requests["t"][order] // 1000
    for name in ("x", "y", "on"):
        events[name] = requests[name][order]
    return events, requests["cause"][order]


def _build_of(settings: SensorSettings, context: Context) -> tuple[dict[str, object], list[float], dict[str, int]]:
    """Return what kernels are built with, their constants, and how many planes there are of either kind."""
    on = ("", *settings.macros)
    macros: dict[str, object] = dict.fromkeys(settings.macros, 1)
    constants: list[float] = []
    planes = {"P": 0, "S": 0}
    for stage in settings.stages:
        for name, value in stage.constants(context).items():
            macros[f"C_{name}"] = len(constants)
            if isinstance(value, tuple):
                macros[f"N_{name}"] = len(value)
            constants += value if isinstance(value, tuple) else (value,)
        for kind, of_macro in (("P", stage.own), ("S", stage.state)):
            for macro, names in of_macro.items():
                for name in names if macro in on else ():
                    macros[f"{kind}_{name}"] = planes[kind]
                    planes[kind] += 1
    return macros, constants, planes
