"""From events to images: signed sums over a window, or sums that fade with age."""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from clsim.events import EventBatch, Labels, empty_batch
from clsim.live.view.colormaps import CAUSE_LEVELS, ZERO

FloatImage = npt.NDArray[np.float64]
IndexImage = npt.NDArray[np.uint8]


def signed_image(
    events: EventBatch, width: int, height: int, *, end_us: int = 0, decay_us: float | None = None
) -> FloatImage:
    """Sum the events of each pixel, ON as +1 and OFF as −1; returns ``[H, W]``.

    With ``decay_us``, an event of age a = end_us − t weighs exp(−a / decay_us) instead of 1.
    """
    weights = np.where(events["on"], 1.0, -1.0)
    if decay_us is not None:
        weights *= np.exp((events["t"] - end_us) / decay_us)
    pixels = events["y"].astype(np.intp) * width + events["x"]
    image: FloatImage = np.bincount(pixels, weights, minlength=width * height).reshape(height, width).astype(np.float64)
    return image


def colour_indices(image: npt.NDArray[np.floating], full: float) -> IndexImage:
    """Map −full … full to the indices 1 … 255 of a colour map, 0 to the one that means nothing; clips beyond."""
    indices: IndexImage = (ZERO + np.rint(np.clip(image / full, -1.0, 1.0) * 127)).astype(np.uint8)
    return indices


def cause_indices(
    events: EventBatch, width: int, height: int, full: float, *, end_us: int = 0, decay_us: float | None = None
) -> IndexImage:
    """Return indices ``[H, W]`` of the colour map of causes, for events that have them.

    The colour is that of each pixel's newest event, and the more events there are, the stronger it is; ``full`` of them
    make the strongest. ``decay_us`` is as in `signed_image`.
    """
    weights = np.ones(len(events)) if decay_us is None else np.exp((events["t"] - end_us) / decay_us)
    pixels = events["y"].astype(np.intp) * width + events["x"]
    sums = np.bincount(pixels, weights, minlength=width * height)
    causes = np.zeros(width * height, np.uint8)
    causes[pixels] = events["cause"]  # of several events of a pixel, the last is kept
    levels = np.rint(np.minimum(sums / full, 1.0) * (CAUSE_LEVELS - 1))
    indices: IndexImage = (CAUSE_LEVELS * causes + levels.astype(np.uint8)).reshape(height, width)
    return indices


class EventWindow:
    """The newest events of a stream, as far back as the last question needed them."""

    def __init__(self, labels: Labels = ()) -> None:
        """Hold nothing; events will have fields for ``labels``."""
        self._labels = labels
        self._batches: deque[EventBatch] = deque()

    def push(self, batch: EventBatch) -> None:
        """Append a batch; it is kept, so it must not be reused."""
        if len(batch):
            self._batches.append(batch)

    def select(self, begin_us: int, end_us: int) -> EventBatch:
        """Return the events with begin ≤ t < end, and forget all before ``begin_us``."""
        while self._batches and self._batches[0]["t"][-1] < begin_us:
            self._batches.popleft()
        parts = []
        for batch in self._batches:
            if batch["t"][0] >= end_us:
                break
            low, high = np.searchsorted(batch["t"], (begin_us, end_us))
            parts.append(batch[low:high])
        return np.concatenate(parts) if parts else empty_batch(0, self._labels)
