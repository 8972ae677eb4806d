"""A governor at work: from times of frames to a renderer's effort."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any, Protocol

from clsim.live.governor import Governor
from clsim.live.ladder import Level

WARM_UP_FRAMES = 4
"""Frames at the start of a paced run that load kernels and wait for no clock."""
_MEASURED_FROM = 3
"""The first of them, counted from 1, whose time tells what a frame takes."""


class Steerable(Protocol):
    """A frame source whose effort may change."""

    effort: Any
    """A `clsim.render.Effort`; holds from the next frame on."""


class Governed:
    """A governor and the ladder whose rungs it chooses from.

    The first frame is rendered at the best level, since it sets the references; the other ones of the warm-up at the
    cheapest, which tells where to start.
    """

    def __init__(self, levels: Sequence[Level], fps: float) -> None:
        """Prepare for a run with ``levels`` from the best to the cheapest."""
        self.levels = list(levels)
        self.governor = Governor([level.cost for level in levels], 1.0 / fps)
        self._frames = 0
        self._least_s = float("inf")

    @property
    def level(self) -> Level:
        """The level in force."""
        return self.levels[self.governor.level]

    @property
    def given_up(self) -> str:
        """What the level in force lacks against the best, in words; empty if nothing."""
        return self.level.given_up_against(self.levels[0])

    def frame_done(self, source: Steerable, busy_s: float, lag_s: float) -> None:
        """Take notice of a frame that kept the machine busy for ``busy_s``, in a run that is ``lag_s`` late."""
        self._frames += 1
        if self._frames == 1:
            _apply(source, self.levels[-1])
        elif self._frames < WARM_UP_FRAMES:
            if self._frames >= _MEASURED_FROM:
                self._least_s = min(self._least_s, busy_s)
        elif self._frames == WARM_UP_FRAMES:
            self.governor.begin(min(self._least_s, busy_s))
            _apply(source, self.level)
        elif self.governor.observe(busy_s, lag_s):
            _apply(source, self.level)

    def summary(self) -> dict[str, Any]:
        """Return the level in force (0 is the best), how often it changed, and what was given up."""
        return {
            "level": self.governor.level,
            "levels": len(self.levels),
            "changes": self.governor.changes,
            "given_up": self.given_up,
        }


def _apply(source: Steerable, level: Level) -> None:
    source.effort = replace(source.effort, **asdict(level))
