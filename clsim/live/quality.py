"""Named points on the front of speed against accuracy: what ``--quality`` means."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Literal

from clsim.detect.config import DetectorConfig, EventRule, Gate, Method

Quality = Literal["draft", "balanced", "accurate", "exact", "published"]
Sampling = Literal["uniform", "adaptive", "cached", "in-turn"]
Sampler = Literal["pcg", "sobol"]
Noise = Literal["common", "independent"]


@dataclass(frozen=True)
class Point:
    """The settings of a run that trade speed for accuracy."""

    method: Method
    window: int | None
    """Side of the regression window [pixels]; None takes the method's own."""
    sampling: Sampling
    """Whether every pixel gets the same number of light paths, or as many as tell whether an event fires.

    ``cached`` keeps light on surfaces, where nothing but the camera moves; few paths will do where it is known.
    ``in-turn`` keeps paths where the camera stands still, and traces some of them again in each frame.
    """
    probe_spp: int
    """Light paths that every pixel gets, where sampling is adaptive or cached."""
    spp: int
    """Light paths per pixel and frame; where sampling is adaptive or cached, at most."""
    first_hit_rays: int
    """Largest number of rays per pixel that look for the first hit alone; 0 takes it from the light paths."""
    sampler: Sampler
    probe_every: int = 1
    """Frames in which the light of all pixels is found once, in turn; in each where it may decide about an event."""
    noise: Noise = "common"
    """Whether every frame has the same random numbers, so that noise cancels in differences, or its own."""
    gate: Gate = "radiance"
    """Where a method that has gates solves a regression."""
    event_rule: EventRule = "interpolated"

    def text(self) -> str:
        """Return the settings in a few words, for people."""
        paths = f"{self.probe_spp} to {self.spp}" if self.sampling != "uniform" else f"{self.spp}"
        unused = DetectorConfig(method=self.method, window=self.window, gate=self.gate).unused()
        side = "" if self.window is None or "window" in unused else f" {self.window}x{self.window}"
        parts = [self.method + side, f"{paths} spp"]
        if self.first_hit_rays:
            parts.append(f"{self.first_hit_rays} first-hit rays")
        if self.probe_every > 1:
            parts.insert(2, f"pixels probed each {self.probe_every} frames")
        parts.append(self.sampler)
        if self.sampling == "cached":
            parts.append("light kept on surfaces")
        if self.sampling == "in-turn":
            parts.append("paths traced again in turn")
        if self.noise != "common":
            parts.append(f"{self.noise} noise")
        if self.gate != "radiance" and "gate" not in unused:
            parts.append(f"gate {self.gate}")
        if self.event_rule != "interpolated":
            parts.append(f"rule {self.event_rule}")
        return ", ".join(parts)


PLAIN = Point(method="esim-ad", window=None, sampling="uniform", probe_spp=1, spp=8, first_hit_rays=0, sampler="pcg")
"""What runs where a method is named but no quality."""
QUALITIES: dict[Quality, Point] = {
    "draft": Point(
        method="irradiance",
        window=7,
        sampling="uniform",
        probe_spp=1,
        spp=1,
        first_hit_rays=8,
        sampler="sobol",
        probe_every=2,
        event_rule="linear-light",
    ),
    "balanced": Point(
        method="irradiance",
        window=7,
        sampling="adaptive",
        probe_spp=1,
        spp=8,
        first_hit_rays=12,
        sampler="sobol",
        probe_every=2,
        event_rule="linear-light",
    ),
    "accurate": Point(
        method="irradiance",
        window=7,
        sampling="adaptive",
        probe_spp=4,
        spp=64,
        first_hit_rays=64,
        sampler="sobol",
        event_rule="linear-light",
    ),
    "exact": Point(
        method="esim", window=None, sampling="uniform", probe_spp=1, spp=128, first_hit_rays=0, sampler="sobol"
    ),
    "published": Point(
        method="esim-ad",
        window=13,
        sampling="uniform",
        probe_spp=1,
        spp=32,
        first_hit_rays=0,
        sampler="pcg",
        noise="independent",
        gate="delta-r",
        event_rule="frame",
    ),
}
CACHED: dict[Quality, Point] = {
    "draft": Point(
        method="esim",
        window=None,
        sampling="cached",
        probe_spp=1,
        spp=2,
        first_hit_rays=8,
        sampler="sobol",
        probe_every=64,
        event_rule="linear-light",
    ),
    "balanced": Point(
        method="esim",
        window=None,
        sampling="cached",
        probe_spp=1,
        spp=4,
        first_hit_rays=32,
        sampler="sobol",
        probe_every=16,
        event_rule="linear-light",
    ),
    "accurate": Point(
        method="esim",
        window=None,
        sampling="cached",
        probe_spp=2,
        spp=32,
        first_hit_rays=256,
        sampler="sobol",
        probe_every=4,
        event_rule="linear-light",
    ),
}
"""What those qualities are where light stands still, for nothing but the camera moves: it is kept on surfaces."""
IN_TURN: dict[Quality, Point] = {
    "draft": Point(
        method="esim",
        window=None,
        sampling="in-turn",
        probe_spp=1,
        spp=8,
        first_hit_rays=16,
        sampler="sobol",
        probe_every=8,
        event_rule="linear-light",
    ),
    "balanced": Point(
        method="esim",
        window=None,
        sampling="in-turn",
        probe_spp=4,
        spp=32,
        first_hit_rays=32,
        sampler="sobol",
        probe_every=6,
        event_rule="linear-light",
    ),
    "accurate": Point(
        method="esim",
        window=None,
        sampling="in-turn",
        probe_spp=16,
        spp=64,
        first_hit_rays=128,
        sampler="sobol",
        probe_every=2,
        event_rule="linear-light",
    ),
}
"""What those qualities are where things move before a camera that stands still, and light straight from lamps is found
apart: paths are kept, and traced again in turn."""
LAMPS_MOVE: dict[Quality, dict[str, int]] = {
    "balanced": {"spp": 8, "probe_spp": 2, "probe_every": 8, "first_hit_rays": 12},
    "accurate": {"probe_spp": 8, "first_hit_rays": 64},
}
"""What those have instead that keep paths where lamps move too: all is lit anew in each frame, and no look is kept."""
ALL_BY_PATHS: dict[Quality, dict[str, int]] = {
    "balanced": {"probe_spp": 1, "probe_every": 8, "spp": 16, "first_hit_rays": 48},
    "accurate": {"probe_spp": 8, "probe_every": 1, "spp": 64},
}
"""What they have instead where paths find all light that is kept, also straight from lamps."""
APART: dict[Quality, dict[str, Any]] = {
    "draft": {"probe_every": 4, "window": 11},
    "balanced": {"probe_every": 4, "window": 11, "spp": 6},
    "accurate": {"probe_every": 4, "window": 11, "spp": 32},
}
"""What else holds of them where things move and light straight from lamps is found apart.

The rest changes slowly and has no sharp shadows: it is found seldom, and smoothed more.
"""
APART_SLOW: dict[Quality, dict[str, Any]] = {"draft": {"probe_every": 8}, "balanced": {"probe_every": 8}}
"""What holds of them then instead where things go slowly too."""
MOVES_BY_PATHS: dict[Quality, dict[str, Any]] = {
    "draft": {
        "sampling": "adaptive",
        "probe_spp": 1,
        "spp": 3,
        "probe_every": 8,
        "window": 11,
        "first_hit_rays": 12,
    },
}
"""What they have instead where things move and paths find all light: one path shows more noise the more frames there
are."""
SLOW_SHARE = 0.01
"""Share of the picture's width that things go in a frame, at most, where they go slowly."""
FOLLOWED: frozenset[Quality] = frozenset(("balanced", "accurate", "exact"))
"""Which of them trace pixels between frames too where things go fast, unless it is told when brightness is found."""
DEFAULT: Quality = "balanced"
"""What runs where neither a quality nor a method is named."""


def setting_names() -> tuple[str, ...]:
    """Return the names of the settings that a point has."""
    return tuple(field.name for field in fields(Point))


def with_given(point: Point, given: dict[str, Any]) -> Point:
    """Return the point with the settings that were ``given``, None meaning not.

    What was not given follows where it must: the window another method, and the probe fewer light paths.
    """
    chosen = {name: value for name, value in given.items() if value is not None}
    if chosen.get("method", point.method) != point.method:
        point = replace(point, window=None)
    result = replace(point, **chosen)
    if "spp" in chosen and "probe_spp" not in chosen:
        result = replace(result, probe_spp=min(result.probe_spp, result.spp))
    return result
