"""A straight edge that moves evenly over the picture: what each pixel sees, and when it fires, in closed form.

A pixel is a square over which brightness is averaged. The share of it that an edge has passed is a clipped area; along
the edge's normal it is the distribution function of a sum of uniform numbers, one for each side of the square and one
for the ramp, if the edge has one. All is float64; nothing is sampled.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from clsim.events import EVENT_DTYPE, EventBatch

F64 = npt.NDArray[np.float64]

_NARROW_PX = 1e-4
"""Sides that seem narrower along the normal count as none: their powers would cancel."""
_HALVINGS = 60
"""Bisections of a share: more than float64 can tell apart."""


@dataclass(frozen=True)
class Edge:
    """A line in the picture, in pixels right and down from its upper left corner, that moves along its normal.

    Attributes:
        normal: unit vector (right, down) that points to where the edge goes.
        offset_px: distance of the edge from that corner along the normal, at time 0.
        speed_px_s: along the normal, more than 0.
        behind, ahead: luminance on both sides.
        ramp_px: width along the normal over which one luminance goes to the other, linearly; 0 is a hard edge.
    """

    normal: tuple[float, float]
    offset_px: float
    speed_px_s: float
    behind: float
    ahead: float
    ramp_px: float = 0.0

    def distances(self, width: int, height: int) -> F64:
        """Return how far from the corner the pixels' centres are along the normal, ``[H, W]`` [px]."""
        down, right = np.mgrid[:height, :width] + 0.5
        return np.asarray(self.normal[0] * right + self.normal[1] * down)

    def share(self, passed_px: F64) -> F64:
        """Return the share of pixels that is behind the edge, which has passed their centres by ``passed_px``.

        The distribution function of a sum of n uniform numbers of widths w: Σ ± max(s ± w₁/2 ± … ± wₙ/2, 0)ⁿ / (n! Πw).
        """
        widths = [w for w in (abs(self.normal[0]), abs(self.normal[1]), self.ramp_px) if w > _NARROW_PX]
        total = np.zeros_like(passed_px)
        for signs in itertools.product((1, -1), repeat=len(widths)):
            corner = passed_px + sum(sign * w / 2 for sign, w in zip(signs, widths, strict=True))
            total += math.prod(signs) * np.maximum(corner, 0.0) ** len(widths)
        return np.asarray(np.clip(total / (math.factorial(len(widths)) * math.prod(widths)), 0.0, 1.0))

    def luminance(self, width: int, height: int, time_s: float) -> F64:
        """Return what the pixels see at a time, ``[H, W]``."""
        passed = self.offset_px + self.speed_px_s * time_s - self.distances(width, height)
        return np.asarray(self.ahead + (self.behind - self.ahead) * self.share(passed))

    def passed_px(self, share: F64) -> F64:
        """Return how far the edge has passed the centre of a pixel of which it has passed a share between 0 and 1."""
        reach = (abs(self.normal[0]) + abs(self.normal[1]) + self.ramp_px) / 2
        low, high = np.full_like(share, -reach), np.full_like(share, reach)
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            below = self.share(middle) < share
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return np.asarray((low + high) / 2)

    def events(self, width: int, height: int, duration_s: float, threshold: float) -> EventBatch:
        """Return the events of an ideal camera that starts at time 0, in order of time.

        A pixel fires each time the logarithm of its luminance has changed by ``threshold`` more since time 0.
        """
        first, last = (self.luminance(width, height, t).ravel() for t in (0.0, duration_s))
        count = np.floor(np.abs(np.log(last / first)) / threshold).astype(np.int64)
        pixel = np.repeat(np.arange(width * height), count)
        nth = np.arange(len(pixel)) - np.repeat(np.cumsum(count) - count, count) + 1
        on = self.behind > self.ahead
        luminance = first[pixel] * np.exp((1 if on else -1) * nth * threshold)
        passed = self.passed_px((luminance - self.ahead) / (self.behind - self.ahead))
        time_s = (passed + self.distances(width, height).ravel()[pixel] - self.offset_px) / self.speed_px_s
        order = np.argsort(time_s, kind="stable")
        batch = np.empty(len(pixel), EVENT_DTYPE)
        batch["t"], batch["on"] = np.rint(1e6 * time_s[order]), on
        batch["y"], batch["x"] = np.divmod(pixel[order], width)
        return batch
