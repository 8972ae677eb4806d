"""A noise meter by the standard errors of the brightness that events come from.

What `confidence` demands is left out: two seeds say that fewer events are noise then, but no smaller share of them.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
import numpy.typing as npt

from clsim.detect.config import DetectorConfig
from clsim.events import EventBatch
from clsim.frames.frame import FloatArray
from clsim.live.noise.duplicate_sampling import DUPLICATE_EVERY, IdealPixels

Whole = npt.NDArray[np.integer]
EVERY = 8
"""Events of one in so many frames are judged, of an ideal sensor."""
_ERRORS = np.linspace(0.0, 6.0, 121)
_CHANCES = np.array([math.erfc(z / math.sqrt(2.0)) for z in _ERRORS])
"""Chance that normal noise is more than so many standard errors off, either way."""


class TellsError(Protocol):
    """A detector that may know how well it knows brightness."""

    def level(self) -> FloatArray:
        """Return the log brightness of each pixel at the last frame, ``[H, W]``."""
        ...

    def error(self) -> FloatArray | None:
        """Return the standard error of that, ``[H, W]``; None where unknown."""
        ...


class Significance:
    """A noise meter that adds up how likely events are noise: the chance that noise alone moves brightness so far.

    The error is that of one frame's brightness. Of a change it is more where noise is new in each frame, and less where
    both have the same: it is off by a half either way.
    """

    def __init__(self, config: DetectorConfig, ideal: bool = True) -> None:
        """Prepare for events of thresholds as in ``config``.

        Where the sensor is not ``ideal``, those are judged that some ideal pixels would fire in its place.
        """
        self._config, self._ideal = config, ideal
        self._frames = self._events = 0
        self._noise = 0.0
        self._ideal_pixels: IdealPixels | None = None

    def watch(self, detector: TellsError, events: EventBatch) -> None:
        """Take notice of a frame, and of its events."""
        self._frames += 1
        if self._ideal:
            if self._frames % EVERY == 0 and len(events):
                self._judge(detector.error(), events["y"], events["x"], events["on"])
            return
        level = detector.level()
        seen = level.reshape(-1)[::DUPLICATE_EVERY].astype(np.float64)
        if self._ideal_pixels is None:
            self._ideal_pixels = IdealPixels(seen, seen.copy(), [])
        self._ideal_pixels.step(seen, self._config.threshold_on, self._config.threshold_off, 0, 1)
        fired, _ = self._ideal_pixels.take()
        if len(fired):
            y, x = np.divmod(np.where(fired < 0, ~fired, fired) * DUPLICATE_EVERY, level.shape[1])
            self._judge(detector.error(), y, x, fired >= 0)

    def restart(self) -> None:
        """Take the next frame for a first one, as the detector does where pixels are sampled otherwise."""
        self._ideal_pixels = None

    def _judge(self, error: FloatArray | None, y: Whole, x: Whole, on: npt.NDArray[np.bool_]) -> None:
        if error is None:
            return
        size = np.where(on, self._config.threshold_on, self._config.threshold_off)
        smallest = size / _ERRORS[-1]
        errors = size / np.fmax(error[y, x], smallest)
        self._noise += float(np.interp(errors, _ERRORS, _CHANCES).sum())
        self._events += len(errors)

    @property
    def noise_share(self) -> float | None:
        """Share of the events that is likely noise; None where none was judged."""
        return self._noise / self._events if self._events else None
