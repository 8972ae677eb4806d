"""Host side of forecast.cl: at which times within a step brightness should be known, from the motion field."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from clsim.opencl.workplace import Buffer, Grid, Workplace

MOMENTS = 64
"""Parts of a step (forecast.cl)."""
_BLOCK = 4
"""Side of the squares whose extremes are known (forecast.cl) [pixels]."""
BEND = 0.14
"""Share of a threshold by which brightness may leave a straight line unseen."""


class Forecast:
    """A forecast: the pictures at both ends of a step, carried along the motion field."""

    def __init__(self, place: Workplace[Grid], on: float, off: float, linear_light: bool) -> None:
        """Build the kernel for contrast thresholds [natural-log units], and light or its logarithm linear in time."""
        self._place = place
        self._thresholds = on, off
        macros = {"LINEAR_LIGHT": 1} if linear_light else {}
        self._extremes, self._forecast = place.kernels("detect/forecast", ("extremes", "forecast"), macros)
        height, width = place.layout.height, place.layout.width
        blocks = -(-height // _BLOCK), -(-width // _BLOCK)
        self._of_ends = [place.allocate((2, *blocks)) for _ in range(2)]
        self._ways = place.allocate((3, 2, height, width), np.float32)
        self._marks = place.allocate((height, width), np.uint64)

    def marks(
        self, start: Buffer, end: Buffer, references: Buffer, ways: npt.NDArray[np.float32]
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Return pixels (y·width + x) and moments, 1 to `MOMENTS` − 1, at which brightness should be known.

        They are sorted by pixel, then by moment.

        Args:
            start, end: levels at both ends, ``[H, span]``.
            references: levels of the last events, ``[H, span]``; NaN where there is none.
            ways: the motion field, ``[3, 2, H, W]`` [pixels].
        """
        place, layout = self._place, self._place.layout
        height, width, span = layout.height, layout.width, layout.span
        place.write(self._ways, ways)
        on, off = self._thresholds
        for image, extremes in zip((start, end), self._of_ends, strict=True):
            place.launch(self._extremes, (-(-height // _BLOCK),), image, width, height, span, extremes)
        place.launch(
            self._forecast, (height,), start, end, *self._of_ends, references, self._ways, width, height, span, on, off,
            BEND * min(on, off), self._marks,
        )  # fmt: skip
        marks = place.read(self._marks).ravel()
        pixels = np.flatnonzero(marks)
        bits = np.unpackbits(marks[pixels].astype("<u8").view(np.uint8).reshape(-1, 8), axis=1, bitorder="little")
        which, moments = np.nonzero(bits)
        return pixels[which], moments
