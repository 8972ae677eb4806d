"""Host side of interest.cl: what a renderer is told of the frames before."""

from __future__ import annotations

import numpy as np

from clsim.detect.config import DetectorConfig
from clsim.detect.gate import model_macros
from clsim.frames.frame import FloatArray
from clsim.opencl.workplace import Buffer, Workplace


class Interest:
    """Keeps the levels of one frame until the next, and measures how close pixels are to firing."""

    def __init__(self, workplace: Workplace, config: DetectorConfig) -> None:
        """Build the kernels; no pixel has a level before."""
        self._workplace = workplace
        self._config = config
        self._keep, self._measure = workplace.kernels(
            "interest", ("keep_level", "measure_interest"), model_macros(config)
        )
        layout = workplace.layout
        self._before = workplace.allocate((layout.height, layout.span), fill=np.nan)
        self._out = workplace.allocate((4, layout.height, layout.width), np.float32)

    def keep(self, state: Buffer) -> None:
        """Remember the levels, before a step changes them."""
        layout = self._workplace.layout
        self._workplace.launch(self._keep, (layout.height,), state, layout.span, self._before)

    def measure(self, state: Buffer, error: Buffer | None) -> FloatArray:
        """Return ``[4, H, W]`` after a step: distances to the ON and OFF thresholds, change, standard error.

        ``error`` is ``[H, span]``; None stands for 0.
        """
        layout, config = self._workplace.layout, self._config
        self._workplace.launch(
            self._measure, (layout.height,), state, self._before, self._before if error is None else error,
            int(error is not None), layout.width, layout.height, layout.span, config.threshold_on,
            config.threshold_off, self._out,
        )  # fmt: skip
        return self._workplace.read(self._out)
