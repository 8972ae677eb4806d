"""Host side of irradiance.cl: brightness from smoothed irradiance.

Dividing by albedo before a filter and multiplying afterwards keeps texture sharp whatever the filter blurs; weights
from the first hit's depth and normal keep it on one surface (the joint bilateral filter: Eisemann and Durand, "Flash
Photography Enhancement via Intrinsic Relighting", ToG 2004). Irradiance is averaged before the logarithm is taken, so
that few samples leave no bias. The window gives way to smaller ones where they differ from it by more than noise.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from clsim.detect.config import DetectorConfig
from clsim.detect.features import luminance_weights
from clsim.detect.gate import Gate, Levels
from clsim.detect.layout import BORDER, FIRST_FEATURE, Place
from clsim.errors import InputError
from clsim.frames import ALBEDO, COVERAGE, DEPTH, EMISSION, NORMAL, RADIANCE, SAMPLES
from clsim.opencl.workplace import Buffer

NEEDED_PLANES = (*RADIANCE, *ALBEDO, *NORMAL, *DEPTH)
_PACKED_PLANES = 7
"""Planes of a packed image (irradiance.cl)."""
FEATURES = _PACKED_PLANES - FIRST_FEATURE
"""What a `clsim.detect.layout.Layout` of so many planes is told."""
_INVALID = -3.0
"""Irradiance where there is no pixel (irradiance.cl)."""
_DETAIL_PLANES, _ENERGY_PLANES, _BOX_ROWS = 3, 4, 9
_ROWS, _GATED = 4, 16
"""Rows that a work-item smooths, and tests."""


def check_planes(names: tuple[str, ...]) -> None:
    """Refuse frames that do not tell albedo, normal and depth.

    Raises:
        InputError: one of the planes is missing.
    """
    for name in NEEDED_PLANES:
        if name not in names:
            raise InputError(f"method irradiance needs the plane {name!r}, which the frames lack")


class Demodulation:
    """Divides frames by their albedo and packs them with what the window's weights are made of."""

    def __init__(self, place: Place, config: DetectorConfig, names: tuple[str, ...]) -> None:
        """Prepare for frames with planes ``names``."""
        self._place = place
        (self._kernel,) = place.kernels("detect/irradiance", ("demodulate",), _macros(config, names), _prefix(place))
        optional = [name for name in (*COVERAGE, *EMISSION, *SAMPLES) if name in names]
        planes = (*NEEDED_PLANES, *optional)
        self._source = place.allocate((len(planes),), np.int32)
        place.write(self._source, np.array([names.index(name) for name in planes], dtype=np.int32))
        self._weights = luminance_weights(config)
        self._scale = float(config.scale)
        self.packed = place.allocate((1, *place.layout.packed_shape), fill=_INVALID)

    def run(self, memory: Any, slot: int) -> None:
        """Pack one frame."""
        layout = self._place.layout
        self._place.launch(
            self._kernel, (layout.height,), memory, self._source, layout.width, layout.height, layout.pitch,
            *self._weights, self._scale, self.packed,
        )  # fmt: skip

    def offset(self, slot: int) -> int:
        """Where a slot starts: there is one, for no earlier frame is needed."""
        return 0


class Smoothing:
    """Averages irradiance over each pixel's window, turns it back into brightness, and tells who may fire by that.

    Attributes:
        gate: what it tells.
        error: ``[H, span]``, the standard error of the window's mean, as a share of brightness, where `run` was asked.
    """

    def __init__(self, place: Place, config: DetectorConfig, names: tuple[str, ...]) -> None:
        """Build the kernels for this window."""
        self._place = place
        kernels = ("smooth_plain", "smooth_with_error", "gate_details")
        self._plain, self._with_error, self._test = place.kernels(
            "detect/irradiance", kernels, _macros(config, names), _prefix(place)
        )
        self.gate = Gate(place)
        layout = place.layout
        rows = layout.height + 2 * BORDER
        self._details = place.allocate((rows, _DETAIL_PLANES, layout.pitch))
        self._strips = -(-layout.height // _ROWS)
        self._tests = -(-layout.height // _GATED)
        self._room = place.allocate((self._tests, _BOX_ROWS + 1, _ENERGY_PLANES, layout.pitch))
        self.error = place.allocate((layout.height, layout.span))
        self._tested = (self.error,) if config.confidence > 0 else ()

    def run(self, packed: Buffer, *, with_error: bool) -> None:
        """Smooth a packed frame; `test` needs the error too where a change must be significant."""
        layout = self._place.layout
        kernel, out_error = (self._with_error, (self.error,)) if with_error else (self._plain, ())
        size = (layout.vectors[0], self._strips)
        self._place.launch(kernel, size, packed, layout.height, layout.pitch, layout.span, self._details, *out_error)

    def test(self, packed: Buffer, levels: Levels, references: Buffer) -> None:
        """Write the smoothed frame's ``levels``, and flag pixels by them."""
        layout, gate = self._place.layout, self.gate
        self._place.launch(
            self._test, (self._tests,), packed, self._details, layout.height, layout.pitch, layout.span, layout.width,
            references, levels.threshold_on, levels.threshold_off, levels.start, *self._tested, self._room, levels.end,
            gate.flags, gate.counts,
        )  # fmt: skip


def _detail_noise(reach: int) -> tuple[float, float]:
    """Return the variances of inner mean − window mean, and of pixel − inner mean, where irradiance is white noise.

    The noise has variance 1; all weights are those of distance, as on one surface far from its edges. ``reach`` is half
    the window's side [pixels].
    """
    steps = np.arange(-reach, reach + 1)
    along = np.exp(-(steps**2) / (2 * (reach / 2) ** 2))
    window = np.outer(along, along)
    inner, pixel = np.zeros_like(window), np.zeros_like(window)
    middle = slice(reach - 1, reach + 2)
    inner[middle, middle] = window[middle, middle]
    pixel[reach, reach] = 1.0
    window /= window.sum()
    inner /= inner.sum()
    return float(np.square(inner - window).sum()), float(np.square(pixel - inner).sum())


def _macros(config: DetectorConfig, names: tuple[str, ...]) -> dict[str, object]:
    coarse, fine = _detail_noise(config.side // 2)
    return {
        "REACH": config.side // 2,
        "ROWS": _ROWS,
        "GATED": _GATED,
        "COARSE_NOISE": f"{coarse:.17e}",
        "FINE_NOISE": f"{fine:.17e}",
        "HAS_COVERAGE": int(COVERAGE[0] in names),
        "HAS_EMISSION": int(EMISSION[0] in names),
        "HAS_SAMPLES": int(SAMPLES[0] in names),
        **({"CONFIDENCE": f"{config.confidence:.17e}"} if config.confidence > 0 else {}),
    }


def _prefix(place: Place) -> str:
    """Return OpenCL source of ``exp2_fraction(f)`` = 2^f for |f| ≤ 1/2, as good as the precision."""
    degree = 5 if place.real == np.float32 else 11
    polynomial = np.polynomial.Chebyshev.interpolate(np.exp2, degree, domain=[-0.5, 0.5]).convert(
        kind=np.polynomial.Polynomial
    )
    lines = [f"    realv p = (real){polynomial.coef[-1]:.17e};"]
    lines += [f"    p = p * f + (real){value:.17e};" for value in polynomial.coef[-2::-1]]
    return "\n".join(["static inline realv exp2_fraction(realv f) {", *lines, "    return p;", "}"])
