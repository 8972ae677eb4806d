"""What others have, measured on the same world and scored against the same reference, as points beside the sweep."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from clsim.bench import chain, manabe
from clsim.bench.mitsuba_frames import require_mitsuba
from clsim.events import EventBatch
from clsim.render import RenderOptions
from clsim.scene import World

LABELS = {
    "chain": f"Mitsuba 3 at {chain.SPP} spp, then ICIP 2023 in numpy",
    "manabe": f"Manabe et al. 2024, {manabe.FIRST} to {manabe.CAP} spp independent",
}
_CHAIN_DETECTION_PATHS = 30
"""The published gate's pass over a pixel is taken for so many paths, where time left is estimated."""


@dataclass(frozen=True)
class Peer:
    """One of ``LABELS`` with one seed; all of them have noise of its own in each frame and the rule ``frame``."""

    name: str
    seed: int

    def key(self) -> tuple[Any, ...]:
        """Return what its figures depend on besides what all points share."""
        try:
            mitsuba = version("mitsuba") if self.name == "chain" else None
        except PackageNotFoundError:
            mitsuba = None
        return ("peer", self.name, self.seed, mitsuba)

    def as_dict(self) -> dict[str, Any]:
        """Return what identifies it, as it stands in the results."""
        return {"peer": self.name, "seed": self.seed, "event_rule": "frame"}

    @property
    def work(self) -> int:
        """Paths a pixel and frame, at most, with detection counted as paths, to estimate the time left."""
        return chain.SPP + _CHAIN_DETECTION_PATHS if self.name == "chain" else manabe.CAP

    def check(self, world: World, file: Path | None) -> None:
        """Raise InputError if it cannot be measured on this world, or what it needs is not installed."""
        if self.name == "chain":
            require_mitsuba(world, file)

    def measure(
        self, world: World, file: Path | None, options: RenderOptions, on_samples: Callable[[int], None]
    ) -> tuple[EventBatch, dict[str, Any]]:
        """Return its events and its costs; ``file`` is the world's own; ``on_samples`` is told the work done.

        Seed and length are those of ``options``.

        Raises:
            InputError: it cannot be measured on this world, or what it needs is not installed.
        """
        if self.name == "chain":
            options, config = replace(options, spp=chain.SPP), chain.chain_config(world.sensor)
            done = chain.run_chain(world, file, options, config, lambda: on_samples(self.work))
            return done.events, done.costs()
        run = manabe.run_manabe(world, options, on_samples)
        return run.events, {
            "paths": run.paths,
            "first_hit_rays_traced": 0,
            "render_cpu_s": run.render_cpu_s,
            "render_wall_s": run.render_wall_s,
            "detect_cpu_s": run.testing.cpu_s,
            "detect_wall_s": run.testing.wall_s,
            "undecided_share": run.undecided,
        }
