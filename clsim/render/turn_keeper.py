"""Host side of in_turn.py: what is kept of paths, and how many are traced again."""

from __future__ import annotations

from collections import deque
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.frames import DELAY, InterestBoard, InterestMap
from clsim.render.effort import Effort, MapReader, Sight, largest_around, looks_of
from clsim.render.guard_keeper import Guards
from clsim.render.in_turn import LIT, PLANES, Turns
from clsim.render.light_layers import LAYERS, Layer, Lit, Row

_QUIET, _CHANGES, _ALL = 0, 1, 2
"""Grades of pixels (`make_in_turn`)."""
_FIRST = 4
"""Times the paths of a pixel whose light changes that the first frame traces …"""
_FRAMES_A_PATH = 2
"""… and frames in which each pixel then gets one more."""
_REACH = ((16, 5), (1 << 30, 3))
"""Paths that are kept of a pixel, at most, and how far around it takes its light [pixels]."""
_SOON_S = 1 / 6
"""Light is quiet where brightness takes longer than this to change by the contrast threshold [s].

Not so many frames: more frames a second would make all light quiet, and times no better.
"""


def weights_around(kept: int) -> npt.NDArray[np.float32]:
    """Return the weights of the pixels of a row or column around one in whose light it is seen, where so many paths of
    each are kept; σ is half the reach.
    """
    reach = next(pixels for most, pixels in _REACH if kept <= most)
    steps = np.arange(-reach, reach + 1)
    return np.exp(-(steps**2) / (2 * (reach / 2) ** 2)).astype(np.float32)


class TurnKeeper(MapReader):
    """Keeps what each path of each pixel found last, and decides how many are traced again.

    The number of paths that are kept is that of the first effort; ``probe_spp`` of them are traced again where light
    changes, and one in every n-th frame elsewhere. What first-hit rays saw is kept as long as the guards let it.
    """

    def __init__(
        self,
        width: int,
        height: int,
        effort: Effort,
        sight: Sight,
        board: InterestBoard | None,
        guards: Guards | None,
        look_again: int,
        device: Any,
    ) -> None:
        """Allocate what is kept from frame to frame; without ``guards`` each frame looks at all pixels.

        ``look_again`` is `RenderOptions.look_again`.
        """
        super().__init__(width, height, effort, sight, board, device)
        pixels = width * height
        again = -(-pixels // look_again) if look_again else 0
        self._guards = guards
        self._rays = self._known = self._first = 0
        self._kept = effort.spp
        self._times_us: deque[int] = deque(maxlen=DELAY + 2)
        kept = (pixels, effort.spp)
        kinds: dict[str, tuple[Any, Any]] = {
            "grades": (pixels, wp.uint8),
            "light": (kept, wp.vec3),
            "marks": (kept, wp.int32),
            "layers": ((pixels, LAYERS), Layer),
            "rows": ((pixels, LAYERS), Row),
            "traced": (pixels, wp.int32),
            "lit": ((pixels + again, LIT), Lit),
            "lit_things": (pixels + again, wp.int32),
            "shown": ((PLANES, pixels + again), wp.float32),
            "seen_in": (pixels + again, wp.int32),
            "corner_seen_in": ((width + 1) * (height + 1), wp.int32),
        }
        self._arrays: dict[str, Any] = {
            name: wp.zeros(size, dtype=kind, device=device) for name, (size, kind) in kinds.items()
        }
        self._arrays["weights"] = wp.array(weights_around(effort.spp), dtype=wp.float32, device=device)
        self._seen_twice: Any = wp.zeros((2, max(again, 1)), dtype=wp.float32, device=device)

    @property
    def arguments(self) -> dict[str, Any]:
        """What the kernel takes beside the scene and the frame; ``steering`` changes with each frame."""
        return {
            "steering": Turns(),
            "summing": False,
            "lighting": False,
            "again": 0,
            "out_spent": self._spent,
            "out_twice": self._seen_twice,
        } | self._arrays

    def prepare(self, index: int, time_us: int) -> tuple[dict[str, Any], int]:
        """Choose the paths of the frame ``index``; return arguments of the kernel and how many paths are kept.

        Whenever it is, this takes the interest map of two frames ago, and waits for it where the board does.
        """
        effort = self.effort
        self._times_us.append(time_us)
        steering: Any = Turns()
        steering.looks = looks_of(effort.first_hit_rays, self._sight)
        steering.every, steering.turn = effort.every, self._number + 1
        if index <= self._index or self._anew:
            # Nothing that was kept tells of this frame.
            self._grades.fill(_ALL)
            self._clear("light", "marks", "layers", "traced", "seen_in", "corner_seen_in")
            steering.known = self._known = self._first = min(_FIRST * effort.probe_spp, self._kept)
        else:
            interest = None if self._board is None else self._board.find(self._number)
            steering.known = self._known
            steering.more = int(self._known < self._kept and self._number % _FRAMES_A_PATH == 1)
            self._known += steering.more
            self._grades.fill(_QUIET)
            if interest is not None:
                self._grade(interest)
        steering.probe = min(effort.probe_spp, steering.known)
        steering.worth = self._first / self._known
        if effort.first_hit_rays != self._rays:
            self._clear("seen_in", "corner_seen_in")
        self._rays = effort.first_hit_rays
        if self._guards is not None:
            steering.generation = self._guards.generation
        grades = self._grades.reshape(-1)
        wp.copy(self._arrays["grades"], wp.array(grades, dtype=wp.uint8, device="cpu", copy=False))
        self._index, self._anew = index, False
        self._number += 1
        return {"steering": steering, "summing": False, "lighting": False, "again": 0}, self._kept

    @property
    def seen_twice(self) -> npt.NDArray[np.float32]:
        """Luminance of every n-th pixel ``[2, n]``, as two looks at the last frame saw it."""
        return cast("npt.NDArray[np.float32]", self._seen_twice.numpy())

    def forget(self) -> None:
        """Trace all paths in the next frame, and keep nothing of earlier ones: the light is another one."""
        self._anew = True

    def _clear(self, *names: str) -> None:
        for name in names:
            self._arrays[name].zero_()

    def _grade(self, interest: InterestMap) -> None:
        """Trace more where brightness will soon have changed by the threshold, and around."""
        threshold = 0.5 * (interest.to_on + interest.to_off)
        # The map's frame is `DELAY` frames ago, and its change since the one before that.
        step_s = (self._times_us[1] - self._times_us[0]) * 1e-6
        changes = np.abs(interest.change) * _SOON_S > threshold * step_s
        np.copyto(self._grades, largest_around(changes, self._padded))
