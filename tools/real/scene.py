"""A textured scene that drifts before pixels: levels of log brightness at any time, as fast as it is told to be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

FloatArray = npt.NDArray[np.float64]
DIRECTION = (0.86, 0.5)
"""Of the drift, along x and y."""


@dataclass(frozen=True)
class Look:
    """What a scene looks like; its speed is found, so that it fires as often as a recording.

    Attributes:
        active: share of the picture in which anything moves; the rest is grey and still.
        contrast: from dark to bright patches of the texture [natural-log units].
        patch_px: how large the patches are [pixels].
        brighter: how much more of the texture is bright than dark, from -1 to 1: edges are of either polarity all the
            same.
    """

    active: float
    contrast: float
    patch_px: float
    brighter: float = 0.0


class Texture:
    """Dark and bright patches with soft edges, in those parts of the picture where something moves."""

    def __init__(self, look: Look, width: int, height: int, seed: int = 0) -> None:
        """Draw it; it repeats after the picture's size."""
        random = np.random.default_rng(seed)
        noise = ndimage.gaussian_filter(random.normal(size=(height, width)), look.patch_px, mode="wrap")
        patches = np.where(noise > np.quantile(noise, 0.5 - 0.5 * look.brighter), 0.5, -0.5)
        fine = ndimage.gaussian_filter(random.normal(size=(height, width)), 1.0, mode="wrap")
        texture = look.contrast * (patches + 0.02 * fine / fine.std())
        self._texture = ndimage.gaussian_filter(texture, 0.7, mode="wrap")
        places = ndimage.gaussian_filter(random.normal(size=(height, width)), 25.0, mode="wrap")
        self._active = places > np.quantile(places, 1 - look.active)

    @property
    def brightest(self) -> float:
        """Level of what is brightest."""
        return float(self._texture.max())

    def at(self, moved_px: float) -> FloatArray:
        """Return the levels where the texture has moved so far, ``[height, width]``."""
        # A line between whole pixels along the drift, which leaves less blur than a pixel's own aperture.
        picture = self._texture
        for axis, share in ((1, DIRECTION[0]), (0, DIRECTION[1])):
            whole = int(np.floor(moved_px * share))
            part = moved_px * share - whole
            near = np.roll(picture, whole, axis)
            picture = (1 - part) * near + part * np.roll(near, 1, axis)
        return np.where(self._active, picture, 0.0)
