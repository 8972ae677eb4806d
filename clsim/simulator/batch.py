"""Many copies of one scene that are driven side by side, as vector environments want them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, overload

from clsim.errors import InputError
from clsim.events import EventBatch
from clsim.scene import World
from clsim.simulator import Simulator
from clsim.values import read_value


class Batch(Sequence[Simulator]):
    """Simulators of copies of one scene, which share it on the device, its trees and its kernels.

    >>> with clsim.batch("two-boxes", 8, clock="caller", quality="draft") as simulators:  # doctest: +SKIP
    ...     for k, simulator in enumerate(simulators):
    ...         simulator.set_pose("red box", poses[k])
    ...     events = simulators.step(until_us=1_000)

    Each is a `Simulator` with poses, light, time and random numbers of its own, and fires what it would fire alone.
    Threads that drive them wait for each other.
    """

    def __init__(self, scene: str | Path | World, n: int, **options: Any) -> None:
        """Load the scene once.

        Args:
            scene: as for `Simulator`.
            n: how many copies.
            options: of each `Simulator`. The k-th copy has the seed ``seed`` + k.

        Raises:
            InputError: as `Simulator`, or there is no copy.
        """
        n = read_value("n", n, int)
        if n < 1:
            raise InputError(f"`n` must be at least 1, got {n}")
        first = Simulator(scene, **options)
        seed = read_value("seed", options.get("seed", 0), int)  # a number of numpy would wrap around
        self._simulators = [first, *(first.twin(seed + k) for k in range(1, n))]

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._simulators)

    @overload
    def __getitem__(self, which: int) -> Simulator: ...
    @overload
    def __getitem__(self, which: slice) -> list[Simulator]: ...
    def __getitem__(self, which: int | slice) -> Simulator | list[Simulator]:
        """Return one simulator, or a list of some."""
        return self._simulators[which]

    def __iter__(self) -> Iterator[Simulator]:
        """Go over the simulators."""
        return iter(self._simulators)

    def step(self, until_us: int) -> list[EventBatch]:
        """Let all step up to a time [µs], and return the events of each, as `Simulator.step` does."""
        return [simulator.step(until_us) for simulator in self._simulators]

    def reset(self) -> None:
        """Restart all."""
        for simulator in self._simulators:
            simulator.reset()

    def close(self) -> None:
        """Release the devices' memory; safe to call twice."""
        for simulator in self._simulators:
            simulator.close()

    def __enter__(self) -> Batch:
        """Return the batch, which is closed with the block."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self.close()
