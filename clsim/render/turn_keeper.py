"""Host side of in_turn.py: what is kept of paths, and how many are traced again."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.frames import InterestBoard, InterestMap
from clsim.render.effort import STILL, Effort, MapReader, Sight, largest_around, looks_of
from clsim.render.guard_keeper import Guards
from clsim.render.in_turn import LIT, PLANES, Turns
from clsim.render.light_layers import LAYERS, REACH, Layer, Lit

_QUIET, _CHANGES, _ALL = 0, 1, 2
"""Grades of pixels (`make_in_turn`)."""
_FIRST = 4
"""Times the paths of a pixel whose light changes that the first frame traces …"""
_FRAMES_A_PATH = 2
"""… and frames in which each pixel then gets one more."""


def window_weights() -> Any:
    """Return the weights of the pixels around one ``[3, n]``, row by row: of all, and of each half of them.

    σ is half the reach, and the square's corners are 0. Each half is one colour of a chequerboard.
    """
    steps = np.arange(-REACH, REACH + 1)
    apart2 = steps[:, None] ** 2 + steps**2
    weights = np.where(apart2 <= REACH**2 + 1, np.exp(-apart2 / (2 * (REACH / 2) ** 2)), 0)
    white = steps[:, None] + steps & 1 == 0
    return np.stack([weights, weights * white, weights * ~white]).astype(np.float32).reshape(3, -1)


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
        kept = (pixels, effort.spp)
        kinds: dict[str, tuple[Any, Any]] = {
            "grades": (pixels, wp.uint8),
            "light": (kept, wp.vec3),
            "marks": (kept, wp.int32),
            "layers": ((pixels, LAYERS), Layer),
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
        self._arrays["windows"] = wp.array(window_weights(), dtype=wp.float32, device=device)
        self._seen_twice: Any = wp.zeros((2, max(again, 1)), dtype=wp.float32, device=device)

    @property
    def arguments(self) -> dict[str, Any]:
        """What the kernel takes beside the scene and the frame; ``steering`` changes with each frame."""
        return {
            "steering": Turns(),
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
        return {"steering": steering, "lighting": False, "again": 0}, self._kept

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
        """Trace more where brightness changes by a share of the threshold that matters, and around."""
        threshold = 0.5 * (interest.to_on + interest.to_off)
        changes = np.abs(interest.change) > STILL * threshold
        np.copyto(self._grades, largest_around(changes, self._padded))
