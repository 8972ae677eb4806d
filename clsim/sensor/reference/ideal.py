"""The ideal pixel in float64: one pixel, knot after knot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise


def walk(
    points: Sequence[tuple[float, float]], reference: float, on: float, off: float
) -> tuple[list[tuple[float, bool, float]], float, float]:
    """Return the events of a pixel whose brightness is linear in time between points.

    An event is where brightness has moved from the reference by a threshold, and the reference moves with it (Rebecq et
    al., "ESIM: an Open Event Camera Simulator", CoRL 2018).

    Args:
        points: times, in any unit, rising, and levels [natural-log units].
        reference: level of the last event.
        on, off: contrast thresholds.

    Returns:
        For each event its time, whether it is ON, and how steep brightness is there [a unit of time]; the reference
        after them; and the smallest distance that a level had to a threshold: where it is tiny, another precision may
        decide otherwise.
    """
    events, margin = [], math.inf
    for (t0, before), (t1, after) in pairwise(points):
        while after - reference >= on or after - reference <= -off:
            rises = after > reference
            margin = min(margin, after - reference - on if rises else reference - off - after)
            reference += on if rises else -off
            slope = (after - before) / (t1 - t0)
            events.append((t0 + (reference - before) / slope, rises, abs(slope)))
        margin = min(margin, reference + on - after, after - (reference - off))
    return events, reference, margin
