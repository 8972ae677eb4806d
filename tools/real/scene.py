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


LAYERS = ((0.4, 0.5), (1.0, 1.0), (2.2, 0.7))
"""Parts of what moves: how fast each goes, and how strong its contrast is, over the scene's."""


class Texture:
    """Dark and bright patches with soft edges, in those parts of the picture where something moves, at three speeds."""

    def __init__(self, look: Look, width: int, height: int, seed: int = 0) -> None:
        """Draw it; it repeats after the picture's size."""
        random = np.random.default_rng(seed)

        def cloud(size_px: float) -> FloatArray:
            found = ndimage.gaussian_filter(random.normal(size=(height, width)), size_px, mode="wrap")
            return np.asarray(found / found.std())

        noise = cloud(look.patch_px)
        patches = np.where(noise > np.quantile(noise, 0.5 - 0.5 * look.brighter), 0.5, -0.5)
        # Patches of any strength, and a little structure in them.
        texture = look.contrast * (
            patches * np.clip(0.6 + 0.4 * cloud(2 * look.patch_px), 0.1, 1.5) + 0.02 * cloud(1.0)
        )
        self._texture = ndimage.gaussian_filter(texture, 0.7, mode="wrap")
        places, of_layer = cloud(25.0), cloud(25.0)
        self._layer = np.searchsorted(np.quantile(of_layer, (1 / 3, 2 / 3)), of_layer)
        self._layer[places <= np.quantile(places, 1 - look.active)] = -1

    @property
    def brightest(self) -> float:
        """Level of what is brightest."""
        return float(self._texture.max())

    def at(self, moved_px: float) -> FloatArray:
        """Return the levels where the texture has moved so far, ``[height, width]``."""
        levels = np.zeros_like(self._texture)
        for layer, (pace, strength) in enumerate(LAYERS):
            here = self._layer == layer
            levels[here] = strength * self._moved(moved_px * pace)[here]
        return levels

    def _moved(self, by_px: float) -> FloatArray:
        # A line between whole pixels, which leaves less blur than a pixel's own aperture.
        picture = self._texture
        for axis, share in ((1, DIRECTION[0]), (0, DIRECTION[1])):
            whole = int(np.floor(by_px * share))
            part = by_px * share - whole
            near = np.roll(picture, whole, axis)
            picture = (1 - part) * near + part * np.roll(near, 1, axis)
        return picture
