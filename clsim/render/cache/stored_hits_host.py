"""Host side of stored_hits.py: when what pixels saw in the last frame may be seen again."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.render.cache.path_store import PathStore
from clsim.render.cache.stored_hits import MOST_STORED, StoredHits, StoredPixel, StoredSurface
from clsim.render.device.arrays import array
from clsim.render.features.scene_lamps import LampBoxes
from clsim.render.motion.standstill import have_moved
from clsim.scene import World

_FEW = 0.25
"""Share of pixels that must see again what they saw; where fewer do, to store it is not worth its time …"""
_PAUSE = 16
"""… and it is tried again after so many frames."""


class LitScene(Protocol):
    """A scene on a device, as far as stored hits need it."""

    world: World
    origin_m: npt.NDArray[np.float64]
    light_changes: bool
    device: Any


class StoredHitsHost:
    """Stores what the pixels of a camera see, once it stands.

    What it remembers are attributes, and not parts of the kernel's argument, so that a snapshot finds them.
    """

    def __init__(self, data: LitScene, pixels: int) -> None:
        """Store nothing yet of so many pixels, which see a scene."""
        self._data, self._count = data, pixels
        self._lamps = LampBoxes(data.world)
        self._pose: npt.NDArray[np.float64] | None = None
        self._effort: object = None
        self._is_full = self._reads = self._writes = False
        self._pause = 0
        self._pixels: Any = None
        self._surfaces: Any = None
        self._lamp_lower: Any = None
        self._lamp_upper: Any = None
        self._lamp_is_far: Any = None

    def forget(self) -> None:
        """Sample all pixels anew: light has changed."""
        self._is_full = False

    def prepare(self, pose: npt.NDArray[np.float64], time_s: float, effort: object, store: PathStore) -> Any:
        """Return the `StoredHits` of a frame that is seen, once ``store`` knows what has moved since the last one.

        Args:
            pose: where the camera is ``[4, 4]``.
            time_s: when that is [s].
            effort: what is spent on a pixel.
            store: paths that follow the light.
        """
        stands = self._pose is not None and not have_moved(self._pose, pose)
        writes = stands and not self._data.light_changes and self._pause == 0
        self._pause = max(0, self._pause - 1)
        self._reads = writes and self._is_full and effort == self._effort and not store.lamps_moved
        self._pose, self._effort, self._writes = pose, effort, writes
        self._is_full = False  # until the frame is done
        hits: Any = StoredHits()
        if writes:
            if not self._reads:
                self._begin(time_s)
            hits.reads, hits.writes, hits.moved = self._reads, True, store.moved
            hits.eye = wp.vec3(*(pose[:3, 3] - self._data.origin_m))
            hits.lamp_lower, hits.lamp_upper = self._lamp_lower, self._lamp_upper
            hits.lamp_is_far, hits.lamps = self._lamp_is_far, len(self._lamp_is_far)
            hits.pixels, hits.surfaces = self._pixels, self._surfaces
        return hits

    def finish(self, sampled: int) -> None:
        """Take notice of a frame that is done, and how many pixels were sampled."""
        self._is_full = self._writes
        if self._reads and self._count - sampled < _FEW * self._count:
            self._pause = _PAUSE

    def _begin(self, time_s: float) -> None:
        """Make room, and note where lamps are."""
        device = self._data.device
        if self._pixels is None:
            self._pixels = wp.zeros(self._count, dtype=StoredPixel, device=device)
            self._surfaces = wp.zeros((self._count, MOST_STORED), dtype=StoredSurface, device=device)
        lower, upper, is_far = self._lamps.at(time_s, self._data.origin_m)
        self._lamp_lower, self._lamp_upper = (array(c.astype(np.float32), wp.vec3, device) for c in (lower, upper))
        self._lamp_is_far = array(is_far, wp.bool, device)
