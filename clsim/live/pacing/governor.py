"""The governor, which holds a run within its time per frame: control alone, without threads or a clock of its own."""

from __future__ import annotations

import itertools
import statistics
from collections import deque
from collections.abc import Sequence

_SETTLE_FRAMES = 2
"""Frames after a change that were begun before it, and tell nothing of it."""
_START_SHARE = 0.6
"""Share of the budget that the first level may be predicted to take."""
_DOWN_TO_SHARE = 0.8
"""Share that a level may be predicted to take for the governor to go down to it."""
_DOWN_SHARE = 0.92
"""Share beyond which the average makes it go down."""
_UP_SHARE = 0.75
"""Share that the next level may be predicted to take for the governor to go up."""
_AVERAGE = 0.25
"""Weight of the latest frame in the exponential average."""
UP_FRAMES = 20
"""Frames for which the next level must have been predicted to fit, before it is tried for the first time."""
_RISEN = 1.25
"""Frames that take so many times as long as they usually do at the level tell of a load that has risen."""
_USUAL_FRAMES = 50
"""Frames of which the usual time is the average, roughly; and half as many are needed to know it."""
_MOST_FAILURES = 8
"""Failed attempts after which the wait grows no longer: it is 2⁸ times as long then."""
_OTHER_LOAD = 0.8
"""A load below this share of that at which an attempt failed is another one: the attempt may be made again soon."""
_CATCH_UP_FRAMES = 30
"""Frames in which a run that is late should have caught up."""
_LEAST_SHARE = 0.7
"""Share of the budget that frames may always take, however late the run is."""


class Governor:
    """Moves along levels so that frames take no longer than their budget.

    Going down happens at once: when two of the last three frames were over the budget, or their average is about to
    be; then to the first level that is predicted to fit with some room. Going up happens a level at a time, when the
    next was predicted to fit for a while. That while doubles each time the level has to be left again although the load
    has not risen, and is short again when the load has fallen. So under a load that stays the same, however much it
    scatters, the number of changes grows with the logarithm of time at most.

    Attributes:
        level: the level in force: an index into ``costs``.
        changes: how often it has changed since `begin`.
    """

    def __init__(self, costs: Sequence[float], budget_s: float, waits: Sequence[int] | None = None) -> None:
        """Begin at the best level.

        Args:
            costs: cost of a frame at each level, from the best to the cheapest, relative to each other. They need be
                roughly right only: a frame's time is predicted from that at the level in force.
            budget_s: time that a frame may take [s].
            waits: for how many frames each level must have been predicted to fit before the governor goes up to it
                for the first time; None stands for `UP_FRAMES` everywhere.
        """
        if any(higher <= lower for higher, lower in itertools.pairwise(costs)) or costs[-1] <= 0:
            raise ValueError(f"costs must be positive and fall from level to level, got {list(costs)}")
        self.level = 0
        self.changes = 0
        self._costs = tuple(costs)
        self._budget_s = budget_s
        self._waits = tuple(waits or [UP_FRAMES] * len(costs))
        self._last: deque[float] = deque(maxlen=3)
        self._average_s: float | None = None
        self._ignored = 0
        self._fitting = 0
        self._frames_here = 0
        self._usual_s = 0.0
        self._tried_load = 0.0
        self._failures = [0] * len(costs)
        self._failed_load = [0.0] * len(costs)

    @property
    def too_slow(self) -> bool:
        """Whether frames take longer than their budget although the level is the cheapest."""
        cheapest = self.level == len(self._costs) - 1
        return cheapest and self._average_s is not None and self._average_s > self._budget_s

    def begin(self, busy_s: float, level: int) -> None:
        """Choose the level to start with, after frames at ``level`` took ``busy_s`` [s]."""
        self.level = level
        self._average_s = busy_s
        self._go_to(self._best_within(_START_SHARE * self._budget_s, busy_s, best=0))

    def observe(self, busy_s: float, lag_s: float = 0.0) -> bool:
        """Take notice of a frame that kept the machine busy for ``busy_s``; True if the level is another one now.

        Args:
            busy_s: how long the frame took [s], waiting for its time to come left out.
            lag_s: how late the run is [s].
        """
        if self._ignored:
            self._ignored -= 1
            return False
        self._last.append(busy_s)
        middle_s = statistics.median_low(self._last)
        average_s = middle_s if self._average_s is None else self._average_s + _AVERAGE * (middle_s - self._average_s)
        self._average_s = average_s
        late_share = min(1.0 - _LEAST_SHARE, lag_s / (_CATCH_UP_FRAMES * self._budget_s))
        allowed_s = self._budget_s * (1.0 - late_share)
        sure = len(self._last) > 1
        if sure and (middle_s > allowed_s or average_s > _DOWN_SHARE * allowed_s):
            return self._go_down(max(middle_s, average_s), allowed_s)
        self._frames_here += 1
        self._usual_s += (middle_s - self._usual_s) / min(self._frames_here, _USUAL_FRAMES)
        return self._may_go_up(average_s, lag_s)

    def _go_down(self, busy_s: float, allowed_s: float) -> bool:
        if self.level == len(self._costs) - 1:
            return False
        self._average_s = busy_s
        risen = 2 * self._frames_here >= _USUAL_FRAMES and busy_s > _RISEN * self._usual_s
        if not risen:
            self._failures[self.level] = min(self._failures[self.level] + 1, _MOST_FAILURES)
            self._failed_load[self.level] = self._tried_load
        if not risen and self._tried_load:
            self._go_to(self.level + 1)
        else:
            self._go_to(self._best_within(_DOWN_TO_SHARE * allowed_s, busy_s, best=self.level + 1))
        self.changes += 1
        return True

    def _may_go_up(self, average_s: float, lag_s: float) -> bool:
        if self.level == 0:
            return False
        above = self.level - 1
        fits = self._predict(above, average_s) <= _UP_SHARE * self._budget_s and lag_s < self._budget_s
        self._fitting = self._fitting + 1 if fits else 0
        load = average_s / self._costs[self.level]
        if load < _OTHER_LOAD * self._failed_load[above]:
            self._failures[above] = 0
        if self._fitting < self._waits[above] << self._failures[above]:
            return False
        self._go_to(above)
        self._tried_load = load
        self.changes += 1
        return True

    def _predict(self, level: int, busy_s: float) -> float:
        """Return how long a frame would take [s] at a level, after ``busy_s`` at that in force."""
        return busy_s * self._costs[level] / self._costs[self.level]

    def _best_within(self, limit_s: float, busy_s: float, best: int) -> int:
        """Return the best level from ``best`` on whose predicted time is within a limit, or else the cheapest."""
        for level in range(best, len(self._costs)):
            if self._predict(level, busy_s) <= limit_s:
                return level
        return len(self._costs) - 1

    def _go_to(self, level: int) -> None:
        assert self._average_s is not None, "levels change after a frame"
        self._average_s = self._predict(level, self._average_s)
        self.level = level
        self._last.clear()
        self._ignored = _SETTLE_FRAMES
        self._fitting = self._frames_here = 0
        self._tried_load = 0.0
