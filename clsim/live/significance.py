"""How much of a run is noise, from the standard errors of the brightness that events come from.

What `confidence` demands is left out: two seeds say that fewer events are noise then, but no smaller share of them.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from clsim.detect.config import DetectorConfig
from clsim.events import EventBatch
from clsim.frames.frame import FloatArray

EVERY = 8
"""Events of one in so many frames are judged."""
_ERRORS = np.linspace(0.0, 6.0, 121)
_CHANCES = np.array([math.erfc(z / math.sqrt(2.0)) for z in _ERRORS])
"""Chance that normal noise is more than so many standard errors off, either way."""


class TellsError(Protocol):
    """A detector that may know how well it knows brightness."""

    def error(self) -> FloatArray | None:
        """Return the standard error of each pixel's brightness at the last frame, ``[H, W]``; None where unknown."""
        ...


class Significance:
    """Adds up how likely events are noise: the chance that noise alone moves brightness by the threshold.

    The error is that of one frame's brightness. Of a change it is more where noise is new in each frame, and less where
    both have the same: it is off by a half either way.
    """

    def __init__(self, config: DetectorConfig) -> None:
        """Prepare for events of thresholds as in ``config``."""
        self._config = config
        self._frames = self._events = 0
        self._noise = 0.0

    def watch(self, detector: TellsError, events: EventBatch) -> None:
        """Take notice of a frame's events, now and then."""
        self._frames += 1
        error = detector.error() if self._frames % EVERY == 0 and len(events) else None
        if error is None:
            return
        config = self._config
        size = np.where(events["on"], config.threshold_on, config.threshold_off)
        smallest = size / _ERRORS[-1]
        errors = size / np.fmax(error[events["y"], events["x"]], smallest)
        self._noise += float(np.interp(errors, _ERRORS, _CHANCES).sum())
        self._events += len(events)

    @property
    def noise_share(self) -> float | None:
        """Share of the events that is likely noise; None where none was judged."""
        return self._noise / self._events if self._events else None
