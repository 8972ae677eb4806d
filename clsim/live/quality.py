"""Named points on the front of speed against accuracy: what ``--quality`` means."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Literal

from clsim.detect.config import DetectorConfig, EventRule, Gate, Method

Quality = Literal["draft", "balanced", "accurate", "exact", "published"]
Sampling = Literal["uniform", "adaptive", "cached"]
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

    ``cached`` has a radiance cache on surfaces, and stored paths that follow the light where something moves.
    """
    probe_spp: int
    """Light paths that every pixel gets, where sampling is adaptive or cached."""
    spp: int
    """Light paths per pixel and frame; where sampling is adaptive or cached, at most."""
    first_hit_rays: int
    """Largest number of primary rays per pixel, which find the first hit alone; 0 takes it from the light paths."""
    sampler: Sampler
    probe_every: int = 1
    """Frames in which the light of each pixel is found once; in each frame where it may decide about an event."""
    noise: Noise = "common"
    """Whether every frame has the same random numbers, so that noise cancels in differences, or its own."""
    gate: Gate = "radiance"
    """Where a method that has gates solves a regression."""
    event_rule: EventRule = "interpolated"
    stored_paths: int = 64
    """Paths that follow the light in a cell of it; see `clsim.render.RenderOptions`."""
    lamp_paths: int = 128
    """How many these are where lamps move; see there too."""
    follow_every: int = 6
    """Frames in which each of them is traced again once; see there too."""
    first_frame_error: float = 0.28
    """How well light is known before the first event; see there too."""

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
            parts.append("cached light")
        if self.noise != "common":
            parts.append(f"{self.noise} noise")
        if self.gate != "radiance" and "gate" not in unused:
            parts.append(f"gate {self.gate}")
        if self.event_rule != "interpolated":
            parts.append(f"rule {self.event_rule}")
        return ", ".join(parts)


PLAIN = Point(method="esim-ad", window=None, sampling="uniform", probe_spp=1, spp=8, first_hit_rays=0, sampler="pcg")
"""What runs where a method is named but no quality."""


def _cached(
    spp: int,
    probe_spp: int,
    probe_every: int,
    first_hit_rays: int,
    stored_paths: int,
    lamp_paths: int,
    follow_every: int,
    first_frame_error: float,
) -> Point:
    return Point(
        method="esim",
        window=None,
        sampling="cached",
        probe_spp=probe_spp,
        spp=spp,
        first_hit_rays=first_hit_rays,
        sampler="sobol",
        probe_every=probe_every,
        event_rule="linear-light",
        stored_paths=stored_paths,
        lamp_paths=lamp_paths,
        follow_every=follow_every,
        first_frame_error=first_frame_error,
    )


def _adaptive(spp: int, probe_spp: int, probe_every: int, first_hit_rays: int) -> Point:
    return Point(
        method="irradiance",
        window=7,
        sampling="adaptive",
        probe_spp=probe_spp,
        spp=spp,
        first_hit_rays=first_hit_rays,
        sampler="sobol",
        probe_every=probe_every,
        event_rule="linear-light",
    )


QUALITIES: dict[Quality, Point] = {
    "draft": _cached(2, 1, 64, 8, stored_paths=32, lamp_paths=32, follow_every=8, first_frame_error=0.28),
    "balanced": _cached(8, 1, 16, 32, stored_paths=64, lamp_paths=128, follow_every=6, first_frame_error=0.2),
    "accurate": _cached(32, 2, 4, 256, stored_paths=256, lamp_paths=256, follow_every=1, first_frame_error=0.14),
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
UNCACHED: dict[Quality, Point] = {
    "draft": replace(_adaptive(1, 1, 2, 8), sampling="uniform"),
    "balanced": _adaptive(8, 1, 2, 12),
    "accurate": _adaptive(64, 4, 1, 64),
}
"""What those qualities are without the radiance cache, a baseline."""
FOLLOWED: frozenset[Quality] = frozenset(("balanced", "accurate", "exact"))
"""Which of them trace pixels between frames too where things go fast, unless it is told when brightness is found."""
DEFAULT: Quality = "balanced"
"""What runs where neither a quality nor a method is named."""


_FOLLOWING = "stored_paths", "lamp_paths", "follow_every", "first_frame_error"
"""Settings that go with a quality alone."""


def setting_names() -> tuple[str, ...]:
    """Return the names of the settings of a point that can be given."""
    return tuple(field.name for field in fields(Point) if field.name not in _FOLLOWING)


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
