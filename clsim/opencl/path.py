"""The brightness path: what a detector tells a sensor of one time step."""

from __future__ import annotations

from dataclasses import dataclass

from clsim.opencl.workplace import Buffer


@dataclass(frozen=True)
class Knots:
    """Levels of listed pixels at times within a step, on a device, in compressed rows: a row a pixel of the list.

    The knots of the i-th pixel of `BrightnessPath.pixels` are those from ``offsets[i]`` to ``offsets[i + 1] - 1``. A
    pixel without any costs nothing more. In all three arrays what lies behind is not read, so that they may be
    allocated once, and larger.

    Attributes:
        offsets: int32, at least ``count + 1``, not falling, from 0.
        times_ns: int64, of each knot, from the step's start [ns]; rising in a row, after 0 and before the step's end.
        levels: of each knot [natural-log units], finite, in the type of `BrightnessPath.end`.
    """

    offsets: Buffer
    times_ns: Buffer
    levels: Buffer


@dataclass(frozen=True)
class BrightnessPath:
    """Brightness of all pixels over one time step [natural-log units], on a device.

    From the start, over the knots if there are any, to the end it is linear in time.

    Attributes:
        start_us: time of the step's start.
        end_us: time of its end, later than the start.
        start: ``[H, span]``, level at the start; NaN where a pixel has none yet.
        end: ``[H, span]``, level at the end.
        pixels: int32, in raster order as y·span + x: the pixels that may fire or have no reference yet. All others are
            known to stay between the thresholds around their references; a pixel that leaves them at a knot alone
            must be listed too.
        count: how many of ``pixels`` are in use.
        knots: levels within the step; None where there are none.
    """

    start_us: int
    end_us: int
    start: Buffer
    end: Buffer
    pixels: Buffer
    count: int
    knots: Knots | None = None
