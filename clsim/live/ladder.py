"""Levels of rendering effort, from the best to the cheapest: what is given up, in order, to keep up with the clock."""

from __future__ import annotations

from dataclasses import dataclass, replace

# What things cost next to each other, in rays per pixel; only ratios count, and only roughly: see clsim.live.governor.
_PATH_RAYS = 6.0
"""Rays of a light path."""
_FIRST_HIT_SHARE = 0.3
"""Share of the first-hit rays that are traced, for few are where nothing varies."""
_INTEREST_SHARE = 0.3
"""Share of the pixels that get all light paths."""
_DETECTION_RAYS = 3.0
"""What a pixel costs besides its rays."""
_FEWEST_RAYS = 4
"""First-hit rays below which edges would jump from pixel to pixel."""
_RAREST = 8
"""Most frames between two probes of a pixel."""


@dataclass(frozen=True)
class Level:
    """How much is rendered; the fields are those of `clsim.render.Effort`."""

    probe_spp: int
    """Light paths of every pixel that is probed."""
    spp: int
    """Light paths of pixels of interest."""
    first_hit_rays: int
    """Largest number of rays per pixel that look for the first hit alone."""
    every: int = 1
    """Frames in which all pixels are probed once, in turn."""

    @property
    def cost(self) -> float:
        """Cost of a frame relative to other levels, in rays per pixel: a model with constants, not a measurement."""
        mean_spp = self.probe_spp / self.every + _INTEREST_SHARE * (self.spp - self.probe_spp)
        return _DETECTION_RAYS + _PATH_RAYS * mean_spp + _FIRST_HIT_SHARE * self.first_hit_rays

    def given_up_against(self, best: Level) -> str:
        """Return what this level lacks against a better one, in words; empty if nothing."""
        changes = []
        if best.spp != self.spp:
            changes.append(f"samples {best.spp} -> {self.spp}")
        if best.probe_spp != self.probe_spp:
            changes.append(f"probes {best.probe_spp} -> {self.probe_spp}")
        if best.first_hit_rays != self.first_hit_rays:
            changes.append(f"first-hit rays {best.first_hit_rays} -> {self.first_hit_rays}")
        if best.every != self.every:
            changes.append(f"every pixel probed each {self.every} frames")
        return ", ".join(changes)


def ladder(best: Level) -> list[Level]:
    """Return the levels from ``best`` down: halves the samples, then the first-hit rays, then probes fewer pixels."""
    levels = [best]

    def add(**changes: int) -> None:
        levels.append(replace(levels[-1], **changes))

    while levels[-1].spp > 1:
        spp = levels[-1].spp // 2
        add(spp=spp, probe_spp=min(levels[-1].probe_spp, spp))
    while levels[-1].first_hit_rays // 2 >= _FEWEST_RAYS:
        add(first_hit_rays=levels[-1].first_hit_rays // 2)
    while levels[-1].first_hit_rays and levels[-1].every < _RAREST:
        add(every=2 * levels[-1].every)
    return levels
