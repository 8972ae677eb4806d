"""Levels of rendering effort, from the best to the cheapest: what is given up, in order, to keep up with the clock."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace

# Costs in first-hit rays per pixel, as measured on a CPU; only ratios count.
_PATH = 4.0
"""A light path: 2.2 in two-boxes, where many end in the sky, 6.4 in cornell, where none does."""
_DETECTION = 1.5
"""What a pixel costs besides its rays, ``irradiance`` being the method."""
_FIRST_LOOK = 4
"""First-hit rays that all pixels get …"""
_MORE_SHARE = 0.1
"""… and the share of the further ones that are traced, for few are where nothing varies."""
_INTEREST_SHARE = 0.4
"""Share of the pixels that get all light paths."""

_TRACED_BETWEEN = 15.0
"""What follows motion between two frames, and as much again for each tenth of `LARGEST_TOLERANCE_US`: two-boxes."""
LARGEST_TOLERANCE_US = 1e4
"""Error of an event's time beyond which next to nothing is saved."""

_BELOW_ONE_PATH: tuple[dict[str, int], ...] = (
    {"first_hit_rays": 4},
    {"every": 2},
    {"every": 4},
    {"first_hit_rays": 2},
    {"first_hit_rays": 1},
)
"""What is given up once there is one path a pixel: in this order the strict F1 falls least, as measured where the
camera moves (which needs first-hit rays) and where a lamp does (which needs probes)."""


@dataclass(frozen=True)
class Level:
    """How much is rendered, by the fields of `clsim.render.Effort`, and how exactly events are timed."""

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

    @property
    def effort(self) -> dict[str, int]:
        """The fields of a `clsim.render.Effort`."""
        values = asdict(self)
        del values["tolerance_us"]
        return values

    @property
    def cost(self) -> float:
        """Cost of a frame relative to other levels: a model, for scenes differ."""
        paths = _INTEREST_SHARE * self.spp + (1 - _INTEREST_SHARE) * self.probe_spp / self.every
        rays = min(self.first_hit_rays, _FIRST_LOOK) + _MORE_SHARE * max(0, self.first_hit_rays - _FIRST_LOOK)
        between = 0.0
        if self.tolerance_us is not None:
            between = _TRACED_BETWEEN * (1 + max(0.0, math.log10(LARGEST_TOLERANCE_US / self.tolerance_us)))
        return _DETECTION + _PATH * paths + rays + between

    def given_up_against(self, best: Level) -> str:
        """Return what this level lacks against a better one, in words; empty if nothing."""
        changes = []
        if best.tolerance_us != self.tolerance_us:
            changes.append(f"time tolerance {best.tolerance_us:g} -> {self.tolerance_us:g} us")
        if best.spp != self.spp:
            changes.append(f"samples {best.spp} -> {self.spp}")
        if best.probe_spp != self.probe_spp:
            changes.append(f"probes {best.probe_spp} -> {self.probe_spp}")
        if best.first_hit_rays != self.first_hit_rays:
            changes.append(f"first-hit rays {best.first_hit_rays} -> {self.first_hit_rays}")
        if best.every != self.every:
            changes.append(f"pixels probed each {self.every} frames")
        return ", ".join(changes)


def ladder(best: Level) -> list[Level]:
    """Return the levels from ``best`` down: a greater tolerance of times, then half the samples again and again, then
    alternately fewer primary rays and rarer probes.

    Where first-hit rays change, so does a still picture, and references must be reset.
    """
    levels = [best]
    while (tolerance_us := levels[-1].tolerance_us) is not None and tolerance_us < LARGEST_TOLERANCE_US:
        levels.append(replace(levels[-1], tolerance_us=min(10 * tolerance_us, LARGEST_TOLERANCE_US)))
    while levels[-1].spp > 1:
        spp = levels[-1].spp // 2
        levels.append(replace(levels[-1], spp=spp, probe_spp=min(levels[-1].probe_spp, spp)))
    for less in _BELOW_ONE_PATH:
        if less.get("first_hit_rays", 0) < best.first_hit_rays and less.get("every", best.every + 1) > best.every:
            levels.append(replace(levels[-1], **less))
    return levels
