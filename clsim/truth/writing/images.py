"""Pictures of 8 bits, as most data sets have them, of linear luminance."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.frames.tonemap import ToneMap


class Pictures:
    """Encodes luminance as sRGB, with one exposure for all frames: that of the first that is not black."""

    def __init__(self) -> None:
        """Start without an exposure."""
        self._tone_map = ToneMap(follow=0.0)

    def of(self, planes: Mapping[str, npt.NDArray[Any]]) -> npt.NDArray[np.uint8] | None:
        """Return the picture ``[H, W]`` of a frame: its ``image``, or its ``intensity`` encoded; None without."""
        if "image" in planes:
            return planes["image"].astype(np.uint8)
        if "intensity" not in planes:
            return None
        picture: npt.NDArray[np.uint8] = self._tone_map(planes["intensity"][..., None])[..., 0]
        return picture


def with_images(names: Collection[str]) -> set[str]:
    """Return the names of what is asked for, with ``image`` where there is luminance to make it of."""
    return {*names, *(("image",) if "intensity" in names else ())}
