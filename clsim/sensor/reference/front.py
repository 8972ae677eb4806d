"""The front end in float64: one pixel's photocurrent, receptor and source follower, by a general solver."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

_TOLERANCE = 1e-8
"""Of the solver [natural-log units]."""


def follow(
    points: Sequence[tuple[float, float]],
    *,
    dark: float,
    receptor_s: float,
    follower_s: float,
    start: tuple[float, float] | None = None,
) -> list[tuple[float, float]]:
    """Return what a pixel compares, as times [s] and levels so close that lines between them do.

    With the photocurrent I = exp(level) + ``dark``, the receptor's output y has y' = (I − exp(y)) / ``receptor_s``
    (Delbruck and Mead, "Analog VLSI phototransduction by continuous-time, adaptive, logarithmic photoreceptor
    circuits", 1994: an amplifier whose bandwidth is proportional to I), and the follower's z has
    z' = (y − z) / ``follower_s``.

    Args:
        points: times [s], rising, and levels [natural-log units], linear in between.
        dark: dark current, in units of the photocurrent of level 0.
        receptor_s: time constant of the receptor under level 0, without ``dark`` [s].
        follower_s: that of the follower [s].
        start: what receptor and follower give at the first point [natural-log units]; None is at rest under its level.
    """
    from scipy.integrate import solve_ivp

    rest = math.log(math.exp(points[0][1]) + dark)
    state = [rest, rest] if start is None else list(start)
    found = [(points[0][0], state[1])]
    for (t0, before), (t1, after) in pairwise(points):
        slope = (after - before) / (t1 - t0)

        def change(
            t: float, state: Sequence[float], t0: float = t0, l0: float = before, m: float = slope
        ) -> list[float]:
            current = math.exp(l0 + m * (t - t0)) + dark
            return [(current - math.exp(state[0])) / receptor_s, (state[0] - state[1]) / follower_s]

        solved = solve_ivp(
            change, (t0, t1), state, method="LSODA", rtol=_TOLERANCE, atol=_TOLERANCE, max_step=(t1 - t0) / 50
        )
        found += list(zip(solved.t[1:].tolist(), solved.y[1, 1:].tolist(), strict=True))
        state = solved.y[:, -1].tolist()
    return found
