"""The Pareto front: what nothing else beats in both cost and value."""

from __future__ import annotations

from collections.abc import Sequence


def pareto_front(costs: Sequence[float], values: Sequence[float]) -> list[int]:
    """Return the indices of the front, cheapest first.

    A point is on it unless another one costs no more and is worth no less, and is strictly better in one of the two.
    Equal points are on it together.
    """
    order = sorted(range(len(costs)), key=lambda i: (costs[i], -values[i]))
    front: list[int] = []
    for i in order:
        best = values[front[-1]] if front else float("-inf")
        twin = bool(front) and (costs[i], values[i]) == (costs[front[-1]], best)
        if values[i] > best or twin:
            front.append(i)
    return front
