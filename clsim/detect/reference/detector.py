"""The oracle of the OpenCL kernels: the detector in float64, with the one method that runs in OpenCL alone."""

from __future__ import annotations

from clsim.detect.float64.detector import Float64Detector
from clsim.detect.float64.observation import Observation
from clsim.detect.reference.irradiance import observe_irradiance
from clsim.frames import Frame


class ReferenceDetector(Float64Detector):
    """Frames in, events out, in float64, by all methods."""

    def _observe(self, frame: Frame) -> Observation:
        if self.config.method == "irradiance":
            return observe_irradiance(frame, self.config)
        return super()._observe(frame)
