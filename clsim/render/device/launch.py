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
"""Paths a launch on a CPU traces: some 10 ms, so that an interrupt is quick and threads end together."""


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


class Tiles:
    """A kernel whose threads are pixels, launched tile by tile by several threads on a CPU.

    Attributes:
        size: pixels in a launch.
        cancelled: whether `cancel` was called, or a launch failed.
    """

    def __init__(
        self,
        make_launch: Callable[[int], Any],
        offset: str,
        pixels: int,
        size: int | None,
        threads: int | None,
        on_cpu: bool,
        count: str | None = None,
    ) -> None:
        """Record a launch for each thread, since its arguments change.

        Args:
            make_launch: records a launch of a tile of that size.
            offset: the kernel's argument that tells a tile's first pixel.
            pixels: how many there are at most.
            size: pixels in a launch; None takes all.
            threads: at most so many; None takes one a core.
            on_cpu: whether the device is a CPU; else there is one thread.
            count: the kernel's argument that tells how many pixels one of its threads takes, one after the other: all
                of a tile on a CPU, else 1. None where each has a thread of the kernel.
        """
        self.size = min(size or pixels, pixels)
        self._offset = offset
        self._count = count if on_cpu else None
        wanted = (threads or usable_cores()) if on_cpu else 1
        self._launches = [make_launch(self.size) for _ in range(min(wanted, -(-pixels // self.size)))]
        # The calling thread renders too.
        self._pool = ThreadPoolExecutor(len(self._launches) - 1, "clsim-tile") if len(self._launches) > 1 else None
        self._cancelled = threading.Event()

    @property
    def cancelled(self) -> bool:
        """Whether nothing is launched any more."""
        return self._cancelled.is_set()

    def cancel(self) -> None:
        """Launch no other tile; safe from any thread."""
        self._cancelled.set()

    def run(self, pixels: int, changed: dict[str, Any]) -> bool:
        """Launch over so many pixels with those arguments that have changed; return whether it was not cancelled.

        Raises:
            clsim.Error: this process was forked since the threads were started.
        """
        check_process()
        for launch in self._launches:
            for name, value in changed.items():
                launch.set_param_by_name(name, value)
        tiles = iter(range(0, pixels, self.size))
        # next() of a range iterator is one step of the interpreter, so that threads may share it.
        others = self._launches[1:]
        workers = [self._pool.submit(self._drain, each, tiles, pixels) for each in others] if self._pool else []
        try:
            self._drain(self._launches[0], tiles, pixels)
        except BaseException:
            self._cancelled.set()
            raise
        finally:
            for worker in workers:
                worker.result()
        return not self.cancelled

    def close(self) -> None:
        """End the threads; safe to call twice."""
        self.cancel()
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None
        self._launches.clear()

    def _drain(self, launch: Any, tiles: Any, pixels: int) -> None:
        labels = [argument.label for argument in launch.kernel.adj.args]
        offset, set_to = labels.index(self._offset), 0
        for first in tiles:
            if self.cancelled:
                return
            size = min(self.size, pixels - first)
            if size != set_to:
                # That of the last tile alone is another one.
                set_to = size
                if self._count is not None:
                    launch.set_param_by_name(self._count, size)
                launch.set_dim(size if self._count is None else 1)
            launch.set_param_at_index(offset, first)
            launch.launch()
