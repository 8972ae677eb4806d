"""A pixel with thresholds, leak and rest in float64: brightness linear in time between points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise


def fire(
    points: Sequence[tuple[float, float]], on: float, off: float, *, leak: float = 0.0, rest_s: float = 0.0
) -> tuple[list[tuple[float, bool]], float]:
    """Return the times and polarities (True for ON) of a pixel's events, and what it compares in the end.

    It compares d = level − reference, and the reference falls at the rate ``leak``. An event is where d comes to a
    threshold. Without a rest d falls or rises by the threshold then; with one, nothing happens for ``rest_s``, and d is
    0 at its end.

    Args:
        points: times [s], rising, and levels [natural-log units]; d is 0 at the first.
        on, off: contrast thresholds.
        leak: [natural-log units a second].
        rest_s: refractory period [s].
    """
    events: list[tuple[float, bool]] = []
    compared, wakes_s = 0.0, -math.inf
    for (t0, before), (t1, after) in pairwise(points):
        slope, t = (after - before) / (t1 - t0) + leak, t0
        while True:
            if wakes_s > t1:
                break
            if wakes_s > t:
                t, compared = wakes_s, 0.0
            distance = on - compared if slope > 0 else -off - compared
            crossing = t + distance / slope if slope != 0 else math.inf
            if crossing > t1:
                compared += slope * (t1 - t)
                break
            t = crossing
            events.append((t, slope > 0))
            compared = 0.0
            wakes_s = t + rest_s if rest_s > 0 else wakes_s
    return events, compared
