"""The float64 numpy reference of detector and sensor: the oracle of the kernels, which shares no code with them."""

from clsim.detect.reference.detector import ReferenceDetector

__all__ = ["ReferenceDetector"]
