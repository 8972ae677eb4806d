"""What a sweep varies: how frames are rendered, and what the detector does with them."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import product
from typing import Any, Literal

from clsim.detect.config import DetectorConfig, EventRule, Gate, Method, Precision
from clsim.scene import Sensor

Noise = Literal["common", "independent"]
Sampler = Literal["pcg", "sobol"]
Sampling = Literal["uniform", "adaptive"]

SPP = (1, 2, 4, 8, 16, 32, 64, 128, 512)
NOISES: tuple[Noise, ...] = ("common", "independent")
WINDOWS = (5, 9, 13)
STRIDES = (1, 2)
HISTORIES = (1, 3)
SOBOL_SPP = (4, 16, 64)
"""Sobol points are set against their like here alone: they multiply the rest."""
QUICK_POINTS = 12


@dataclass(frozen=True)
class Rendering:
    """How one sequence of frames is rendered.

    All detector settings of a uniform rendering see the same frames; an adaptive one goes by what its detector finds.
    """

    spp: int
    noise: Noise
    seed: int
    sampler: Sampler = "pcg"
    sampling: Sampling = "uniform"

    @property
    def label(self) -> str:
        """A short name, such as ``8 spp common sobol``."""
        parts = [f"{self.spp} spp {self.noise}"]
        if self.sampler != "pcg":
            parts.append(self.sampler)
        if self.sampling != "uniform":
            parts.append(self.sampling)
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
"""What ``clsim live`` does unless told otherwise."""
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

    def as_dict(self) -> dict[str, Any]:
        """Return all values by name, as they stand in the results."""
        return asdict(self.rendering) | asdict(self.detector)


def full_points(seeds: tuple[int, ...]) -> list[Point]:
    """Return all points of the sweep: renderings times detectors, and some renderings by Sobol points."""
    renderings = [Rendering(spp, noise, seed) for spp, noise, seed in product(SPP, NOISES, seeds)]
    even = [Rendering(spp, noise, seed, "sobol") for spp, noise, seed in product(SOBOL_SPP, NOISES, seeds)]
    points = [Point(rendering, detector) for rendering in renderings for detector in full_detectors()]
    return points + [Point(rendering, detector) for rendering in even for detector in (ESIM, BASE)]


def full_detectors() -> list[DetectorSetting]:
    """Return every method and gate with every window, stride and history, and a few of them otherwise.

    Double precision and the rule ``frame`` are set against their like at the base alone: they multiply the rest.
    """
    ways: tuple[tuple[Method, Gate | None], ...] = (
        ("wlr-esim", None),
        ("esim-ad", "delta-r"),
        ("esim-ad", "radiance"),
    )
    detectors = [
        DetectorSetting(method, gate, window=window, stride=stride, history=history)
        for (method, gate), window, stride, history in product(ways, WINDOWS, STRIDES, HISTORIES)
    ]
    doubles = [
        DetectorSetting(method, gate, window=13, stride=1, history=1, arithmetic="float64") for method, gate in ways
    ]
    return [ESIM, *detectors, *doubles, ICIP_2023]


def quick_points(seed: int) -> list[Point]:
    """Return a dozen points: the base with one knob turned at a time, and what it is to be compared with."""
    few, some, more = Rendering(2, "common", seed), Rendering(8, "common", seed), Rendering(32, "common", seed)
    fresh = Rendering(32, "independent", seed)
    return [
        Point(few, BASE),
        Point(some, ESIM),
        Point(some, BASE),
        Point(some, DetectorSetting("esim-ad", "delta-r", window=13, stride=1, history=1)),
        Point(some, DetectorSetting("wlr-esim", window=13, stride=1, history=1)),
        Point(some, DetectorSetting("esim-ad", "radiance", window=7, stride=1, history=1)),
        Point(some, DetectorSetting("esim-ad", "radiance", window=13, stride=2, history=1)),
        Point(more, ESIM),
        Point(more, BASE),
        Point(fresh, ESIM),
        Point(fresh, ICIP_2023),
        Point(fresh, DetectorSetting("esim-ad", "radiance", window=9, stride=1, history=3)),
    ]
