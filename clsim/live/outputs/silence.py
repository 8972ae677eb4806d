"""Why a run has no events, as far as a few of its frames tell."""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np

from clsim.frames import Frame
from clsim.frames.frame import FloatArray
from clsim.scene import World
from clsim.scene.load import is_lit

_COVERAGE = "Coverage"
_SAME = 1e-6
"""Log units by which brightness at the floor may be rounded."""
_BLIND = "the camera sees nothing but a background of one colour"


class Progress(Protocol):
    """The counters of a run that bear on its events."""

    frames: int
    events: int
    masked_pixels: int
    lost_events: int


class Silence:
    """Looks at frames 0, 1, 2, 4, 8 and so on, until there is an event."""

    def __init__(self, progress: Progress, about: dict[str, Any], world: World | None) -> None:
        """Prepare for a run with this ``progress``, of which a sidecar tells ``about``; ``world`` is its scene."""
        self._progress, self._about, self._world = progress, about, world
        self._frames = 0
        self._sees: bool | None = None
        self._first: FloatArray | None = None
        self._apart: FloatArray | None = None
        self._largest: float | None = None
        self._brightest: float | None = None

    def wants_frame(self) -> bool:
        """Want fewer and fewer frames, and none once there are events."""
        index, self._frames = self._frames, self._frames + 1
        return index & (index - 1) == 0 and not self._progress.events

    def show_frame(self, frame: Frame, level: FloatArray | None) -> None:
        """Note whether a frame shows a surface, and how far brightness ``[H, W]`` is from the first [log units]."""
        if _COVERAGE in frame.names and not self._sees:
            self._sees = float(frame.plane(_COVERAGE).max()) > 0
        if level is None:
            return
        brightest = float(np.fmax.reduce(level, axis=None))
        self._brightest = brightest if self._brightest is None else max(brightest, self._brightest)
        if self._first is None or self._apart is None:
            self._first, self._apart = level.copy(), np.empty_like(level)
            return
        np.subtract(level, self._first, out=self._apart)
        largest = abs(float(np.fmax(np.fmax.reduce(self._apart, axis=None), -np.fmin.reduce(self._apart, axis=None))))
        self._largest = largest if self._largest is None else max(largest, self._largest)

    @property
    def told(self) -> str | None:
        """A sentence for a run of several frames without events; None where other sentences explain it."""
        progress, world, largest = self._progress, self._world, self._largest
        if progress.events or progress.frames < 2 or progress.masked_pixels or progress.lost_events:
            return None
        if world is not None and not is_lit(world):
            return None
        if self._sees is False and world is not None and world.environment_map is None:
            options = self._about["options"]
            if options.get("camera_path") is not None and options.get("camera_axes", "opencv") == "opencv":
                return (
                    f"{_BLIND}; if the poses of its path look along -z, a file for `config` sets camera_axes to opengl"
                )
            return f"{_BLIND}; expected one that looks at the scene"
        threshold = min(self._about["thresholds"].values())
        if (world is not None and world.moving_s() == 0) or (largest is not None and not largest < threshold):
            return None
        if (
            self._brightest is not None
            and world is not None
            and self._brightest <= math.log(world.sensor.floor) + _SAME
        ):
            return (
                f"all that the camera sees is darker than the pixels' `floor` of {world.sensor.floor:g}; expected more "
                "light, or a larger `scale` of the sensor"
            )
        seen = "" if largest is None else f": the largest change that was seen is {largest:.2g}"
        return f"no pixel's brightness changed by the threshold of {threshold:g}{seen}; `threshold` sets it"
