"""The sensor of a run, and what follows from it for detection."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from clsim.errors import InputError
from clsim.frames import Frame
from clsim.frames.frame import FloatArray
from clsim.scene import Sensor as WorldSensor
from clsim.scene.light.spectral import spectral_weights
from clsim.sensor.presets import load_sensor
from clsim.sensor.settings import SensorSettings
from clsim.sensor.specimen import Specimen
from clsim.values import read_fields

DENSE_METHOD = "wlr-esim"
"""The method for sensors that follow brightness between events, where esim-ad would be taken: it knows all levels."""

_LEAST_CONTRAST, _LEAST_HZ = 2 / 3, 30.0
"""With less than this a pixel misses much of what moves."""
_DRAW_S = 2e-8
"""CPU time of a slot of shot noise that seldom comes near a threshold [s], measured."""


def read_sensor(sensor: Any) -> Any:
    """Return what a preset's name or a file says of a sensor; anything else as it is."""
    return load_sensor(os.fspath(sensor)) if isinstance(sensor, str | os.PathLike) else sensor


def specimen_of(sensor: SensorSettings | None, seed: int, lux: float) -> Specimen | None:
    """Return a sensor of this kind, whose illuminance is ``lux`` where brightness is 0; None is the ideal one."""
    return None if sensor is None or sensor.is_ideal else Specimen(sensor, seed, lux)


def cost_of(sensor: SensorSettings | None, width: int, height: int) -> tuple[str, ...]:
    """Return a sentence on what shot noise of a sensor of this size costs, if it has any."""
    if sensor is None or sensor.noise.shot == 0:
        return ()
    seconds = width * height * 1e6 / sensor.noise.slot_us(sensor.front_end.follower_s) * _DRAW_S
    return (
        f"`sensor` {sensor.name} draws shot noise, which takes at least {seconds:.0f} s of CPU for each simulated "
        "second; noise at rates (on_hz, off_hz) takes none to speak of",
    )


class LightMeter:
    """Sees in the first frame whether there is light enough for a sensor.

    Attributes:
        told: what to tell the user, if there is not.
    """

    def __init__(self, sensor: SensorSettings, lux: float) -> None:
        """Prepare for a sensor whose illuminance is ``lux`` where brightness is 0."""
        self._sensor, self._lux, self._seen = sensor, lux, False
        self.told: str | None = None

    def wants_frame(self) -> bool:
        """Want the first frame alone."""
        return not self._seen

    def show_frame(self, frame: Frame, level: FloatArray | None) -> None:
        """Judge the brightness of a frame ``[H, W]`` [log units]; without it nothing is told."""
        self._seen = True
        if level is not None and np.isfinite(level).any():
            self.told = too_dark(self._sensor, self._lux * float(np.exp(np.nanmedian(level))))


def meter_for(sensor: SensorSettings | None, world: WorldSensor) -> LightMeter | None:
    """Return what watches the light of a run with a sensor; None where it does not hang on light."""
    if sensor is None or not sensor.reads_light:
        return None
    return LightMeter(sensor, world.lux_per_unit / world.scale)


def too_dark(sensor: SensorSettings, lux: float) -> str | None:
    """Return a sentence where so much light [lux] leaves a pixel little contrast, or makes it slow; else None."""
    from clsim.sensor.characteristics import bandwidth_hz

    front = sensor.front_end
    share = 1.0 if lux + front.dark_lux == 0 else lux / (lux + front.dark_lux)
    hertz = float(bandwidth_hz(front, np.array([lux]))[0])
    if share >= _LEAST_CONTRAST and hertz >= _LEAST_HZ:
        return None
    slow = "" if math.isinf(hertz) else f" and sees changes of up to {hertz:.3g} Hz"
    return (
        f"half of the picture is darker than {lux:.2g} lux, where {sensor.name} has {100 * share:.0f} % of a scene's "
        f"contrast{slow}, so events are missing and late; make lamps brighter, or lux_per_unit in a .toml scene larger"
    )


@dataclass(frozen=True)
class RecordedSensor:
    """The sensor that sees recorded frames; they have their own size."""

    sensor: SensorSettings | None = None
    """The camera: a preset such as davis346 (see docs/sensor.md), or a .toml file; the frames' size stays. [ideal]"""
    seed: int = 0
    """Seed of the sensor's random numbers."""
    lux_per_unit: float = 100.0
    """Illuminance of the sensor under a luminance of 1 [lux]."""

    def __post_init__(self) -> None:
        """Refuse values that cannot work; see InputError for how messages name fields."""
        object.__setattr__(self, "sensor", read_sensor(self.sensor))
        read_fields(self)
        if self.seed < 0:
            raise InputError(f"`seed` must not be negative, got {self.seed}")
        if self.lux_per_unit <= 0:
            raise InputError(f"`lux_per_unit` must be a positive number, got {self.lux_per_unit:g}")

    def specimen(self, scale: float) -> Specimen | None:
        """Return the sensor where brightness is of luminance times ``scale``."""
        return specimen_of(self.sensor, self.seed, self.lux_per_unit / scale)

    def detector(self, given: Mapping[str, Any], method: str) -> dict[str, Any]:
        """Return options of detection, by name: those ``given``, and what the sensor asks for beside them.

        ``method`` is the one that would be taken. One that predicts levels between events is second best for a sensor
        that follows them, or whose noise takes them for references.
        """
        if self.sensor is None:
            return dict(given)
        threshold = self.sensor.threshold
        asked: dict[str, Any] = {"threshold_on": threshold.on, "threshold_off": threshold.off}
        spectral = self.sensor.optics.spectral
        asked["luminance"] = None if spectral is None else spectral_weights(spectral)
        asked["mosaic"] = self.sensor.optics.mosaic
        if asked["mosaic"] is not None:
            asked["method"] = "esim"  # others mix neighbours
        elif method == "esim-ad" and (self.sensor.front_end.macros() or self.sensor.noise.macros()):
            asked["method"] = DENSE_METHOD
        return {name: value for name, value in asked.items() if value is not None} | dict(given)
