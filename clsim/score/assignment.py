"""One-to-one matches of sorted numbers: as many as possible, and of these the ones that lie closest.

It is an optimal assignment, found by dynamic programming: a nearest-first match can take the partner that another event
needed. Work is done on all independent stretches of events at once, one event of each at a time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

I64 = npt.NDArray[np.int64]

_MOST_CELLS = 1 << 22
"""Most entries of a table of the dynamic programme, to bound memory."""


@dataclass(frozen=True)
class _Stretches:
    """Runs of events that share no partner with other runs.

    Attributes:
        start: ``[n]``, index of the first event of each.
        size: ``[n]``, number of events.
        reach: ``[n]``, largest number of partners of one event.
    """

    start: I64
    size: I64
    reach: I64

    def take(self, chosen: npt.NDArray[np.bool_] | slice) -> _Stretches:
        return _Stretches(self.start[chosen], self.size[chosen], self.reach[chosen])


def assign(time: I64, others: I64, first: I64, end: I64) -> I64:
    """Return for each of ``time`` the index of its partner in ``others``, or -1.

    Args:
        time: ``[n]``, ascending within each run of events that may share partners.
        others: ``[m]``, likewise.
        first: ``[n]``, index of the first of ``others`` that each may be matched with; never descends.
        end: ``[n]``, one more than the index of the last; never descends.

    Returns:
        The largest matching in which nobody has two partners; among such ones, one with the smallest sum of |Δt|.
    """
    partner = np.full(len(time), -1, np.int64)
    able = np.flatnonzero(first < end)
    if not len(able):
        return partner
    time, first, end = time[able], first[able], end[able]
    found = np.full(len(time), -1, np.int64)
    starts = np.flatnonzero(np.concatenate([[True], first[1:] >= end[:-1]]))
    size = np.diff(starts, append=len(time))
    reach = np.maximum.reduceat(end - first, starts)
    stretches = _Stretches(starts, size, reach)
    farthest = int(max(np.abs(time - others[first]).max(), np.abs(time - others[end - 1]).max()))
    # Alike ones go together, so that few are padded much.
    kind = 64 * np.ceil(np.log2(size)).astype(np.int64) + np.ceil(np.log2(reach)).astype(np.int64)
    for each in np.unique(kind):
        alike = stretches.take(kind == each)
        rows = max(1, _MOST_CELLS // int((alike.size.max() + 1) * (alike.reach.max() + 1)))
        for begin in range(0, len(alike.start), rows):
            _solve(time, others, (first, end), alike.take(slice(begin, begin + rows)), farthest, found)
    partner[able] = found
    return partner


def _solve(
    time: I64, others: I64, candidates: tuple[I64, I64], stretches: _Stretches, farthest: int, out_partner: I64
) -> None:
    """Match the events of some stretches; a row of a table has the best value for each number of partners used up.

    ``best[i][:, k]`` is the value of the first i events with partners before ``low[i] + k``. A match is worth more than
    all distances together, less its distance. Beyond an event's last partner the value stays, so a row is cut there.
    """
    first, end = candidates
    count, most, reach = len(stretches.start), int(stretches.size.max()), int(stretches.reach.max())
    offsets = np.arange(reach + 1)
    worth = most * farthest + 1
    best = np.zeros((most + 1, count, reach + 1), np.int64)
    low = np.zeros((most + 1, count), np.int64)
    low[0] = first[stretches.start]
    for i in range(most):
        event = stretches.start + np.minimum(i, stretches.size - 1)
        low[i + 1] = first[event]
        before = np.take_along_axis(best[i], np.minimum((low[i + 1] - low[i])[:, None] + offsets, reach), axis=1)
        candidate = low[i + 1][:, None] + offsets[:-1]
        fits = (candidate < end[event][:, None]) & (i < stretches.size)[:, None]
        distance = np.abs(time[event][:, None] - others[np.minimum(candidate, len(others) - 1)])
        row = best[i + 1]
        row[:, 0] = before[:, 0]
        row[:, 1:] = np.maximum(before[:, 1:], before[:, :-1] + np.where(fits, worth - distance, 0))
        np.maximum.accumulate(row, axis=1, out=row)
    lines = np.arange(count)
    column = np.full(count, reach)
    for i in reversed(range(most)):
        value = best[i + 1][lines, column]
        skipped = np.minimum(column + low[i + 1] - low[i], reach)
        matched = value > best[i][lines, skipped]
        used = (best[i + 1] < value[:, None]).sum(axis=1)
        partner = low[i + 1] + used - 1
        out_partner[(stretches.start + i)[matched]] = partner[matched]
        column = np.where(matched, np.minimum(partner - low[i], reach), skipped)
