"""Host side of minmax.cl and wlr.cl: weighted local regression of packed frames.

Moon, Carr, Yoon, "Adaptive Rendering Based on Weighted Local Regression", ToG 2014, as used by Tsuji et al.,
ICIP 2023, section 2.1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from clsim.detect.config import DetectorConfig
from clsim.detect.layout import Place
from clsim.opencl.workplace import Buffer

_TILE = {16: 5, 8: 3, 4: 3, 1: 3}
"""Side of the register tile by vector width: CPUs with 512-bit registers have twice as many of them."""
_RUN = 8
"""Vectors of a row whose extremes one work-item finds on a CPU."""
_STRIP = 4
"""Vectors of a row that go down the columns together on a CPU."""
_BIG = {"float32": 3e38, "float64": 1e300}
"""Larger than any value (BIG in types.clh)."""


@dataclass(frozen=True)
class History:
    """Which packed frames a regression takes its samples from.

    Attributes:
        slot: where the newest frame is.
        frames: how many frames are in use, the newest included.
        any_invalid: whether any of them has invalid pixels.
    """

    slot: int
    frames: int
    any_invalid: bool


class Regression:
    """Fits the windows of all pixels (`dense`) or of some (`sparse`); the results are bit for bit the same.

    Attributes:
        fit: ``[H, 1 + D, span]``: α, then β of pixel x, pixel y and each feature, in raw units.
        extremes: ``[slots, H, 2F, span]``: least and largest value of each feature in each window of each frame.
    """

    def __init__(self, place: Place, config: DetectorConfig, packed: Buffer, slots: int) -> None:
        """Build the kernels for this window, kernel function and bandwidth."""
        self._place = place
        self._config = config
        self._packed = packed
        self.slots = slots
        layout = place.layout
        reach = config.side // 2 // config.stride * config.stride
        macros: dict[str, object] = {"REACH": reach, "STEP": config.stride, "TAPS": 2 * (reach // config.stride) + 1}
        names = ("minmax_columns", "minmax_rows")
        run, strip = (_RUN, _STRIP) if place.device.is_cpu else (1, 1)
        self._columns, self._rows = place.kernels("detect/minmax", names, {**macros, "RUN": run, "STRIP": strip})
        self._columns_size = (-(-layout.span // (strip * layout.lanes)), layout.features)
        self._rows_size = (-(-layout.span // (run * layout.lanes)), layout.height)
        macros["TILE"] = _TILE[place.device.lanes]
        prefix = ""
        if config.kernel == "epanechnikov":
            macros["EPANECHNIKOV"] = 1
        else:
            prefix = root_source(2 + layout.features, config.bandwidth_h, place.real)
        self._dense, self._sparse = place.kernels("detect/wlr", ("wlr_dense", "wlr_sparse"), macros, prefix)
        self._extremes_shape = layout.planes_shape(2 * layout.features)
        # Outside the image there is no value: columns of border that no kernel writes.
        self._column_extremes = place.allocate((layout.height, 2 * layout.features, layout.pitch))
        nothing = np.full(self._column_extremes.shape, _BIG[place.real.name])
        nothing[:, 1::2] *= -1
        place.write(self._column_extremes, nothing)
        self.extremes = place.allocate((slots, *self._extremes_shape))
        self.fit = place.allocate(layout.planes_shape(3 + layout.features))

    @property
    def extremes_size(self) -> int:
        """Values from one slot of `extremes` to the next."""
        return int(np.prod(self._extremes_shape))

    def prepare(self, slot: int) -> None:
        """Find the extremes of the windows of the frame in ``slot``; needed before a fit uses that frame."""
        layout = self._place.layout
        if layout.features == 0:
            return
        self._place.launch(
            self._columns, self._columns_size, self._packed,
            np.int64(slot * layout.packed_size), layout.pitch, layout.span, layout.height, self._column_extremes,
        )  # fmt: skip
        self._place.launch(
            self._rows, self._rows_size, self._column_extremes, layout.pitch, layout.span,
            np.int64(slot * self.extremes_size), self.extremes,
        )  # fmt: skip

    def dense(self, history: History) -> None:
        """Fit every pixel's window."""
        self._place.launch(self._dense, self._place.layout.vectors, *self._input(history), self.fit)

    def sparse(self, history: History, pixels: Buffer, count: int) -> None:
        """Fit the windows of the first ``count`` pixels listed as y·span + x."""
        size = (-(-count // self._place.layout.lanes),)
        self._place.launch(self._sparse, size, *self._input(history), pixels, count, self.fit)

    def _input(self, history: History) -> tuple[object, ...]:
        layout = self._place.layout
        return (
            self._packed, np.int64(layout.packed_size), self.extremes, np.int64(self.extremes_size), history.frames,
            history.slot, self.slots, layout.pitch, layout.span, layout.width, layout.height,
            int(history.any_invalid), 1.0 / self._config.bandwidth_h, self._config.ridge, self._config.shrink,
        )  # fmt: skip


def root_source(dimensions: int, bandwidth_h: float, real: np.dtype[Any]) -> str:
    """Return OpenCL source of ``root(q)`` = exp(−q/(4h²)) for 0 ≤ q ≤ ``dimensions``.

    exp is a builtin call per lane on PoCL. Scaled features lie in [−1, 1], so q is bounded and the root of the weight
    is a short polynomial, squared a few times.
    """
    extent, degree = (0.35, 4) if real == np.float32 else (0.35, 9)
    largest = dimensions * 1.001 / (4.0 * bandwidth_h**2)
    squarings = max(0, int(np.ceil(np.log2(largest / extent))))
    rate = 1.0 / (4.0 * bandwidth_h**2 * 2.0**squarings)
    polynomial = np.polynomial.Chebyshev.interpolate(
        lambda q: np.exp(-rate * q), degree, domain=[0.0, dimensions * 1.001]
    ).convert(kind=np.polynomial.Polynomial)
    lines = [f"    realv p = (real){polynomial.coef[-1]:.17e};"]
    lines += [f"    p = p * q + (real){value:.17e};" for value in polynomial.coef[-2::-1]]
    lines += ["    p = p * p;"] * squarings
    return "\n".join(["static inline realv root(realv q) {", *lines, "    return p;", "}"])
