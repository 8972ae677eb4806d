"""The detector of recorded frames, where every gate can be had."""

from __future__ import annotations

from clsim.detect.config import DetectorConfig
from clsim.detect.detector import Detector
from clsim.detect.device import Device
from clsim.detect.reference import ReferenceDetector


class KeptWindowsDetector(ReferenceDetector):
    """The gates that need each pixel's old window, `delta-r-exact` and `published`: float64 numpy, not OpenCL.

    They serve to check and to reproduce, not to stream: their memory is a window per pixel, and they are slow.
    """

    def close(self) -> None:
        """Release nothing; here so that all detectors end alike."""


def recorded_detector(
    config: DetectorConfig, width: int, height: int, names: tuple[str, ...], *, device: Device | None = None
) -> Detector | KeptWindowsDetector:
    """Return the detector of ``config`` for recorded frames; ``device`` is for those that run in OpenCL.

    Raises:
        InputError: a plane is missing, or there is no OpenCL device where one is needed.
    """
    if config.method == "esim-ad" and config.gate in ("delta-r-exact", "published"):
        return KeptWindowsDetector(config, width, height, names)
    return Detector(config, width, height, names, device=device)
