"""Detection in float64 numpy, which shares no code with the kernels: gates that need old windows, chosen bandwidths."""

from clsim.detect.float64.detector import Float64Detector

__all__ = ["Float64Detector"]
