"""The sensor: brightness over time becomes events."""

from clsim.sensor.ideal import Fired, IdealPixels, Thresholds
from clsim.sensor.pixel import RealPixels
from clsim.sensor.presets import load_sensor, preset_names
from clsim.sensor.settings import SensorSettings
from clsim.sensor.specimen import Specimen

__all__ = [
    "Fired",
    "IdealPixels",
    "RealPixels",
    "SensorSettings",
    "Specimen",
    "Thresholds",
    "load_sensor",
    "preset_names",
]
