"""Host side of guards.py: where the boxes are, and how long they hold."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.render.upload_arrays import write

_MOST_GUARDS = 16
"""Boxes that each ray is compared with; of more things several share one."""
_ROOM = 0.05
"""Room on each side, as a share of a thing's largest extent."""
_STEPS_AHEAD = 16.0
"""Steps of a thing by which its box reaches ahead at most …"""
_LEAST_AHEAD = 2.0
"""… and at least: in between by its own extent."""

_F64 = npt.NDArray[np.float64]


class Guards:
    """The boxes, on a device.

    While all things stay in theirs, a ray that leads through none meets what it met before. Once one leaves its box,
    all get new ones, of the next generation, and nothing is known of any ray.

    Attributes:
        generation: which boxes hold now, counted from 1.
    """

    def __init__(self, things: int, geometry: Any, device: Any) -> None:
        """Make room for boxes of so many things in the kernel's ``geometry``."""
        self.generation = 0
        count = min(things, _MOST_GUARDS)
        self._first = np.arange(count) * things // max(count, 1)
        self._device_boxes: Any = wp.zeros(max(2 * count, 1), dtype=wp.vec3, device=device)
        geometry.guards, geometry.guard_count = self._device_boxes, count
        self._boxes = self._last = np.zeros((2, count, 3))

    def follow(self, lowers: _F64, uppers: _F64) -> None:
        """Go on to where things are now: their boxes ``[n, 3]``, from the scene's origin."""
        if not len(self._first):
            self.generation = 1
            return
        now = np.stack([np.minimum.reduceat(lowers, self._first), np.maximum.reduceat(uppers, self._first)])
        stay = self.generation > 0 and np.all(now[0] >= self._boxes[0]) and np.all(now[1] <= self._boxes[1])
        if not stay:
            self._boxes = self._around(now, now - self._last if self.generation > 0 else np.zeros_like(now))
            self.generation += 1
            rows = self._boxes.swapaxes(0, 1).reshape(-1, 3).astype(np.float32)
            write(self._device_boxes, rows)
        self._last = now

    def _around(self, now: _F64, step: _F64) -> _F64:
        """Return boxes around those, and around where they are some steps later."""
        extent = (now[1] - now[0]).max(axis=1)
        length = np.maximum(np.abs(step).max(axis=(0, 2)), 1e-12)
        ahead = np.clip(extent / length, _LEAST_AHEAD, _STEPS_AHEAD)
        there = now + ahead[:, None] * step
        room = _ROOM * extent[:, None] + 1e-5 * (1 + np.abs(now).max(axis=(0, 2)))[:, None]
        return np.stack([np.minimum(now[0], there[0]) - room, np.maximum(now[1], there[1]) + room])
