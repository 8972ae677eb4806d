"""How many samples pixels get: what may change from frame to frame, and what is kept between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from clsim.errors import InputError
from clsim.frames import DELAY, InterestBoard, InterestMap
from clsim.render.steered import LEAST_LOOK, Steering

NEAR = 0.1
"""Pixels within this share of the contrast threshold are near to an event."""
_AHEAD = DELAY + 0.5
"""Steps by which a change is drawn out, from the map's frame to half a step beyond the one that is rendered."""


@dataclass(frozen=True)
class Effort:
    """How much is spent on a pixel of a frame.

    Attributes:
        spp: paths where an event is near.
        probe_spp: paths elsewhere, at most ``spp``; with common random numbers the first of them.
        first_hit_rays: rays that look for the first hit alone, so many where a pixel shows more than one thing.
        every: a pixel that is not near an event is probed in each so many-th frame, in turn with its neighbours.
    """

    spp: int
    probe_spp: int
    first_hit_rays: int
    every: int = 1

    def __post_init__(self) -> None:
        """Refuse values that cannot work, in the command line's spelling."""
        if not 1 <= self.probe_spp <= self.spp:
            raise InputError(f"--probe-spp must be from 1 to --spp, which is {self.spp}, got {self.probe_spp}")
        if self.first_hit_rays < 1:
            raise InputError(f"--first-hit-rays must be at least 1 here, got {self.first_hit_rays}")
        if self.every < 1:
            raise InputError(f"every must be at least 1, got {self.every}")


class Steerer:
    """Decides from interest maps which pixels of a frame get how many samples, and counts what they got.

    Attributes:
        effort: what holds from the next frame on; may be set from any thread.
        first_hit_rays: first-hit rays traced so far.
        paths: paths traced so far.
    """

    def __init__(self, width: int, height: int, effort: Effort, board: InterestBoard | None, device: Any) -> None:
        """Allocate what is kept from frame to frame."""
        pixels = width * height
        self.effort = effort
        self.first_hit_rays = self.paths = 0
        self._device = device
        self._board = board
        self._number = 0
        self._index = -1
        self._before = effort.probe_spp
        self._near = np.zeros((height, width), dtype=np.uint8)
        self._padded = np.zeros((height + 2, width + 2), dtype=bool)
        self._device_near: Any = wp.zeros(pixels, dtype=wp.uint8, device=device)
        self._irradiance: Any = wp.zeros(pixels, dtype=wp.vec3, device=device)
        self._correction: Any = wp.zeros(pixels, dtype=wp.vec3, device=device)
        self._offset: Any = wp.zeros(pixels, dtype=wp.vec3, device=device)
        self._full_samples: Any = wp.zeros(pixels, dtype=wp.int32, device=device)
        self._spent: Any = wp.zeros((2, pixels), dtype=wp.int32, device=device)

    @property
    def kept(self) -> tuple[Any, ...]:
        """The arrays of the kernel, from ``near`` to ``full_samples``."""
        return self._device_near, self._irradiance, self._correction, self._offset, self._full_samples

    @property
    def spent(self) -> Any:
        """The array ``out_spent`` of the kernel."""
        return self._spent

    def prepare(self, index: int) -> tuple[Any, int]:
        """Choose the samples of the frame ``index``; return the kernel's ``steering`` and the full number of paths.

        Waits for the interest map of two frames ago.
        """
        effort = self.effort
        steering: Any = Steering()
        steering.first_hits = effort.first_hit_rays
        steering.first_look = min(max(LEAST_LOOK, effort.first_hit_rays // 4), effort.first_hit_rays)
        steering.every, steering.turn = effort.every, self._number
        steering.probe = effort.probe_spp
        if index <= self._index or self._number == 0:
            # Nothing that was kept tells of this frame.
            self._before = effort.probe_spp
            self._near.fill(1)
            self._offset.zero_()
            self._full_samples.zero_()
        else:
            # Where all get the same there is nothing to ask, and maybe nobody who answers.
            board = self._board if effort.probe_spp < effort.spp or effort.every > 1 else None
            interest = None if board is None else board.find(self._number)
            if interest is None:
                self._near.fill(0)
            else:
                self._mark(interest)
        wp.copy(self._device_near, wp.array(self._near.reshape(-1), dtype=wp.uint8, device="cpu", copy=False))
        steering.before = self._before
        self._before, self._index = effort.probe_spp, index
        self._number += 1
        return steering, effort.spp

    def count(self) -> None:
        """Add up what the frame took."""
        first_hit_rays, paths = self._spent.numpy().sum(axis=1, dtype=np.int64)
        self.first_hit_rays += int(first_hit_rays)
        self.paths += int(paths)

    def _mark(self, interest: InterestMap) -> None:
        """Mark the pixels that may reach a threshold by now, and their neighbours, for detectors look around too."""
        zone = 0.5 * NEAR * (interest.to_on + interest.to_off)
        rise = _AHEAD * interest.change
        far = (interest.to_on - np.maximum(rise, 0) > zone) & (interest.to_off + np.minimum(rise, 0) > zone)
        # A pixel without a reference is not far, whatever NaN compares to.
        np.logical_not(far, out=self._padded[1:-1, 1:-1])
        rows = self._padded[:-2] | self._padded[1:-1] | self._padded[2:]
        np.copyto(self._near, rows[:, :-2] | rows[:, 1:-1] | rows[:, 2:])
