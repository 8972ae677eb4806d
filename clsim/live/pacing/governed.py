"""A governor at work: from times of frames to a renderer's effort."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, Protocol

from clsim.live.pacing.governor import UP_FRAMES, Governor
from clsim.live.pacing.ladder import Level

WARM_UP_FRAMES = 4
"""Frames at the start of a paced run that load kernels and wait for no clock."""
_MEASURED_FROM = 3
"""The first of them, counted from 1, whose time tells what a frame takes."""

_RESTART_UP_FRAMES = 8 * UP_FRAMES
"""Frames to wait before a level that resets the references, at the price of a frame without events."""


class Steerable(Protocol):
    """A frame source whose effort may change."""

    effort: Any
    """A `clsim.render.Effort`; holds from the next frame on."""


class Governed:
    """A governor and the ladder whose rungs it chooses from.

    The first frame is rendered at the best level, since it sets the references; the other ones of the warm-up at the
    cheapest level with as many first-hit rays that leaves no frame out, which tells where to start.
    """

    def __init__(self, levels: Sequence[Level], fps: float) -> None:
        """Prepare for a run with ``levels`` from the best to the cheapest."""
        self.levels = list(levels)
        waits = [
            UP_FRAMES if level.first_hit_rays == below.first_hit_rays else _RESTART_UP_FRAMES
            for level, below in pairwise([*levels, levels[-1]])
        ]
        self.governor = Governor([level.cost for level in levels], 1.0 / fps, waits)
        self.restarts = 0
        """How often references had to be reset."""
        best = self.levels[0]
        alike = [(level.first_hit_rays, level.one_in) == (best.first_hit_rays, best.one_in) for level in levels]
        self._trial = max(i for i, each in enumerate(alike) if each)
        self._applied = self._wanted = best
        self._frames = 0
        self._least_s = float("inf")

    @property
    def level(self) -> Level:
        """The level in force."""
        return self.levels[self.governor.level]

    @property
    def tolerance_us(self) -> float | None:
        """Error of an event's time that will do from the next frame on [µs]; None where none is sought."""
        return self._wanted.tolerance_us

    @property
    def one_in(self) -> int:
        """Frames of which one is rendered from now on; all of the warm-up are."""
        return self._applied.one_in if self._frames >= WARM_UP_FRAMES else 1

    @property
    def given_up(self) -> str:
        """What the level in force lacks against the best, in words; empty if nothing."""
        return self.level.given_up_against(self.levels[0])

    def apply(self, source: Steerable) -> bool:
        """Set the effort of the source's next frame; True if even a still picture changes, so that nothing may fire.

        For the thread of the source, so that it is known which frame the effort holds for.
        """
        before, self._applied = self._applied, self._wanted
        if before.effort == self._applied.effort:
            return False
        source.effort = replace(source.effort, **self._applied.effort)
        changed = before.first_hit_rays != self._applied.first_hit_rays
        self.restarts += changed
        return changed

    def frame_done(self, busy_s: float, lag_s: float) -> None:
        """Take notice of a frame that kept the machine busy for ``busy_s``, in a run that is ``lag_s`` late [s]."""
        self._frames += 1
        if self._frames < WARM_UP_FRAMES:
            self._wanted = self.levels[self._trial]
            if self._frames >= _MEASURED_FROM:
                self._least_s = min(self._least_s, busy_s)
            return
        if self._frames == WARM_UP_FRAMES:
            self.governor.begin(min(self._least_s, busy_s), self._trial)
        else:
            self.governor.observe(busy_s / self._applied.one_in, lag_s)
        self._wanted = self.level

    def summary(self) -> dict[str, Any]:
        """Return the level in force (0 is the best), how often it changed, what was given up, and if in vain."""
        return {
            "level": self.governor.level,
            "levels": len(self.levels),
            "changes": self.governor.changes,
            "restarts": self.restarts,
            "given_up": self.given_up,
            "too_slow": self.governor.too_slow,
        }
