"""From radiance to 8 bits, with an exposure that follows the scene slowly."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from clsim.frames.frame import FloatArray

_STEPS = 4096
_PERCENTILE = 95.0
_WHITE_AT = 0.8
_FOLLOW = 0.2


def _srgb_table() -> npt.NDArray[np.uint8]:
    linear = np.linspace(0.0, 1.0, _STEPS)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    table: npt.NDArray[np.uint8] = np.rint(255 * encoded).astype(np.uint8)
    return table


class ToneMap:
    """Maps linear values so that their 95th percentile becomes a bright 0.8, then encodes sRGB (IEC 61966-2-1)."""

    def __init__(self, follow: float = _FOLLOW) -> None:
        """Start without an exposure: the first image that is not black sets it.

        ``follow`` is how much of the way to its own exposure each later image goes; 0 keeps the first.
        """
        self.exposure: float | None = None
        self._table = _srgb_table()
        self._follow = follow

    def __call__(self, linear: FloatArray) -> npt.NDArray[np.uint8]:
        """Return an image ``[H, W, C]`` of 8 bits; values that are no numbers become black."""
        bright = linear.max(axis=2)
        finite = bright[np.isfinite(bright)]
        level = float(np.percentile(finite, _PERCENTILE)) if finite.size else 0.0
        if level > 0.0:
            wanted = _WHITE_AT / level
            self.exposure = (
                wanted if self.exposure is None else self.exposure * (wanted / self.exposure) ** self._follow
            )
        scaled = np.nan_to_num(linear * (self.exposure or 0.0), nan=0.0, posinf=1.0, neginf=0.0)
        image: npt.NDArray[np.uint8] = self._table[(np.clip(scaled, 0.0, 1.0) * (_STEPS - 1)).astype(np.intp)]
        return image


def brightness_image(level: FloatArray) -> FloatArray:
    """Return the luminance ``[H, W, 1]``, up to a factor, of brightness in natural-log units ``[H, W]``."""
    luminance: FloatArray = np.exp(np.minimum(level, 80.0))[..., np.newaxis]
    return luminance
