"""A reference fine enough: samples and frame rate are doubled until what is scored against it hardly moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from clsim.bench.tradeoff.reference_cache import Reference
from clsim.render import RenderOptions

SETTLED = 0.02
"""A reference has converged if scores within 1 ms move by less than this when it is made finer."""
_STEP_COST = 4
"""Twice the samples at twice the rate."""


@dataclass(frozen=True)
class Convergence:
    """The last reference, the ceiling made like it, and how they were found.

    Attributes:
        reference, ceiling: the events of two seeds.
        options: the reference's.
        moved: by how much F1 within 1 ms moved when samples and frame rate were last doubled, the ceiling's or that of
            the same events, whichever moved more; None if nothing was doubled.
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

    Two scores must settle: that of the ceiling, which tells how much noise is left, and that of events that stay the
    same, the first ceiling's, which tells of errors that both seeds share. The time of kept references counts as if
    they had been rendered, so that a second run decides as the first did.

    Args:
        render: returns the reference of options; it is told ``reference`` or ``ceiling``.
        f1: scores the first against the second.
        options: the coarsest reference's.
        ceiling_seed: of the ceiling, which differs from the reference in nothing else.
        budget_s: processor time [s]; the first reference and its ceiling are rendered whatever they cost.
    """
    pair = _render_pair(render, options, ceiling_seed)
    judged = pair[1]
    step_s = spent_s = sum(each.cpu_s for each in pair)
    scores, moved = [f1(each, pair[0]) for each in (pair[1], judged)], None
    while (moved is None or moved >= SETTLED) and spent_s + _STEP_COST * step_s <= budget_s:
        fps, frames = options.fps or 0.0, options.frames or 1
        options = replace(options, spp=2 * options.spp, fps=2 * fps, frames=2 * (frames - 1) + 1)
        pair, last = _render_pair(render, options, ceiling_seed), scores
        step_s = sum(each.cpu_s for each in pair)
        spent_s += step_s
        scores = [f1(each, pair[0]) for each in (pair[1], judged)]
        moved = max(abs(now - before) for now, before in zip(scores, last, strict=True))
    return Convergence(*pair, options, moved, spent_s)


def _render_pair(
    render: Callable[[RenderOptions, str], Reference], options: RenderOptions, ceiling_seed: int
) -> tuple[Reference, Reference]:
    return render(options, "reference"), render(replace(options, seed=ceiling_seed), "ceiling")
