"""Frames in which nothing has moved: each is the one before it, and need not be rendered."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from clsim.render.motion.deform import deforms
from clsim.scene import Camera, World

_SETTLED = 3
"""Frames in a row, all alike, that are rendered: light that followed what moved comes to rest after it. Before anything
has moved the first one will do."""
_ROUNDING = 1e-14
"""Part of a pose by which it may differ, as one between two equal keys does, and be the same."""
_F32 = npt.NDArray[np.float32]
_F64 = npt.NDArray[np.float64]


def have_moved(before: _F64, now: _F64) -> npt.NDArray[np.bool_]:
    """Return which of some poses ``[..., 4, 4]`` have changed by more than a rounding."""
    return np.asarray(np.any(np.abs(now - before) > _ROUNDING * (1.0 + np.abs(before)), axis=(-2, -1)))


class Standstill:
    """Remembers a frame from which on nothing has moved, as the next ones show the same."""

    def __init__(self, world: World, camera: Camera) -> None:
        """Know no frame of a world as a camera sees it."""
        # The world's own camera is the first of all that moves.
        self._motions = [each for each in (camera.motion, *world.motions()[1:]) if each.duration_s > 0]
        self._changes = world.light_changes() or any(deforms(mesh) for mesh in world.meshes)
        self._half_s = 0.5 * camera.shutter_s
        self._poses: list[_F64 | None] = [None] * len(self._motions)
        self._effort: object = None
        self._alike, self._settled = 0, 1
        self._begun = False
        self._planes: _F32 = np.zeros(0, np.float32)

    def repeat(self, time_s: float, effort: object, out: _F32) -> bool:
        """Fill the planes ``out`` of the frame of a time [s] with those of the last one, if they are the same.

        ``effort`` is what is spent on a frame. Return whether they are; else they are rendered, and told to `remember`.
        """
        if self._changes:
            return False
        if (not self._stands(time_s) or effort != self._effort) and self._begun:
            self.forget()
        self._begun, self._effort = True, effort
        if self._alike == self._settled:
            np.copyto(out, self._planes)
        return self._alike == self._settled

    def remember(self, planes: _F32) -> None:
        """Take notice of a frame that was rendered, whole."""
        if self._changes:
            return
        self._alike += 1
        if self._alike == self._settled:
            self._planes = planes.copy()

    def forget(self) -> None:
        """Know no frame: something, or light, has changed."""
        self._alike, self._settled = 0, _SETTLED

    def _stands(self, time_s: float) -> bool:
        """Whether all is where it was when this was asked last; false where that is not known."""
        exposed_s = (time_s - self._half_s, time_s, time_s + self._half_s) if self._half_s else (time_s,)
        known = True
        for k, motion in enumerate(self._motions):
            now, before = np.array([motion.pose(at_s) for at_s in exposed_s]), self._poses[k]
            self._poses[k] = now
            known = known and before is not None
            if before is not None and have_moved(before, now).any():
                # A pose takes as long as many rays: the others are not asked for now. Later they are compared with
                # where they were then; a wrong answer of one frame does no harm, as several must be alike.
                return False
        return known
