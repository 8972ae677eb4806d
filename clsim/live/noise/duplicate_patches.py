"""Duplicate sampling where windows mix pixels: patches of the picture are rendered and detected twice.

Events in the margins of patches do not count, as their windows see other pixels than the picture's.
"""

from __future__ import annotations

import numpy as np

from clsim.detect.config import DetectorConfig
from clsim.detector import Detector
from clsim.frames import Frame, page_aligned
from clsim.frames.patches import Patches
from clsim.live.noise.duplicate_sampling import F32, DuplicateSampling, Fired, gathered
from clsim.opencl.device import Device

SHARE_IN_PATCHES = 0.125
"""Share of the pixels that is in patches, about."""


def patches_for(config: DetectorConfig, width: int, height: int) -> Patches | None:
    """Return patches whose margins are as wide as the window of ``config``; None where the picture is too small."""
    reach = config.side // 2 + config.box // 2
    return Patches.over(width, height, reach, SHARE_IN_PATCHES)


class DuplicatePatches(DuplicateSampling):
    """A noise meter of patches, of which all planes ``[2, C, rows, columns]`` are sampled."""

    def __init__(self, config: DetectorConfig, patches: Patches, names: tuple[str, ...], device: Device) -> None:
        """Prepare to find brightness as ``config`` does; ``device`` computes it."""
        super().__init__()
        rows, columns = patches.shape
        self._inside = patches.inside()
        self._detectors = [Detector(config, columns, rows, names, device=device) for _ in range(2)]
        self._frames = [Frame(page_aligned((len(names), rows, columns)), names) for _ in range(2)]
        self._fired: list[list[Fired]] = [[], []]

    def _step(self, seen: F32, time_us: int) -> None:
        for detector, frame, planes, fired in zip(self._detectors, self._frames, seen, self._fired, strict=True):
            frame.planes[...] = planes
            frame.time_us = time_us
            events = detector.step(frame)
            events = events[self._inside[events["y"], events["x"]]]
            pixels = events["y"].astype(np.int64) * frame.width + events["x"]
            fired.append((np.where(events["on"], pixels, ~pixels), events["t"].astype(np.int64)))

    def _waiting(self) -> int:
        return sum(len(stamps) for replica in self._fired for _, stamps in replica)

    def _taken(self) -> tuple[Fired, Fired]:
        first, second = map(gathered, self._fired)
        self._fired = [[], []]
        return first, second

    def _forget(self) -> None:
        for detector in self._detectors:
            detector.reset()
