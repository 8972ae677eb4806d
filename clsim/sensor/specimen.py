"""One camera of a kind: which of its pixels are hot is chance, and how bright a scene is to it is chosen."""

from __future__ import annotations

from dataclasses import dataclass, field

from clsim.opencl.workplace import Grid, Workplace
from clsim.sensor.ideal import IdealPixels, Thresholds
from clsim.sensor.pixel import RealPixels
from clsim.sensor.settings import SensorSettings
from clsim.sensor.stage import Context


@dataclass(frozen=True)
class Specimen:
    """A sensor of some kind.

    Attributes:
        settings: the kind.
        seed: of all its random numbers.
        lux: illuminance of the sensor where the level is 0 [lux].
    """

    settings: SensorSettings = field(default_factory=SensorSettings)
    seed: int = 0
    lux: float = 100.0

    def pixels(self, place: Workplace[Grid], thresholds: Thresholds) -> IdealPixels | RealPixels:
        """Return its pixels.

        Raises:
            InputError: the device lacks what they need.
        """
        if self.settings.is_ideal:
            return IdealPixels(place, thresholds)
        context = Context(thresholds.on, thresholds.off, self.lux, self.settings.front_end.follower_s)
        return RealPixels(place, self.settings, context, self.seed)
