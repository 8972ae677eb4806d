"""The brightness path: what a detector tells a sensor of one time step."""

from __future__ import annotations

from dataclasses import dataclass

from clsim.opencl.workplace import Buffer


@dataclass(frozen=True)
class BrightnessPath:
    """Brightness of all pixels over one time step [natural-log units], on a device; linear in time in between.

    Attributes:
        start_us: time of the step's start.
        end_us: time of its end, later than the start.
        start: ``[H, span]``, level at the start; NaN where a pixel has none yet.
        end: ``[H, span]``, level at the end.
        pixels: int32, in raster order as y·span + x: the pixels that may fire or have no reference yet. All others are
            known to stay between the thresholds around their references.
        count: how many of ``pixels`` are in use.
    """

    start_us: int
    end_us: int
    start: Buffer
    end: Buffer
    pixels: Buffer
    count: int
