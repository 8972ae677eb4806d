"""The detector of recorded frames, where every gate and bandwidth can be had."""

from __future__ import annotations

import numpy as np

from clsim.detect.config import KEPT_WINDOW_GATES, REGRESSING, DetectorConfig
from clsim.detect.detector import Detector
from clsim.detect.reference import ReferenceDetector
from clsim.detect.stats import DetectorStats
from clsim.events import EventBatch
from clsim.frames import Frame
from clsim.frames.frame import FloatArray
from clsim.opencl.device import Device


class NumpyDetector:
    """What the kernels leave to float64 numpy: gates that need old windows, and bandwidths chosen per pixel.

    They serve to check and to reproduce, not to stream: a gate keeps a window per pixel, and all of it is slow.
    """

    def __init__(self, config: DetectorConfig, width: int, height: int, names: tuple[str, ...]) -> None:
        """Prepare for frames of ``width`` × ``height`` with the planes ``names``.

        Raises:
            InputError: a plane is missing.
        """
        self._reference = ReferenceDetector(config, width, height, names)

    def step(self, frame: Frame) -> EventBatch:
        """Process one frame and return its events, sorted by t, then (y, x)."""
        return self._reference.step(frame)

    def reset(self) -> None:
        """Forget all references: the next frame initialises again and fires nothing."""
        self._reference.reset()

    def level(self) -> FloatArray:
        """Return the brightness [natural-log units] of each pixel at the last frame, ``[H, W]``."""
        return self._reference.level.astype(np.float32)

    def close(self) -> None:
        """Release nothing; here so that all detectors end alike."""

    @property
    def stats(self) -> DetectorStats:
        """Counts since the start."""
        return self._reference.stats


def needs_numpy(config: DetectorConfig) -> bool:
    """Tell whether no kernel does what ``config`` asks for."""
    if config.method not in REGRESSING:
        return False
    return config.bandwidth != "fixed" or (config.method == "esim-ad" and config.gate in KEPT_WINDOW_GATES)


def recorded_detector(
    config: DetectorConfig, width: int, height: int, names: tuple[str, ...], *, device: Device | None = None
) -> Detector | NumpyDetector:
    """Return the detector of ``config`` for recorded frames; ``device`` is for those that run in OpenCL.

    Raises:
        InputError: a plane is missing, or there is no OpenCL device where one is needed.
    """
    if needs_numpy(config):
        return NumpyDetector(config, width, height, names)
    return Detector(config, width, height, names, device=device)
