"""The sensor: brightness over time becomes events."""

from clsim.sensor.ideal import Fired, IdealPixels, Thresholds

__all__ = ["Fired", "IdealPixels", "Thresholds"]
