"""Host side of interest.cl: the interest map, by which a renderer spends its samples."""

from __future__ import annotations

import numpy as np

from clsim.detect.gate import Levels
from clsim.detect.layout import Place
from clsim.frames.frame import FloatArray
from clsim.opencl.workplace import Buffer


class Interest:
    """Measures how close pixels are to firing."""

    def __init__(self, place: Place) -> None:
        """Build the kernel."""
        self._place = place
        (self._measure,) = place.kernels("detect/interest", ("measure_interest",))
        self._out = place.allocate((4, place.layout.height, place.layout.width), np.float32)

    def measure(self, levels: Levels, references: Buffer, error: Buffer | None) -> FloatArray:
        """Return ``[4, H, W]`` after a step: distances to the ON and OFF thresholds, change, standard error.

        ``error`` is ``[H, span]``; None stands for 0.
        """
        layout = self._place.layout
        self._place.launch(
            self._measure, (layout.height,), references, levels.start, levels.end,
            levels.end if error is None else error, int(error is not None), layout.width, layout.height, layout.span,
            levels.threshold_on, levels.threshold_off, self._out,
        )  # fmt: skip
        return self._place.read(self._out)
