"""Host side of irradiance.cl: brightness from smoothed irradiance.

Dividing by albedo before a filter and multiplying afterwards keeps texture sharp whatever the filter blurs; weights
from the first hit's depth and normal keep it on one surface (the joint bilateral filter: Eisemann and Durand, "Flash
Photography Enhancement via Intrinsic Relighting", ToG 2004). Irradiance is averaged before the logarithm is taken, so
that few samples leave no bias. The window gives way to smaller ones where they differ from it by more than noise.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.detect.config import DetectorConfig
from clsim.detect.reference.irradiance import detail_noise
from clsim.detect.reference.observation import LUMINANCE_WEIGHTS
from clsim.errors import InputError
from clsim.frames import ALBEDO, COVERAGE, DEPTH, EMISSION, NORMAL, RADIANCE, SAMPLES
from clsim.opencl.workplace import BORDER, Buffer, Workplace

NEEDED_PLANES = (*RADIANCE, *ALBEDO, *NORMAL, *DEPTH)
PACKED_PLANES = 9
"""Planes of a packed image after mask and luminance (irradiance.cl)."""
_DETAIL_PLANES, _ENERGY_PLANES = 3, 4


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

    def __init__(self, workplace: Workplace, config: DetectorConfig, names: tuple[str, ...]) -> None:
        """Prepare for frames with planes ``names``."""
        self._workplace = workplace
        (self._kernel,) = workplace.kernels("irradiance", ("demodulate",), _macros(config, names), _prefix(workplace))
        optional = [name for name in (*COVERAGE, *EMISSION, *SAMPLES) if name in names]
        planes = (*NEEDED_PLANES, *optional)
        self._source = workplace.allocate((len(planes),), np.int32)
        workplace.write(self._source, np.array([names.index(name) for name in planes], dtype=np.int32))
        self._weights = LUMINANCE_WEIGHTS[config.luminance]
        self._scale = float(config.scale)
        self.packed = workplace.allocate((1, *workplace.layout.packed_shape))
        height = workplace.layout.height
        self._invalid = workplace.allocate((height,), np.int32)
        self._host_invalid = np.zeros(height, dtype=np.int32)

    def run(self, memory: Any, slot: int) -> tuple[int, npt.NDArray[np.float32]]:
        """Pack one frame; return how many pixels are invalid, and no extremes: no plane is left out as constant."""
        layout = self._workplace.layout
        self._workplace.launch(
            self._kernel, (layout.height,), memory, self._source, layout.width, layout.height, layout.pitch,
            *self._weights, self._scale, self.packed, self._invalid,
        )  # fmt: skip
        self._workplace.read(self._invalid, self._host_invalid)
        return int(self._host_invalid.sum()), np.zeros((0, 2), dtype=np.float32)

    def offset(self, slot: int) -> int:
        """Where a slot starts: there is one, for no earlier frame is needed."""
        return 0


class Smoothing:
    """Averages irradiance over each pixel's window and turns it back into brightness.

    Attributes:
        level: ``[H, span]``, L of each pixel [natural-log units].
        error: ``[H, span]``, the standard error of the window's mean, as a share of brightness, where `run` was asked.
    """

    def __init__(self, workplace: Workplace, config: DetectorConfig, names: tuple[str, ...]) -> None:
        """Build the kernels for this window."""
        self._workplace = workplace
        kernels = ("smooth_plain", "smooth_with_error", "sum_energies", "level_of_details")
        self._plain, self._with_error, self._sum, self._level = workplace.kernels(
            "irradiance", kernels, _macros(config, names), _prefix(workplace)
        )
        layout = workplace.layout
        rows = layout.height + 2 * BORDER
        self._details = workplace.allocate((rows, _DETAIL_PLANES, layout.pitch))
        self._energies = workplace.allocate((layout.height, _ENERGY_PLANES, layout.pitch))
        self._sums = workplace.allocate((rows, _ENERGY_PLANES, layout.pitch))
        self.level = workplace.allocate((layout.height, layout.span))
        self.error = workplace.allocate((layout.height, layout.span))

    def run(self, packed: Buffer, *, with_error: bool) -> None:
        """Smooth a packed frame."""
        layout, launch = self._workplace.layout, self._workplace.launch
        kernel, out_error = (self._with_error, (self.error,)) if with_error else (self._plain, ())
        launch(kernel, layout.vectors, packed, layout.pitch, layout.span, self._details, *out_error)
        launch(
            self._sum, (layout.height,), packed, self._details, layout.width, layout.pitch, self._energies, self._sums
        )
        launch(self._level, layout.vectors, packed, self._details, self._sums, layout.pitch, layout.span, self.level)


def _macros(config: DetectorConfig, names: tuple[str, ...]) -> dict[str, object]:
    coarse, fine = detail_noise(config.side // 2)
    return {
        "REACH": config.side // 2,
        "COARSE_NOISE": f"{coarse:.17e}",
        "FINE_NOISE": f"{fine:.17e}",
        "HAS_COVERAGE": int(COVERAGE[0] in names),
        "HAS_EMISSION": int(EMISSION[0] in names),
        "HAS_SAMPLES": int(SAMPLES[0] in names),
    }


def _prefix(workplace: Workplace) -> str:
    """Return OpenCL source of ``exp2_fraction(f)`` = 2^f for |f| ≤ 1/2, as good as the precision."""
    degree = 5 if workplace.real == np.float32 else 11
    polynomial = np.polynomial.Chebyshev.interpolate(np.exp2, degree, domain=[-0.5, 0.5]).convert(
        kind=np.polynomial.Polynomial
    )
    lines = [f"    realv p = (real){polynomial.coef[-1]:.17e};"]
    lines += [f"    p = p * f + (real){value:.17e};" for value in polynomial.coef[-2::-1]]
    return "\n".join(["static inline realv exp2_fraction(realv f) {", *lines, "    return p;", "}"])
