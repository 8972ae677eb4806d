"""The interest map: what flows back from the detector to the renderer."""

from __future__ import annotations

from dataclasses import dataclass

from clsim.frames.frame import FloatArray


@dataclass(slots=True)
class InterestMap:
    """How close each pixel is to firing, after frame ``index``.

    Attributes:
        index: frame after which the map holds; frame ``index + 2`` is rendered with it, so that runs are repeatable.
        to_on: float32 ``[H, W]``, distance of L to the ON threshold [natural-log units], negative once crossed.
        to_off: float32 ``[H, W]``, distance of L to the OFF threshold, likewise.
        stderr: float32 ``[H, W]``, standard error of L [natural-log units]; NaN where unknown.
    """

    index: int
    to_on: FloatArray
    to_off: FloatArray
    stderr: FloatArray
