"""Host side of models.cl: what pixels remember of their last event."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.detect.box import Boxes
from clsim.detect.gate import Gate
from clsim.detect.layout import CHUNK, Place
from clsim.detect.wlr import History, Regression
from clsim.opencl.workplace import Buffer

_FIRST_OF_FEATURES = 4
"""Planes of a model before those of the features: value, box mean, beta of pixel x and y (model.clh)."""
_BLOCKS = 4
"""Groups of planes that each have one for every feature: beta, centre, least and largest value."""


class Models:
    """The plane that was fitted where each pixel last fired.

    Attributes:
        state: ``[H, 4 + 4F, span]``, as model.clh has it.
    """

    def __init__(self, place: Place, boxes: Boxes | None) -> None:
        """Build the kernel; ``boxes`` where the gate compares box means."""
        self._place = place
        macros: dict[str, object] = {"CHUNK": CHUNK, **model_macros(boxes)}
        (self._keep,) = place.kernels("detect/models", ("keep_models",), macros)
        self._boxes = boxes
        self._no_boxes = place.allocate((1,))
        self.state = place.allocate(place.layout.planes_shape(_FIRST_OF_FEATURES + _BLOCKS * place.layout.features))

    def keep(self, gate: Gate, count: int, fired: Buffer, fit: Regression, packed: Buffer, history: History) -> None:
        """Let those of the first ``count`` listed pixels that fired or are new remember what was fitted."""
        layout = self._place.layout
        boxes = self._no_boxes if self._boxes is None else self._boxes.means
        self._place.launch(
            self._keep, (-(-count // CHUNK),), gate.pixels, count, gate.flags, fired, packed,
            np.int64(layout.packed_size), fit.extremes, np.int64(fit.extremes_size), history.frames, history.slot,
            fit.slots, layout.pitch, layout.span, boxes, fit.fit, self.state,
        )  # fmt: skip

    def take_over(self, older: Models, old_at: list[int | None], constants: list[float]) -> None:
        """Continue from models of fewer features.

        ``old_at`` tells where each feature was among the older ones, None if it was not; it had the value ``constants``
        until now.
        """
        old = self._place.read(older.state)
        state: npt.NDArray[Any] = np.zeros(self.state.shape, dtype=self._place.real)
        state[:, :_FIRST_OF_FEATURES] = old[:, :_FIRST_OF_FEATURES]
        features, old_features = self._place.layout.features, older._place.layout.features
        for j, (before, constant) in enumerate(zip(old_at, constants, strict=True)):
            for block in range(_BLOCKS):
                to = _FIRST_OF_FEATURES + block * features + j
                if before is not None:
                    state[:, to] = old[:, _FIRST_OF_FEATURES + block * old_features + before]
                else:
                    state[:, to] = 0.0 if block == 0 else constant
        self._place.write(self.state, state)


def model_macros(boxes: Boxes | None) -> dict[str, object]:
    """Return the macros of kernels that know models; ``boxes`` where the gate compares box means."""
    return {"MODEL": 1} if boxes is None else {"MODEL": 1, "RADIANCE": 1}
