"""When brightness is found: at frames alone, or between them too, where events happen."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.frames import Fineness, PixelTracer, Reflected
from clsim.live.pacing.schedule import Schedule
from clsim.live.quality import Quality

if TYPE_CHECKING:
    from clsim.render import RenderOptions, View
    from clsim.scene import World

TOLERANCE_US = 100.0
"""Error of an event's time that will do where none is given [µs]."""
FINE_TOLERANCE_US: dict[Quality | None, float] = {"accurate": 30.0, "exact": 30.0}
"""Of these qualities [µs]."""
SMALLEST_TOLERANCE_US, LARGEST_TOLERANCE_US = 1.0, 1e6

_SMALLEST_WAY_PX, _LARGEST_WAY_PX = 1e-3, 1e3


def check_time(time: str) -> None:
    """Raise InputError unless it says when brightness is found: auto, fixed, adaptive or lambda=PIXELS."""
    if time not in ("auto", "fixed", "adaptive") and way_px(time) is None:
        raise InputError(
            f"`time` must be one of auto, fixed, adaptive and lambda=PIXELS with {_SMALLEST_WAY_PX:g} to "
            f"{_LARGEST_WAY_PX:g} pixels, got {time}"
        )


def way_px(time: str) -> float | None:
    """Return how far objects may move between pictures [pixels] where ``time`` is lambda=PIXELS; else None."""
    rule, _, number = time.partition("=")
    try:
        way = float(number) if rule == "lambda" else 0.0
    except ValueError:
        return None
    return way if _SMALLEST_WAY_PX <= way <= _LARGEST_WAY_PX else None


@dataclass(frozen=True)
class Retracing:
    """How pixels are traced between frames.

    Attributes:
        tolerance_us: error of an event's time that will do [µs].
        way_px: whole pictures are traced, so many that nothing goes farther between two [pixels]; None traces the
            pixels that fire.
        render: options of the renderer.
        views: what renders the frames; requests see as it does.
    """

    tolerance_us: float
    way_px: float | None
    render: RenderOptions
    views: list[View] = field(default_factory=list)

    def tracer(self, world: World, schedule: Schedule | None) -> PixelTracer | None:
        """Copy a world to the device and return what traces its pixels, at the times of a schedule.

        Without a schedule a run's times are those of the world. None where nothing moves: nothing happens then.
        """
        from clsim.render import SceneData
        from clsim.render.subframe.retracer import Retracer

        if world.moving_s() == 0:
            return None
        about = self.render.device, self.render.tree
        data = SceneData(world, *about, instants=True, light_cache=self.render.light_cache)
        tracer = Retracer(data, self.render, lambda: self.views[-1], by_frames=self.way_px is None)
        return Looping(tracer, schedule) if schedule is not None and schedule.loop else tracer


class Looping:
    """A tracer whose times are those of a run, in which the motion restarts again and again.

    Attributes:
        names: planes of what it traces.
        lit: whether their radiance is whole.
    """

    def __init__(self, tracer: Any, schedule: Schedule) -> None:
        """Shift the times of a run to those of the motion."""
        self._tracer, self._schedule = tracer, schedule
        self.names, self.lit = tracer.names, tracer.lit
        self._shift_s = 0.0

    def motion(self, start_s: float, end_s: float) -> npt.NDArray[np.float32] | None:
        """Return how far surfaces move on the image in a step; until the next one, its pass of the motion is traced."""
        schedule = self._schedule
        index = round(start_s * schedule.fps)
        shown = schedule.source_index(index)
        self._shift_s = (schedule.time_us(index) - schedule.time_us(shown)) * 1e-6
        ways: npt.NDArray[np.float32] | None = self._tracer.motion(start_s - self._shift_s, end_s - self._shift_s)
        return ways

    def trace(self, pixels: npt.NDArray[np.int32], times_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:
        """Return the planes ``[C, N]`` of pixels at times of the run [s]."""
        planes: npt.NDArray[np.float32] = self._tracer.trace(pixels, times_s - self._shift_s)
        return planes

    def bounds(self) -> npt.NDArray[np.bool_] | None:
        """Return where more is seen in the last frame than one flat surface, ``[H, W]``."""
        bounds: npt.NDArray[np.bool_] | None = self._tracer.bounds()
        return bounds

    def steady_shadows(self) -> npt.NDArray[np.bool_]:
        """Return which pixels are lit alike in the last two frames, ``[H·W]``."""
        steady: npt.NDArray[np.bool_] = self._tracer.steady_shadows()
        return steady

    def reflected(
        self, pixels: npt.NDArray[np.int64], light: npt.NDArray[np.float32], start_s: float, end_s: float,
        fineness: Fineness,
    ) -> Reflected:  # fmt: skip
        """Return what pixels reflect that show one flat surface, between two times of the run [s]."""
        start_s, end_s = start_s - self._shift_s, end_s - self._shift_s
        reflected: Reflected = self._tracer.reflected(pixels, light, start_s, end_s, fineness)
        return reflected

    def cancel(self) -> None:
        """Make a running ``trace``, and every later one, raise an error soon; safe from any thread."""
        self._tracer.cancel()

    def close(self) -> None:
        """Release what it holds; safe to call twice."""
        self._tracer.close()
