"""Levels of rendering effort, from the best to the cheapest: what is given up, in order, to keep up with the clock."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace

_OFTEN_HZ, _SELDOM_HZ = 60.0, 10.0
"""Frames a second above which frames are given up first, and above which they are once all else is."""
_LEAST_RAYS = 8
"""First-hit rays below which a pixel's corners are not shared: 4 cost as much as 32, and 1 loses half of the score."""
_LEAST_EVERY = 4

# Costs in first-hit rays per pixel, as measured on a CPU; only ratios count. Paths are rarely traced where light is
# cached, and what a pixel takes besides is look-up and the rays of its corners.
_PATH = {False: 4.0, True: 1.0}
"""A light path without the cache, and with it."""
_PIXEL = {False: 1.5, True: 6.0}
"""What a pixel costs besides its rays and paths."""
_RAY = 0.12
"""A first-hit ray of the largest number, for few are traced where nothing varies."""
_INTEREST_SHARE = 0.4
"""Share of the pixels that get all light paths."""

_TRACED_BETWEEN = 15.0
"""What follows motion between two frames, and as much again for each tenth of `LARGEST_TOLERANCE_US`: two-boxes."""
LARGEST_TOLERANCE_US = 1e4
"""Error of an event's time beyond which next to nothing is saved."""


@dataclass(frozen=True)
class Level:
    """How much is rendered, by the fields of `clsim.render.Effort`, how often, and how exactly events are timed."""

    probe_spp: int
    """Light paths of every pixel that is probed."""
    spp: int
    """Light paths of pixels of interest."""
    first_hit_rays: int
    """Largest number of primary rays per pixel."""
    every: int = 1
    """Frames in which all pixels are probed once."""
    tolerance_us: float | None = None
    """Error of an event's time that will do [µs], where pixels are traced between frames; no part of an effort."""
    one_in: int = 1
    """Frames of which one is rendered; no part of an effort."""
    cached: bool = False
    """Whether light is cached; no part of an effort."""

    @property
    def effort(self) -> dict[str, int]:
        """The fields of a `clsim.render.Effort`."""
        values = asdict(self)
        for name in ("tolerance_us", "one_in", "cached"):
            del values[name]
        return values

    @property
    def cost(self) -> float:
        """Cost of a frame's time relative to other levels: a model, for scenes differ."""
        paths = _INTEREST_SHARE * self.spp + (1 - _INTEREST_SHARE) * self.probe_spp / self.every
        between = 0.0
        if self.tolerance_us is not None:
            between = _TRACED_BETWEEN * (1 + max(0.0, math.log10(LARGEST_TOLERANCE_US / self.tolerance_us)))
        frame = _PIXEL[self.cached] + _PATH[self.cached] * paths + _RAY * self.first_hit_rays + between
        return frame / self.one_in

    def given_up_against(self, best: Level) -> str:
        """Return what this level lacks against a better one, in words; empty if nothing."""
        changes = []
        if best.tolerance_us != self.tolerance_us:
            changes.append(f"time tolerance {best.tolerance_us:g} -> {self.tolerance_us:g} us")
        if best.one_in != self.one_in:
            changes.append(f"{self.one_in - 1} of {self.one_in} frames")
        if best.spp != self.spp:
            changes.append(f"samples {best.spp} -> {self.spp}")
        if best.probe_spp != self.probe_spp:
            changes.append(f"probes {best.probe_spp} -> {self.probe_spp}")
        if best.first_hit_rays != self.first_hit_rays:
            changes.append(f"first-hit rays {best.first_hit_rays} -> {self.first_hit_rays}")
        if best.every != self.every:
            changes.append(f"pixels probed each {self.every} frames")
        return ", ".join(changes)


def ladder(best: Level, fps: float = 0.0) -> list[Level]:
    """Return the levels from ``best`` down, each cheaper than the one before.

    What loses least comes first (F1 in 1 ms and strict F1, where the camera, a box or a lamp moves): a greater
    tolerance of times; every other frame, while there are many a second; half the samples again and again; fewer
    primary rays; rarer probes; and fewer frames again. With ``fps`` 0 no frame is left out.

    Where first-hit rays change, so does a still picture, and references must be reset.
    """
    return list(_down(best, fps))


def _down(level: Level, fps: float) -> Iterator[Level]:
    yield level
    while level.tolerance_us is not None and level.tolerance_us < LARGEST_TOLERANCE_US:
        level = replace(level, tolerance_us=min(10 * level.tolerance_us, LARGEST_TOLERANCE_US))
        yield level
    while fps >= _fewer(level.one_in) * _OFTEN_HZ:
        level = replace(level, one_in=_fewer(level.one_in))
        yield level
    while level.spp > 1:
        spp = level.spp // 2
        level = replace(level, spp=spp, probe_spp=min(level.probe_spp, spp))
        yield level
    while level.first_hit_rays > _LEAST_RAYS:
        level = replace(level, first_hit_rays=max(level.first_hit_rays // 2, _LEAST_RAYS))
        yield level
    rarely = _LEAST_EVERY * (level.every if level.cached else 1)
    if level.every < rarely:
        level = replace(level, every=rarely)
        yield level
    while fps >= _fewer(level.one_in) * _SELDOM_HZ:
        level = replace(level, one_in=_fewer(level.one_in))
        yield level


def _fewer(one_in: int) -> int:
    """Return the next of 1, 2, 3, 4, 6, 9, 13 …"""
    return max(one_in + 1, one_in * 3 // 2)
