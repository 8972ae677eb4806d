"""Snapshots of objects' state, taken and restored: everything that can be reached from them and may change.

A class that is added to a detector, a sensor or a renderer is in it without a line of its own.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from clsim.opencl.workplace import Buffer


class Snapshot:
    """The state of some objects, and of all of clsim's own that they hold.

    Attributes of objects, contents of lists, dictionaries and deques, and the values of arrays on the host and on both
    devices are saved. All else (kernels, queues, threads) is shared and left as it is.
    """

    def __init__(self, roots: Iterable[object], queue: Any, shared: tuple[type, ...] = ()) -> None:
        """Take it.

        Args:
            roots: the objects.
            queue: the OpenCL queue of their buffers; None where there are none.
            shared: classes whose objects stay as they are, with all that only they hold.
        """
        self._queue, self._shared = queue, shared
        self._give_back: list[Callable[[], None]] = []
        seen: dict[int, object] = {}
        pending: list[Any] = list(roots)
        while pending:
            item = pending.pop()
            if id(item) not in seen:
                seen[id(item)] = item  # held, so that no other gets its number
                pending += self._save(item)

    def restore(self) -> None:
        """Give everything back."""
        for give_back in self._give_back:
            give_back()

    def _save(self, item: Any) -> list[Any]:
        """Save one object's state, and return what it holds."""
        if isinstance(item, self._shared):
            return []
        if isinstance(item, np.ndarray):
            return self._save_host(item)
        if isinstance(item, Buffer):
            return self._save_buffer(item)
        if isinstance(item, list | deque):
            return self._save_items(item)
        if isinstance(item, dict):
            return self._save_mapping(item)
        if isinstance(item, tuple):
            return list(item)
        if type(item).__module__.partition(".")[0] == "clsim":
            return self._save_attributes(item)
        if type(item).__module__.startswith("warp.") and hasattr(item, "assign") and hasattr(item, "ptr"):
            return self._save_device(item)
        return []

    def _save_host(self, array: np.ndarray[Any, Any]) -> list[Any]:
        if array.flags.writeable:
            values = array.copy()
            self._give_back.append(lambda: np.copyto(array, values))
        return [] if array.dtype != object else array.ravel().tolist()

    def _save_buffer(self, buffer: Buffer) -> list[Any]:
        import pyopencl as cl

        values = np.empty(buffer.memory.size, np.uint8)
        cl.enqueue_copy(self._queue, values, buffer.memory)

        def give_back() -> None:
            cl.enqueue_copy(self._queue, buffer.memory, values)

        self._give_back.append(give_back)
        return []

    def _save_device(self, array: Any) -> list[Any]:
        import warp as wp

        values = wp.clone(array)
        self._give_back.append(lambda: wp.copy(array, values))
        return []

    def _save_items(self, items: list[Any] | deque[Any]) -> list[Any]:
        values = list(items)

        def give_back() -> None:
            items.clear()
            items.extend(values)

        self._give_back.append(give_back)
        return values

    def _save_mapping(self, mapping: dict[Any, Any]) -> list[Any]:
        values = dict(mapping)

        def give_back() -> None:
            mapping.clear()
            mapping.update(values)

        self._give_back.append(give_back)
        return list(values.values())

    def _save_attributes(self, item: Any) -> list[Any]:
        slots = [name for kind in type(item).__mro__ for name in getattr(kind, "__slots__", ()) if hasattr(item, name)]
        values = {name: getattr(item, name) for name in slots if not name.startswith("__")}
        values |= getattr(item, "__dict__", {})

        def give_back() -> None:
            for name in set(getattr(item, "__dict__", ())) - set(values):
                del item.__dict__[name]
            for name, value in values.items():
                object.__setattr__(item, name, value)

        self._give_back.append(give_back)
        return list(values.values())


@dataclass(frozen=True)
class SimulatorState:
    """What a simulator remembers: `Simulator.snapshot` makes it, and `Simulator.restore` takes it.

    Attributes:
        views: what rendered for its cameras; a reset builds others.
        remembers: the state of each camera's stages.
        driving: what had been set.
        next: number of the next frame.
        time_us: time of the last frame [µs].
    """

    views: tuple[object, ...]
    remembers: tuple[Snapshot, ...]
    driving: tuple[object, ...]
    next: int
    time_us: int
