"""Truth as pictures: depth, flow by a colour wheel, objects by colours of their own."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

RGB = npt.NDArray[np.uint8]
Shown = Literal["image", "depth", "flow", "ids"]
CAPTIONS: dict[Shown, str] = {
    "image": "recorded frame",
    "depth": "recorded depth: near is light",
    "flow": "recorded flow: red to the right, green down, white at rest",
    "ids": "recorded objects",
}
"""What pictures of each sort are, and how to read their colours."""
_NEAR_TO_FAR = ("fff3b8", "fdae61", "e34a6f", "7b2d8e", "1d1147", "05030f")
_PERCENTILES = (2.0, 98.0)
_GOLDEN = 0.6180339887498949


class DepthPicture:
    """Near is light, far is dark, evenly in 1 / depth; the first picture sets the range, and black is nothing."""

    def __init__(self) -> None:
        """Start without a range."""
        stops = np.array([[int(text[i : i + 2], 16) for i in (0, 2, 4)] for text in _NEAR_TO_FAR], float)
        at = np.linspace(0.0, len(stops) - 1.0, 256)
        self._table = np.stack([np.interp(at, np.arange(len(stops)), stops[:, c]) for c in range(3)], axis=1)
        self._range: tuple[float, float] | None = None

    def __call__(self, depth_m: npt.NDArray[Any]) -> RGB:
        """Return the picture ``[H, W, 3]`` of depths ``[H, W]``."""
        seen = np.isfinite(depth_m) & (depth_m > 0)
        inverse = np.where(seen, 1.0 / np.where(seen, depth_m, 1.0), 0.0)
        if self._range is None and seen.any():
            low, high = np.percentile(inverse[seen], _PERCENTILES)
            self._range = float(low), max(float(high), float(low) * (1 + 1e-6))
        low, high = self._range or (0.0, 1.0)
        far = 1.0 - np.clip((inverse - low) / (high - low), 0.0, 1.0)
        picture = self._table[np.rint(255 * far).astype(int)]
        return np.where(seen[..., None], picture, 0).astype(np.uint8)


class FlowPicture:
    """Direction is hue, right being red and down green; the length is how strong the colour is, white at rest.

    Where a point is not seen at both ends the colour is darker; black is not known. The first picture sets the range.
    """

    def __init__(self) -> None:
        """Start without a range."""
        self._reach_px: float | None = None

    def __call__(self, flow: npt.NDArray[Any], valid: npt.NDArray[Any], covisible: npt.NDArray[Any]) -> RGB:
        """Return the picture ``[H, W, 3]`` of flow ``[H, W, 2]``."""
        known = valid > 0
        lengths = np.hypot(flow[..., 0], flow[..., 1])
        if self._reach_px is None and known.any():
            self._reach_px = max(float(np.percentile(lengths[known], _PERCENTILES[1])), 1e-3)
        strength = np.clip(lengths / (self._reach_px or 1.0), 0.0, 1.0)
        hue = np.mod(np.arctan2(flow[..., 1], flow[..., 0]) / (2 * np.pi), 1.0)
        picture = from_hue(hue, strength) * np.where(covisible > 0, 255.0, 140.0)[..., None]
        return np.where(known[..., None], picture, 0).astype(np.uint8)


def ids_picture(numbers: npt.NDArray[Any]) -> RGB:
    """Return ``[H, W, 3]``: each number has a colour of its own, 0 is black."""
    hue = np.mod(numbers * _GOLDEN, 1.0)
    strong = 0.45 + 0.4 * np.mod(numbers * _GOLDEN**2 * 3, 1.0)
    return np.where(numbers[..., None] > 0, 255 * from_hue(hue, strong), 0).astype(np.uint8)


def from_hue(hue: npt.NDArray[Any], strength: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """Return red, green and blue ``[…, 3]``, 0 … 1, of hue and saturation, 0 … 1, at full value."""
    steps = np.stack([hue * 6.0 + shift for shift in (0.0, 4.0, 2.0)], axis=-1)
    pure = np.clip(np.abs(np.mod(steps, 6.0) - 3.0) - 1.0, 0.0, 1.0)
    return np.asarray(1.0 - strength[..., None] * (1.0 - pure), np.float64)


def recorded_pictures(name: str, shown: Shown) -> Iterator[tuple[int, RGB]]:
    """Yield times [µs] and pictures ``[H, W, 3]`` of a recording with truth; none where it has none of that sort."""
    from clsim.truth.recording import read_recording
    from clsim.truth.writing.images import Pictures

    depth_picture, flow_picture, pictures = DepthPicture(), FlowPicture(), Pictures()
    for shot in read_recording(name).shots():
        planes = shot.planes
        if shown == "depth" and "depth" in planes:
            yield shot.time_us, depth_picture(planes["depth"])
        elif shown == "flow" and "flow" in planes:
            flow = planes["flow"]
            yield shot.time_us, flow_picture(flow[..., :2], flow[..., 2], flow[..., 3])
        elif shown == "ids" and "object" in planes:
            yield shot.time_us, ids_picture(planes["object"])
        elif shown == "image" and (image := pictures.of(planes)) is not None:
            yield shot.time_us, np.repeat(image[..., None], 3, axis=2)
