"""What a sweep varies: how frames are rendered, and what the detector does with them."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from typing import Any

from clsim.detect.config import DetectorConfig, EventRule, Gate, Method, Precision
from clsim.live import quality
from clsim.render import RenderOptions
from clsim.scene import Sensor

QUICK_POINTS = 12
_TURNED: tuple[tuple[str, Any], ...] = (
    ("gate", "delta-r"), ("window", 5), ("window", 9), ("stride", 2), ("history", 3), ("arithmetic", "float64")
)  # fmt: skip
"""What the full sweep turns on the base's detector, one at a time."""


@dataclass(frozen=True)
class Rendering:
    """How one sequence of frames is rendered.

    All detector settings of a uniform rendering see the same frames; an adaptive one goes by what its detector finds.
    """

    spp: int
    noise: quality.Noise
    seed: int
    sampler: quality.Sampler = "pcg"
    sampling: quality.Sampling = "uniform"
    probe_spp: int | None = None
    """Paths that every pixel gets, if sampling is adaptive, which then are doubled where a decision needs it.

    If it is cached, those of a pixel whose light is known."""
    first_hit_rays: int = 0
    probe_every: int = 1
    """Frames in which all pixels are probed once, in turn; if sampling is adaptive, some in each."""
    stored_paths: int = 64
    lamp_paths: int = 128
    follow_every: int = 6
    first_frame_error: float = 0.28

    def options(self, fps: float, frames: int) -> RenderOptions:
        """Return the renderer's options for so many frames."""
        settings = asdict(self)
        cached = settings.pop("sampling") == "cached"
        return RenderOptions(**settings, light_cache=cached, fps=fps, frames=frames)

    @property
    def label(self) -> str:
        """A short name, such as ``8 spp common sobol`` or ``1 to 8 spp common + 16 first hits``."""
        spp = f"{self.spp}" if self.probe_spp is None else f"{self.probe_spp} to {self.spp}"
        turns = "" if self.probe_every == 1 else f" each {self.probe_every} frames"
        parts = [f"{spp} spp{turns} {self.noise}"]
        if self.sampler != "pcg":
            parts.append(self.sampler)
        if self.sampling != "adaptive" and self.probe_spp is not None:
            parts.append("cached")
        if self.first_hit_rays:
            parts.append(f"+ {self.first_hit_rays} first hits")
        return " ".join(parts)


@dataclass(frozen=True)
class DetectorSetting:
    """What a detector does; None where the method has no use for a value."""

    method: Method
    gate: Gate | None = None
    event_rule: EventRule = "interpolated"
    window: int | None = None
    stride: int | None = None
    history: int | None = None
    arithmetic: Precision = "float32"
    """The detector's ``precision``, by a name that is not a score's."""

    def config(self, sensor: Sensor) -> DetectorConfig:
        """Return the detector's options for a sensor's thresholds and scale."""
        given = {name: value for name, value in asdict(self).items() if value is not None}
        precision = given.pop("arithmetic")
        return DetectorConfig(
            **given,
            precision=precision,
            threshold_on=sensor.threshold_on,
            threshold_off=sensor.threshold_off,
            scale=sensor.scale,
            floor=sensor.floor,
        )

    @property
    def label(self) -> str:
        """A short name, such as ``radiance K13 T3``."""
        parts: list[str] = [self.gate or self.method]
        if self.window is not None:
            parts.append(f"K{self.window}")
        if self.history is not None and self.history > 1:
            parts.append(f"T{self.history}")
        if self.stride is not None and self.stride > 1:
            parts.append(f"stride {self.stride}")
        if self.arithmetic != "float32":
            parts.append(self.arithmetic)
        if self.event_rule != "interpolated":
            parts.append(f"rule {self.event_rule}")
        return " ".join(parts)


ESIM = DetectorSetting("esim")
BASE = DetectorSetting("esim-ad", "radiance", window=13, stride=1, history=1)
"""What ``clsim live --method esim-ad`` does."""
IRRADIANCE = DetectorSetting("irradiance", window=7)
"""Irradiance smoothed rather than brightness regressed; it wants first-hit rays."""
ICIP_2023 = DetectorSetting("esim-ad", "delta-r", "frame", window=13, stride=1, history=1)
"""The method of Tsuji et al., ICIP 2023, with its closed-form gate; its noise is independent."""


@dataclass(frozen=True)
class Point:
    """One point of a sweep."""

    rendering: Rendering
    detector: DetectorSetting

    @property
    def label(self) -> str:
        """A short name, such as ``8 spp common, radiance K13``."""
        return f"{self.rendering.label}, {self.detector.label}"

    def options(self, fps: float, frames: int, sensor: Sensor) -> RenderOptions:
        """Return the renderer's options for so many frames, which an ideal sensor sees."""
        options = self.rendering.options(fps, frames)
        return replace(options, fires_at=self.detector.config(sensor).fires_at) if options.light_cache else options

    def as_dict(self) -> dict[str, Any]:
        """Return all values by name, as they stand in the results."""
        return asdict(self.rendering) | asdict(self.detector)


def named_points(seed: int) -> dict[str, Point]:
    """Return the points that ``clsim live --quality`` names."""
    return {name: _of_live(point, seed) for name, point in quality.QUALITIES.items()}


def _of_live(live: quality.Point, seed: int) -> Point:
    """Return the point of a sweep that does what a live run does."""
    settings = {field.name: getattr(live, field.name) for field in fields(Rendering) if field.name != "seed"}
    if live.sampling == "uniform":
        settings["probe_spp"] = None
    rendering = Rendering(seed=seed, **settings)
    config = DetectorConfig(live.method, window=live.window)
    values: dict[str, Any] = {
        "gate": live.gate,
        "window": config.side,
        "stride": config.stride,
        "history": config.history,
    }
    unused = config.without_use()
    used = {name: value for name, value in values.items() if name not in unused}
    return Point(rendering, DetectorSetting(live.method, event_rule=live.event_rule, **used))


def full_points(seeds: tuple[int, ...]) -> list[Point]:
    """Return all points of the sweep: plain renderings, first-hit rays with uniform and adaptive sampling, knobs."""
    return list(dict.fromkeys(point for seed in seeds for point in _points_of_a_seed(seed)))


def _points_of_a_seed(seed: int) -> list[Point]:
    renderings = [Rendering(spp, "common", seed) for spp in (2, 8, 32, 128)]
    renderings += [Rendering(spp, "independent", seed) for spp in (32, 512)]
    renderings += [Rendering(spp, "common", seed, "sobol") for spp in (8, 32)]
    looking = [
        Rendering(spp, "common", seed, "sobol", first_hit_rays=rays)
        for spp, rays in ((1, 4), (1, 16), (2, 16), (4, 16), (8, 16), (8, 64), (16, 64), (32, 64))
    ]
    looking += [
        Rendering(spp, "common", seed, "sobol", "adaptive", probe, rays)
        for probe, spp, rays in ((1, 4, 16), (1, 8, 64), (1, 16, 64), (2, 16, 64), (4, 64, 64))
    ]
    base = Rendering(8, "common", seed)
    turned = [replace(BASE, **{name: value}) for name, value in _TURNED]
    return [
        *(Point(rendering, detector) for rendering in renderings for detector in (ESIM, BASE)),
        *(Point(rendering, IRRADIANCE) for rendering in looking),
        *(Point(base, detector) for detector in (*turned, DetectorSetting("wlr-esim", window=13, stride=1, history=1))),
        *named_points(seed).values(),
    ]


def quick_points(seed: int) -> list[Point]:
    """Return a dozen points: the base with one knob turned at a time, and what it is to be compared with."""
    some, more = Rendering(8, "common", seed), Rendering(32, "common", seed)
    fresh = Rendering(32, "independent", seed)
    named = named_points(seed)
    return [
        Point(some, ESIM),
        Point(some, BASE),
        Point(some, DetectorSetting("esim-ad", "delta-r", window=13, stride=1, history=1)),
        Point(some, DetectorSetting("wlr-esim", window=13, stride=1, history=1)),
        Point(some, DetectorSetting("esim-ad", "radiance", window=7, stride=1, history=1)),
        Point(more, ESIM),
        Point(more, BASE),
        Point(fresh, ESIM),
        Point(fresh, ICIP_2023),
        *(named[name] for name in ("draft", "balanced", "accurate")),
    ]
