"""A reference fine enough: samples and frame rate are doubled until what is scored against it hardly moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from clsim.bench.reference_cache import Reference
from clsim.render import RenderOptions

SETTLED = 0.02
"""A reference has converged if the F1 of the same events, within 1 ms, differs less than this from the last one's."""
_STEP_COST = 4
"""Twice the samples at twice the rate."""


@dataclass(frozen=True)
class Convergence:
    """The last reference, the ceiling made like it, and how they were found.

    Attributes:
        reference, ceiling: the events of two seeds.
        options: the reference's.
        moved: by how much F1 within 1 ms moved when samples and frame rate were last doubled; None if never.
        spent_s: processor time of all that was rendered [s].
    """

    reference: Reference
    ceiling: Reference
    options: RenderOptions
    moved: float | None
    spent_s: float

    @property
    def converged(self) -> bool:
        """Tell whether F1 has settled; else the budget was spent first."""
        return self.moved is not None and self.moved < SETTLED


def converge(
    render: Callable[[RenderOptions, str], Reference],
    f1: Callable[[Reference, Reference], float],
    options: RenderOptions,
    ceiling_seed: int,
    budget_s: float,
) -> Convergence:
    """Double samples and frame rate until F1 settles, or until another step would cost more than the budget.

    What is scored is always the same: the ceiling of the options given. The time of kept references counts as if they
    had been rendered, so that a second run decides as the first did.

    Args:
        render: returns the reference of options; it is told ``reference`` or ``ceiling``.
        f1: scores the first against the second.
        options: the coarsest reference's.
        ceiling_seed: of the ceiling, which differs from the reference in nothing else.
        budget_s: processor time [s]; the first reference and its ceiling are rendered whatever they cost.
    """
    reference = render(options, "reference")
    ceiling = judged = render(replace(options, seed=ceiling_seed), "ceiling")
    spent_s = reference.cpu_s + ceiling.cpu_s
    score, moved = f1(judged, reference), None
    # A step must leave time for the ceiling that belongs to it.
    while (moved is None or moved >= SETTLED) and spent_s + 2 * _STEP_COST * reference.cpu_s <= budget_s:
        fps, frames = options.fps or 0.0, options.frames or 1
        options = replace(options, spp=2 * options.spp, fps=2 * fps, frames=2 * (frames - 1) + 1)
        reference, last = render(options, "reference"), score
        spent_s += reference.cpu_s
        score = f1(judged, reference)
        moved = abs(score - last)
    if moved is not None:
        ceiling = render(replace(options, seed=ceiling_seed), "ceiling")
        spent_s += ceiling.cpu_s
    return Convergence(reference, ceiling, options, moved, spent_s)
