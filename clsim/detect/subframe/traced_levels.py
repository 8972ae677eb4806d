"""The brightness of pixels that were traced between two frames, from their planes."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from clsim.detect.config import DetectorConfig
from clsim.detect.features import luminance_weights
from clsim.frames import ALBEDO, COVERAGE, DEPTH, EMISSION, RADIANCE, Frame

F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]
_LEAST_REFLECTANCE = 1e-3
"""Darker surfaces tell nothing of the light (irradiance.cl)."""
_SAME_DEPTH = 0.03
"""Relative difference of depth between pixels that are likely to show one surface."""
_STRANGER = 1e-9
"""Weight of light that was found on another surface, where there is no better."""


class TracedLevels(Protocol):
    """What turns planes of requests into levels."""

    def advance(self, frame: Frame) -> None:
        """Take notice of the frame at the end of the next step."""
        ...

    def begin(self, start: F32, end: F32, ways: F32) -> None:
        """Prepare for a step with those levels ``[H, W]`` at both ends, and a motion field ``[3, 2, H, W]``."""
        ...

    def levels(self, planes: F32, pixels: I64, shares: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the levels of requests [natural-log units], ``[N]``, from their planes ``[C, N]``.

        ``pixels`` are theirs, and ``shares`` tell how much of the step has passed.
        """
        ...


def traced_levels(config: DetectorConfig, names: tuple[str, ...], shape: tuple[int, int], lit: bool) -> TracedLevels:
    """Return what serves frames, and requests, with those planes and that height and width.

    ``lit`` tells whether the radiance of requests is whole.
    """
    return PathLevels(config, names) if lit else FirstHitLevels(config, names, shape)


class PathLevels:
    """The whole light of a pixel was traced: its brightness is the log of its luminance."""

    def __init__(self, config: DetectorConfig, names: tuple[str, ...]) -> None:
        """Prepare for requests with those planes."""
        self._weights = config.scale * np.array(luminance_weights(config))
        self._rgb = [names.index(name) for name in RADIANCE]
        self._floor = config.floor

    def advance(self, frame: Frame) -> None:
        """Take notice of nothing: the frames' levels say it all."""

    def begin(self, start: F32, end: F32, ways: F32) -> None:
        """Prepare for nothing."""

    def levels(self, planes: F32, pixels: I64, shares: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the log of luminance."""
        return np.asarray(np.log(np.maximum(self._weights @ planes[self._rgb], self._floor)), np.float64)


class FirstHitLevels:
    """First hits were traced alone: the light that falls on them is that of the frames at both ends.

    It is looked up where the ways of things lead from the pixel, at those of six places (three ways, two ends) that
    show the surface which the request saw: they have its depth.
    """

    def __init__(self, config: DetectorConfig, names: tuple[str, ...], shape: tuple[int, int]) -> None:
        """Prepare for frames of that height and width."""
        self._scale, self._floor, self._shape = config.scale, config.floor, shape
        self._weights = np.array(luminance_weights(config), np.float32)
        self._albedo = [names.index(name) for name in ALBEDO]
        self._single = [names.index(name) for name in (*COVERAGE, *EMISSION, *DEPTH)]
        self._ends: list[tuple[F32, F32, F32]] = []
        self._light: list[F32] = []

    def advance(self, frame: Frame) -> None:
        """Keep what the frame's first hits reflect and emit, and their depth."""
        seen = self._seen(frame.planes.reshape(len(frame.names), -1))
        self._ends = [*self._ends[-1:], (seen[0], seen[1], seen[2].copy())]

    def begin(self, start: F32, end: F32, ways: F32) -> None:
        """Find the light that falls on what the pixels show at both ends."""
        self._ways = ways.reshape(3, 2, -1)
        self._light = [
            np.where(
                reflectance > _LEAST_REFLECTANCE,
                np.maximum(np.exp(level.ravel()) / self._scale - emission, 0.0) / np.maximum(reflectance, 1e-12),
                np.nan,
            )
            for (reflectance, emission, _), level in zip(self._ends, (start, end), strict=True)
        ]

    def levels(self, planes: F32, pixels: I64, shares: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the log of what is emitted and what is reflected of the light at both ends."""
        reflectance, emission, depth = self._seen(planes)
        height, width = self._shape
        x, y = pixels % width, pixels // width
        total, light = np.zeros(len(pixels)), np.zeros(len(pixels))
        for way in self._ways:
            for end in (0, 1):
                gone = end - shares
                column = np.clip(np.round(x + gone * way[0, pixels]), 0, width - 1).astype(np.int64)
                row = np.clip(np.round(y + gone * way[1, pixels]), 0, height - 1).astype(np.int64)
                there = row * width + column
                found, nearer = self._light[end][there], self._ends[end][2][there] - depth
                alike = np.exp(-np.square(nearer / (_SAME_DEPTH * np.maximum(depth, 1e-6)))) + _STRANGER
                weight = np.where(np.isnan(found), 0.0, alike * (1.0 - np.abs(gone)))
                total += weight
                light += weight * np.nan_to_num(found)
        known = light / np.maximum(total, 1e-300)
        shown = self._scale * (emission + np.where(reflectance > _LEAST_REFLECTANCE, known * reflectance, 0.0))
        return np.asarray(np.log(np.maximum(shown, self._floor)), np.float64)

    def _seen(self, planes: F32) -> tuple[F32, F32, F32]:
        coverage, emission, depth = planes[self._single]
        return (self._weights @ planes[self._albedo]) * coverage, emission, depth
