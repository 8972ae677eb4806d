"""A record of the pixels that were traced between two frames."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.frames import Fineness, PixelTracer, Reflected
from clsim.frames.frame import FloatArray


@dataclass(frozen=True)
class Requests:
    """Pixels that were traced at times of their own, in the order in which they were.

    Attributes:
        x, y: uint16, ``[N]``.
        time_s: float64, ``[N]`` [s].
        planes: float32, ``[C, N]``, what was found.
        names: of the planes, ``[C]``.
    """

    x: npt.NDArray[np.uint16]
    y: npt.NDArray[np.uint16]
    time_s: npt.NDArray[np.float64]
    planes: FloatArray
    names: npt.NDArray[np.str_]

    def as_dict(self) -> dict[str, Any]:
        """Return the arrays by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


_NONE = np.zeros(0, np.uint16)
NO_REQUESTS = Requests(_NONE, _NONE, np.zeros(0), np.zeros((0, 0), np.float32), np.zeros(0, np.str_))


class NotingTracer:
    """A tracer that remembers what it traced.

    Attributes:
        names: planes of what it traces.
        lit: whether their radiance is whole.
    """

    def __init__(self, tracer: PixelTracer, width: int) -> None:
        """Note what ``tracer`` is asked for, in pictures so many pixels wide."""
        self._tracer, self._width = tracer, width
        self.names, self.lit = tracer.names, tracer.lit
        self._noted: list[tuple[npt.NDArray[np.int32], npt.NDArray[np.float64], FloatArray]] = []

    def trace(self, pixels: npt.NDArray[np.int32], times_s: npt.NDArray[np.float64]) -> FloatArray:
        """Return the planes ``[C, N]`` of pixels at times [s]."""
        planes = self._tracer.trace(pixels, times_s)
        self._noted.append((pixels, times_s, planes))
        return planes

    def motion(self, start_s: float, end_s: float) -> FloatArray | None:
        """Return how far surfaces move on the image from one time to another."""
        return self._tracer.motion(start_s, end_s)

    def bounds(self) -> None:
        """Know no flat surfaces, so that all requests are traced, and noted."""

    def steady_shadows(self) -> npt.NDArray[np.bool_]:
        """Return which pixels are lit alike in the last two frames."""
        return self._tracer.steady_shadows()

    def reflected(
        self, pixels: npt.NDArray[np.int64], light: npt.NDArray[np.float32], start_s: float, end_s: float,
        fineness: Fineness,
    ) -> Reflected:  # fmt: skip
        """Return what pixels reflect that show one flat surface."""
        return self._tracer.reflected(pixels, light, start_s, end_s, fineness)

    def take(self) -> Requests:
        """Return what was traced since this was asked for last."""
        noted, self._noted = self._noted, []
        pixels = np.concatenate([np.zeros(0, np.int32), *(each[0] for each in noted)])
        times_s = np.concatenate([np.zeros(0), *(each[1] for each in noted)])
        planes = np.concatenate([np.zeros((len(self.names), 0), np.float32), *(each[2] for each in noted)], axis=1)
        y, x = np.divmod(pixels, self._width)
        return Requests(x.astype(np.uint16), y.astype(np.uint16), times_s, planes, np.array(self.names))

    def cancel(self) -> None:
        """Make a running ``trace``, and every later one, raise an error soon; safe from any thread."""
        self._tracer.cancel()

    def close(self) -> None:
        """Release what it holds; safe to call twice."""
        self._tracer.close()
