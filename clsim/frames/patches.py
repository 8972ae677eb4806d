"""Small squares of a picture that are looked at apart from the rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

_STEP = 0.7548776662466927, 0.5698402909980532
"""Fractions whose multiples fill a square evenly (Roberts 2018, the sequence R2)."""
_LEAST_PX = 8
"""Side of what is left of a patch without its margins, at least [pixels]."""


@dataclass(frozen=True)
class Patches:
    """Squares of one size, spread over a picture; they may overlap.

    Attributes:
        side: of each [pixels].
        corners: x and y of each one's upper left pixel.
        margin: of each, whose pixels are seen for the sake of their neighbours [pixels].
    """

    side: int
    corners: tuple[tuple[int, int], ...]
    margin: int

    @classmethod
    def over(cls, width: int, height: int, margin: int, share: float) -> Patches | None:
        """Return patches that are about that share of a picture, or one that is more; None where none fits in."""
        least = 2 * margin + _LEAST_PX
        if least > min(width, height):
            return None
        pixels = share * width * height
        # In few large patches more pixels are inside, in many small ones more places are seen.
        side = int(np.clip(pixels**0.5, least, min(width, height, max(least, 4 * margin))))
        number = max(1, round(pixels / side**2))
        x, y = ((0.5 + np.arange(number) * step) % 1.0 for step in _STEP)
        left, top = (x * (width - side + 1)).astype(int), (y * (height - side + 1)).astype(int)
        return cls(side, tuple(zip(left.tolist(), top.tolist(), strict=True)), margin)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of all of them, one below the other."""
        return len(self.corners) * self.side, self.side

    def pixels(self, width: int) -> npt.NDArray[np.int32]:
        """Return the numbers in raster order of their pixels in a picture so wide, ``[rows · columns]``."""
        x, y = np.array(self.corners, np.int32).T
        along = np.arange(self.side, dtype=np.int32)
        found: npt.NDArray[np.int32] = (y[:, None, None] + along[:, None]) * width + x[:, None, None] + along
        return found.reshape(-1)

    def inside(self) -> npt.NDArray[np.bool_]:
        """Return where pixels are not in a margin, ``[rows, columns]``."""
        along = np.arange(self.side)
        within = (along >= self.margin) & (along < self.side - self.margin)
        return np.tile(within[:, None] & within, (len(self.corners), 1))
