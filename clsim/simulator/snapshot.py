"""What objects remember, taken and given back: everything that can be reached from them and may change.

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
    devices are kept. All else (kernels, queues, threads) is shared and left as it is.
    """

    def __init__(self, roots: Iterable[object], queue: Any, apart: tuple[type, ...] = ()) -> None:
        """Take it.

        Args:
            roots: the objects.
            queue: the OpenCL queue of their buffers; None where there are none.
            apart: classes whose objects stay as they are, with all that only they hold.
        """
        self._queue, self._apart = queue, apart
        self._give_back: list[Callable[[], None]] = []
        seen: dict[int, object] = {}
        pending: list[Any] = list(roots)
        while pending:
            thing = pending.pop()
            if id(thing) not in seen:
                seen[id(thing)] = thing  # kept, so that no other gets its number
                pending += self._keep(thing)

    def restore(self) -> None:
        """Give everything back."""
        for give_back in self._give_back:
            give_back()

    def _keep(self, thing: Any) -> list[Any]:
        """Keep one object's state, and return what it holds."""
        if isinstance(thing, self._apart):
            return []
        if isinstance(thing, np.ndarray):
            return self._keep_host(thing)
        if isinstance(thing, Buffer):
            return self._keep_buffer(thing)
        if isinstance(thing, list | deque):
            return self._keep_items(thing)
        if isinstance(thing, dict):
            return self._keep_mapping(thing)
        if isinstance(thing, tuple):
            return list(thing)
        if type(thing).__module__.partition(".")[0] == "clsim":
            return self._keep_attributes(thing)
        if type(thing).__module__.startswith("warp.") and hasattr(thing, "assign") and hasattr(thing, "ptr"):
            return self._keep_device(thing)
        return []

    def _keep_host(self, array: np.ndarray[Any, Any]) -> list[Any]:
        if array.flags.writeable:
            values = array.copy()
            self._give_back.append(lambda: np.copyto(array, values))
        return [] if array.dtype != object else array.ravel().tolist()

    def _keep_buffer(self, buffer: Buffer) -> list[Any]:
        import pyopencl as cl

        values = np.empty(buffer.memory.size, np.uint8)
        cl.enqueue_copy(self._queue, values, buffer.memory)

        def give_back() -> None:
            cl.enqueue_copy(self._queue, buffer.memory, values)

        self._give_back.append(give_back)
        return []

    def _keep_device(self, array: Any) -> list[Any]:
        import warp as wp

        values = wp.clone(array)
        self._give_back.append(lambda: wp.copy(array, values))
        return []

    def _keep_items(self, items: list[Any] | deque[Any]) -> list[Any]:
        values = list(items)

        def give_back() -> None:
            items.clear()
            items.extend(values)

        self._give_back.append(give_back)
        return values

    def _keep_mapping(self, mapping: dict[Any, Any]) -> list[Any]:
        values = dict(mapping)

        def give_back() -> None:
            mapping.clear()
            mapping.update(values)

        self._give_back.append(give_back)
        return list(values.values())

    def _keep_attributes(self, thing: Any) -> list[Any]:
        slots = [
            name for kind in type(thing).__mro__ for name in getattr(kind, "__slots__", ()) if hasattr(thing, name)
        ]
        values = {name: getattr(thing, name) for name in slots if not name.startswith("__")}
        values |= getattr(thing, "__dict__", {})

        def give_back() -> None:
            for name in set(getattr(thing, "__dict__", ())) - set(values):
                del thing.__dict__[name]
            for name, value in values.items():
                object.__setattr__(thing, name, value)

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
