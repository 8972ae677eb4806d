"""Launches of kernels whose arguments are given by name, so that their order matters nowhere; and many at a time."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import warp as wp

from clsim.forks import check_process
from clsim.render.device.devices import usable_cores

_TILE_PATHS = 4096
"""Paths a launch on a CPU traces at most: some 10 ms, so that an interrupt is quick …"""
_TILES_EACH = 4
"""… and tiles for each thread at least, so that threads end together, …"""
_LEAST_TILE = 1024
"""… unless they would be smaller than this: a launch itself takes as long as some tens of pixels."""


def record(kernel: Any, dim: int, device: Any, **arguments: Any) -> Any:
    """Return a launch that can be repeated; ``set_param_by_name`` changes an argument.

    Raises:
        KeyError: an argument is missing.
        TypeError: the kernel has no argument of a name.
    """
    names = [argument.label for argument in kernel.adj.args]
    if unknown := arguments.keys() - set(names):
        raise TypeError(f"the kernel takes {', '.join(names)}, got {', '.join(sorted(unknown))}")
    return wp.launch(kernel, dim=dim, inputs=[arguments[name] for name in names], device=device, record_cmd=True)


def tile_size(paths: int, device: Any) -> int | None:
    """Return how many pixels with so many paths each a launch traces; None for all of them."""
    return max(1, _TILE_PATHS // paths) if device.is_cpu else None


class Threads:
    """Threads that launch tiles on a CPU, one of which is the caller's own; elsewhere that one alone.

    Attributes:
        count: how many there are.
        on_cpu: whether tiles are launched on a CPU.
        cancelled: whether `cancel` was called, or a launch failed.
    """

    def __init__(self, most: int | None, device: Any) -> None:
        """Start at most so many for a device of Warp; None starts one a core."""
        self.on_cpu: bool = device.is_cpu
        self.count = (most or usable_cores()) if self.on_cpu else 1
        self._pool = ThreadPoolExecutor(self.count - 1, "clsim-tile") if self.count > 1 else None
        self._cancelled = threading.Event()

    @property
    def cancelled(self) -> bool:
        """Whether nothing is launched any more."""
        return self._cancelled.is_set()

    def cancel(self) -> None:
        """Launch no other tile; safe from any thread."""
        self._cancelled.set()

    def each(self, work: Callable[[Any], None], of: list[Any]) -> None:
        """Do some work with each of a list, by as many threads, and wait until all is done.

        Raises:
            clsim.Error: this process was forked since the threads were started.
        """
        check_process()
        others = [self._pool.submit(work, one) for one in of[1:]] if self._pool else []
        try:
            work(of[0])
        except BaseException:
            self.cancel()
            raise
        finally:
            for other in others:
                other.result()

    def close(self) -> None:
        """End them; safe to call twice."""
        self.cancel()
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None


class Tiles:
    """A kernel whose threads are pixels, or other things with numbers, launched tile by tile.

    Attributes:
        size: pixels in a launch at most.
    """

    def __init__(
        self,
        threads: Threads,
        make_launch: Callable[[int], Any],
        offset: str,
        most: int,
        size: int | None,
        count: str | None = None,
        least: int = _LEAST_TILE,
    ) -> None:
        """Record a launch for each thread, since its arguments change.

        Args:
            threads: that launch tiles.
            make_launch: records a launch of a tile of that size.
            offset: the kernel's argument that tells a tile's first pixel.
            most: pixels there are at most.
            size: pixels in a launch at most; None takes all.
            count: the kernel's argument that tells how many pixels one of its threads takes, one after the other: all
                of a tile on a CPU, else 1. None where each has a thread of the kernel.
            least: pixels in a launch at least, if there are as many.
        """
        self.size = min(size or most, most)
        self._offset = offset
        self._count = count if threads.on_cpu else None
        self._threads = threads
        self._least = least
        most_tiles = -(-most // min(self.size, least))
        self._launches = [make_launch(self.size) for _ in range(min(threads.count, most_tiles))]
        self._places = {each.label: place for place, each in enumerate(self._launches[0].kernel.adj.args)}

    def run(self, end: int, changed: dict[str, Any], begin: int = 0) -> bool:
        """Launch over the pixels from ``begin`` to ``end`` with those arguments of the kernel that have changed.

        Return whether it was not cancelled.

        Raises:
            clsim.Error: this process was forked since the threads were started.
        """
        size = self.size
        if self._threads.count > 1:
            size = min(size, max(self._least, -(-(end - begin) // (_TILES_EACH * self._threads.count))))
        firsts = range(begin, end, size)
        self._set(changed)
        # next() of a range iterator is one step of the interpreter, so that threads may share it.
        left = iter(firsts)
        self._threads.each(lambda launch: self._drain(launch, left, size, end), self._launches[: max(1, len(firsts))])
        return not self._threads.cancelled

    def _set(self, changed: dict[str, Any]) -> None:
        """Let all launches have these arguments, which one of them converts for the kernel: that takes some µs each."""
        one, *others = self._launches
        for name, value in changed.items():
            place = self._places[name]
            one.set_param_at_index(place, value)
            for other in others:
                other.params[1 + place] = one.params[1 + place]

    def _drain(self, launch: Any, firsts: Any, most: int, end: int) -> None:
        offset, set_to = self._places[self._offset], 0
        for first in firsts:
            if self._threads.cancelled:
                return
            size = min(most, end - first)
            if size != set_to:
                # That of the last tile alone is another one.
                set_to = size
                if self._count is not None:
                    launch.set_param_at_index(self._places[self._count], size)
                launch.set_dim(size if self._count is None else 1)
            launch.set_param_at_index(offset, first)
            launch.launch()
