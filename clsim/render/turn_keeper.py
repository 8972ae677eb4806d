"""Host side of in_turn.py: what is kept of paths, and how many are traced again."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from clsim.frames import InterestBoard, InterestMap
from clsim.render.effort import STILL, Effort, MapReader, Sight, largest_around, looks_of
from clsim.render.in_turn import LAYERS, LIT, REACH, Layer, Lit, Turns

_QUIET, _CHANGES, _ALL = 0, 1, 2
"""Grades of pixels (`make_in_turn`)."""


def window_weights() -> Any:
    """Return the weights of the pixels around one, row by row; σ is half the reach, and the square's corners are 0."""
    steps = np.arange(-REACH, REACH + 1)
    apart2 = steps[:, None] ** 2 + steps**2
    weights = np.where(apart2 <= REACH**2 + 1, np.exp(-apart2 / (2 * (REACH / 2) ** 2)), 0)
    return weights.astype(np.float32).reshape(-1)


class TurnKeeper(MapReader):
    """Keeps what each path of each pixel found last, and decides how many are traced again.

    The number of paths that are kept is that of the first effort; ``probe_spp`` of them are traced again where light
    changes, and one in every n-th frame elsewhere.
    """

    def __init__(
        self, width: int, height: int, effort: Effort, sight: Sight, board: InterestBoard | None, device: Any
    ) -> None:
        """Allocate what is kept from frame to frame."""
        super().__init__(width, height, effort, sight, board, device)
        pixels = width * height
        self._kept = effort.spp
        kept = (pixels, effort.spp)
        kinds: dict[str, tuple[Any, Any]] = {
            "grades": (pixels, wp.uint8),
            "light": (kept, wp.vec3),
            "marks": (kept, wp.int32),
            "layers": ((pixels, LAYERS), Layer),
            "traced": (pixels, wp.int32),
            "lit": ((pixels, LIT), Lit),
            "lit_things": (pixels, wp.int32),
        }
        self._arrays: dict[str, Any] = {
            name: wp.zeros(size, dtype=kind, device=device) for name, (size, kind) in kinds.items()
        }
        self._arrays["window"] = wp.array(window_weights(), dtype=wp.float32, device=device)

    @property
    def arguments(self) -> dict[str, Any]:
        """What the kernel takes beside the scene and the frame; ``steering`` changes with each frame."""
        return {"steering": Turns(), "lighting": False, "out_spent": self._spent} | self._arrays

    def prepare(self, index: int, time_us: int) -> tuple[dict[str, Any], int]:
        """Choose the paths of the frame ``index``; return arguments of the kernel and how many paths are kept.

        Whenever it is, this takes the interest map of two frames ago, and waits for it where the board does.
        """
        effort = self.effort
        steering: Any = Turns()
        steering.looks = looks_of(effort.first_hit_rays, self._sight)
        steering.probe, steering.every, steering.turn = effort.probe_spp, effort.every, self._number + 1
        if index <= self._index or self._anew:
            # Nothing that was kept tells of this frame.
            self._grades.fill(_ALL)
            for name in ("light", "marks", "layers", "traced"):
                self._arrays[name].zero_()
        else:
            interest = None if self._board is None else self._board.find(self._number)
            self._grades.fill(_QUIET)
            if interest is not None:
                self._grade(interest)
        grades = self._grades.reshape(-1)
        wp.copy(self._arrays["grades"], wp.array(grades, dtype=wp.uint8, device="cpu", copy=False))
        self._index, self._anew = index, False
        self._number += 1
        return {"steering": steering, "lighting": False}, self._kept

    def forget(self) -> None:
        """Trace all paths in the next frame, and keep nothing of earlier ones: the light is another one."""
        self._anew = True

    def _grade(self, interest: InterestMap) -> None:
        """Trace more where brightness changes by a share of the threshold that matters, and around."""
        threshold = 0.5 * (interest.to_on + interest.to_off)
        changes = np.abs(interest.change) > STILL * threshold
        np.copyto(self._grades, largest_around(changes, self._padded))
