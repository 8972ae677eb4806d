"""How far a picture moves from one frame to the next, measured in blocks: whole pixels first, then the rest.

Whole pixels: phase correlation (Kuglin and Hines, "The Phase Correlation Image Alignment Method", 1975). The rest:
least squares on gradients (Lucas and Kanade, "An Iterative Image Registration Technique", 1981).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from clsim.frames.frame import FloatArray

BLOCK = 32
"""Largest side of a block [pixels]; shifts up to half of it are told apart."""
_MOST_BLOCKS = 64
_FAINTEST = 0.02
"""Smallest standard deviation of log brightness in a block that has something to see."""
_ALIKE = 0.6
"""Least correlation of a block with what it is found again in."""
_DARKEST, _BRIGHTEST = 1e-3, 1e6
_NOTHING = 1e-30
"""Keeps what has no texture from a division by nothing."""


class Displacement:
    """Gathers how fast a sequence of pictures moves.

    Attributes:
        pairs: pairs of frames that could be measured.
        lost_pairs: those in which no block was found again: too fast, cut, or noise.
        fast_pairs: those in which something moved by more than a pixel.
        largest_px: the 95th percentile of the blocks' shifts [pixels], of the pair where it is largest.
    """

    def __init__(self, width: int, height: int) -> None:
        """Prepare for pictures of ``width`` × ``height`` pixels."""
        self.pairs = self.fast_pairs = self.lost_pairs = 0
        self.largest_px = 0.0
        self._sides = min(BLOCK, height), min(BLOCK, width)
        rows, columns = height // self._sides[0], width // self._sides[1]
        chosen = np.unique(np.linspace(0, rows * columns - 1, min(_MOST_BLOCKS, rows * columns)).round().astype(int))
        self._corners = np.stack([chosen // columns, chosen % columns], axis=1) * np.array(self._sides)
        down, across = (np.hanning(side + 2)[1:-1].astype(np.float32) for side in self._sides)
        self._window = down[:, None] * across
        self._before: tuple[FloatArray, npt.NDArray[np.complex128]] | None = None

    def as_dict(self) -> dict[str, float]:
        """Return the figures by name."""
        return {name: getattr(self, name) for name in ("pairs", "fast_pairs", "lost_pairs", "largest_px")}

    def add(self, picture: FloatArray) -> float | None:
        """Take the next picture of linear light ``[H, W]``; return the pair's shift [pixels], None if it has none."""
        blocks = _log_blocks(picture, self._corners, self._sides)
        spectra = np.fft.rfft2(blocks * self._window)
        before, self._before = self._before, (blocks, spectra)
        if before is None:
            return None
        both = (blocks.std(axis=(1, 2)) > _FAINTEST) & (before[0].std(axis=(1, 2)) > _FAINTEST)
        if not both.any():
            return None
        whole = self._whole(spectra[both] * np.conj(before[1][both]))
        corners = self._corners[both] + whole
        inside = ((corners >= 0) & (corners + self._sides <= picture.shape)).all(axis=1)
        after = _log_blocks(picture, corners[inside], self._sides)
        left, alike = self._rest(before[0][both][inside], after)
        shifts = np.hypot(*(whole[inside] + left).T)[alike > _ALIKE]
        if not shifts.size:
            self.lost_pairs += 1
            return None
        shift = float(np.percentile(shifts, 95))
        self.pairs += 1
        self.fast_pairs += shift > 1.0
        self.largest_px = max(self.largest_px, shift)
        return shift

    def _whole(self, cross: npt.NDArray[np.complex128]) -> npt.NDArray[np.int64]:
        """Return the shift ``[n, 2]`` of each block in whole pixels, down and right, by its cross spectrum."""
        size = np.abs(cross)
        peaks = np.fft.irfft2(
            cross / np.sqrt(size + 1e-9 * size.max(axis=(1, 2), keepdims=True) + 1e-30), s=self._sides
        )
        at = peaks.reshape(len(peaks), -1).argmax(axis=1)
        sides = np.array(self._sides)
        shift = np.stack([at // sides[1], at % sides[1]], axis=1)
        return np.asarray((shift + sides // 2) % sides - sides // 2)

    def _rest(self, before: FloatArray, after: FloatArray) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Return by how much less than a pixel blocks moved, ``[n, 2]``, and their correlation ``[n]``."""
        if min(self._sides) < 2 or not len(before):
            return np.zeros((len(before), 2)), np.zeros(len(before))
        window = self._window

        def total(*factors: FloatArray) -> npt.NDArray[np.float64]:
            product = window * factors[0]
            for factor in factors[1:]:
                product *= factor
            return np.asarray(product.sum(axis=(1, 2)), np.float64)

        # Contrast may change, with the light for one.
        first, second = (block / (block.std(axis=(1, 2), keepdims=True) + _NOTHING) for block in (before, after))
        down, right = np.gradient((first + second) / 2, axis=(1, 2))
        change = first - second
        dd, dr, rr = total(down, down), total(down, right), total(right, right)
        # An edge tells nothing of motion along it, which is taken as none.
        ridge = 1e-3 * (dd + rr) + 1e-30
        d, r = total(down, change), total(right, change)
        share = (dd + ridge) * (rr + ridge) - dr * dr
        left = np.stack([(rr + ridge) * d - dr * r, (dd + ridge) * r - dr * d], axis=1) / share[:, None]
        alike = total(first, second) / np.sqrt(total(first, first) * total(second, second) + _NOTHING)
        return np.clip(left, -1, 1), alike


def _log_blocks(picture: FloatArray, corners: npt.NDArray[np.int64], sides: tuple[int, int]) -> FloatArray:
    """Return the blocks at ``corners`` as log light less its mean ``[n, h, w]``, smoothed as gradients want it."""
    blocks = np.empty((len(corners), *sides), np.float32)
    for block, (y, x) in zip(blocks, corners, strict=True):
        block[...] = picture[y : y + sides[0], x : x + sides[1]]
    # What is no number is dark, and what is infinite is bright: neither is of use, nor shall it spread.
    np.minimum(np.fmax(blocks, _DARKEST, out=blocks), _BRIGHTEST, out=blocks)
    np.log(blocks, out=blocks)
    blocks -= blocks.mean(axis=(1, 2), keepdims=True)
    for axis in (1, 2):
        if blocks.shape[axis] > 2:
            middle = np.moveaxis(blocks, axis, 0)
            middle[1:-1] = (middle[:-2] + 2 * middle[1:-1] + middle[2:]) / 4
    return blocks
