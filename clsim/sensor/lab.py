"""A sensor under light that is told, pixel by pixel: how its behaviour is measured without a scene."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.opencl.device import Device, choose_device
from clsim.opencl.path import BrightnessPath
from clsim.opencl.workplace import Buffer, Grid, Workplace
from clsim.scene.world import Sensor as SceneSensor
from clsim.sensor.ideal import Fired, Thresholds
from clsim.sensor.settings import SensorSettings
from clsim.sensor.specimen import Specimen


class Lab:
    """An image of pixels, each of which sees what it is told."""

    def __init__(
        self,
        settings: SensorSettings,
        width: int,
        height: int = 1,
        *,
        seed: int = 0,
        lux: float = 100.0,
        device: Device | None = None,
    ) -> None:
        """Build the pixels; they have seen nothing yet.

        Args:
            settings: the sensor; where it names no thresholds, they are those of a scene that names none.
            width, height: of the image [pixels].
            seed: of the sensor's random numbers.
            lux: illuminance where the level is 0 [lux].
            device: what computes; None takes the best.
        """
        device = device or choose_device()
        self._grid = Grid(width, height, device.lanes, np.float64)
        self._place = Workplace(device, self._grid, device.queue())
        self.thresholds = thresholds_of(settings)
        self._pixels = Specimen(settings, seed, lux).pixels(self._place, self.thresholds)
        listed = np.arange(height)[:, None] * self._grid.span + np.arange(width)
        self._listed = self._place.allocate(listed.shape, np.int32)
        self._place.write(self._listed, listed.astype(np.int32))
        self._before, self._now = (self._place.allocate(self._grid.image_shape, fill=np.nan) for _ in range(2))
        self._time_us: int | None = None

    def to(self, time_us: int, levels: npt.ArrayLike) -> Fired:
        """Return what fires until ``time_us``, the level going to ``levels`` in a line; the first call fires nothing.

        Args:
            time_us: later than in the call before.
            levels: log of the illuminance over ``lux``: a number, or one for each pixel, ``[H, W]``.
        """
        self._before, self._now = self._now, self._before
        self._write(self._now, levels)
        start_us = time_us if self._time_us is None else self._time_us
        self._time_us = time_us
        count = self._grid.width * self._grid.height
        return self._pixels.step(BrightnessPath(start_us, time_us, self._before, self._now, self._listed, count))

    def _write(self, buffer: Buffer, levels: npt.ArrayLike) -> None:
        image: npt.NDArray[Any] = np.zeros(self._grid.image_shape)
        image[:, : self._grid.width] = levels
        self._place.write(buffer, image)


def thresholds_of(settings: SensorSettings) -> Thresholds:
    """Return the contrast thresholds of a sensor in a scene that names none."""
    scene, own = SceneSensor(), settings.threshold
    return Thresholds(
        scene.threshold_on if own.on is None else own.on, scene.threshold_off if own.off is None else own.off
    )


def without(settings: SensorSettings, *stages: str) -> SensorSettings:
    """Return the settings with some stages off."""
    return replace(settings, **{name: type(getattr(settings, name))() for name in stages})
