"""How well a set of events agrees with a reference.

Names are the standard ones. Beware when comparing with Tsuji et al., ICIP 2023: their "precision" P(τ) is the share of
*reference* events that have a near detected one, which everybody else calls recall, and their "recall" R(τ) is
precision. F1 is the same either way.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events import EventBatch
from clsim.score.matching import NO_NEIGHBOUR, Sampling, one_to_one, squared_distances

PAPER_TAU = 5e-4
"""The τ of the paper's tables, on d²: about 0.022 of the image's width."""


@dataclass(frozen=True)
class Agreement:
    """Shares of events that have a partner of their own, and the harmonic mean of both."""

    precision: float
    recall: float
    f1: float


@dataclass(frozen=True)
class Score:
    """The scores of detected events against reference events.

    An empty set has no share of anything: against another empty set the scores are perfect, else they are 0.

    Attributes:
        f1: harmonic mean of precision and recall.
        precision: share of detected events with d² < τ to a reference event of their polarity and frame.
        recall: share of reference events with d² < τ to a detected event (the paper's "precision").
        strict_f1: harmonic mean of the strict two.
        strict_precision: share of detected events that have a partner of their own: a reference event at the same
            pixel, of the same polarity, at most one frame away. Nobody has two partners.
        strict_recall: share of reference events with a partner.
        chamfer: mean of the two mean d²; an event without any partner counts d² = 2.
        dt_median_us: median ``|Δt|`` of detected events to their strict partner [µs]; None without any.
        dt_p95_us: 95th percentile of the same; None without any.
        dt_bias_us: mean of t − t' to the strict partner [µs], positive where events are late; None without any.
        within: for each window [µs] that was asked for, the scores of one-to-one matches of at most that ``|Δt|``.
        events: number of detected events.
        reference_events: number of reference events.
        unmatched_events: detected events without any same-polarity reference event in their frame.
        unmatched_reference: reference events without any same-polarity detected event in their frame.
        tau: the τ used.
    """

    f1: float
    precision: float
    recall: float
    strict_f1: float
    strict_precision: float
    strict_recall: float
    chamfer: float
    dt_median_us: float | None
    dt_p95_us: float | None
    dt_bias_us: float | None
    within: dict[int, Agreement]
    events: int
    reference_events: int
    unmatched_events: int
    unmatched_reference: int
    tau: float

    def as_dict(self) -> dict[str, Any]:
        """Return the scores by name, for JSON; the windows of ``within`` become texts."""
        return dataclasses.asdict(self) | {
            "within": {str(window): dataclasses.asdict(each) for window, each in self.within.items()}
        }


def score(
    events: EventBatch,
    reference: EventBatch,
    width: int,
    height: int,
    fps: float,
    tau: float = PAPER_TAU,
    within_us: Sequence[int] = (),
) -> Score:
    """Score detected events against a reference (Tsuji et al., ICIP 2023, section 3, and a strict variant).

    Args:
        events: detected events, in any order.
        reference: the events they should be.
        width: image width [pixels].
        height: image height [pixels].
        fps: frame rate [1/s]; an event belongs to frame ⌈t·fps⌉.
        tau: threshold on the squared distance d² of (x/W, y/H).
        within_us: windows of time, at least 1 µs: ``Score.within`` will have the scores of each.

    Raises:
        InputError: an event outside the image, or a size, rate or τ that is not positive.
    """
    sampling = Sampling(width, height, fps)
    if not 0 < tau < float("inf"):
        raise InputError(f"`tau` must be a positive number, got {tau}")
    for window in within_us:
        if not window >= 1:
            raise InputError(f"`within_us` must be at least 1 µs, got {window}")
    sampling.check(events, "the event set")
    sampling.check(reference, "the reference")
    there = squared_distances(events, reference, sampling)
    back = squared_distances(reference, events, sampling)
    both_empty = not len(events) and not len(reference)
    precision, recall = share(there < tau, both_empty), share(back < tau, both_empty)
    late = one_to_one(events, reference, sampling, None)
    strict = _agreement(len(late), len(events), len(reference))
    apart = np.abs(late)
    within = {
        window: _agreement(len(one_to_one(events, reference, sampling, window)), len(events), len(reference))
        for window in within_us
    }
    return Score(
        f1=harmonic(precision, recall),
        precision=precision,
        recall=recall,
        strict_f1=strict.f1,
        strict_precision=strict.precision,
        strict_recall=strict.recall,
        chamfer=0.0 if both_empty else (_mean_square(there) + _mean_square(back)) / 2,
        dt_median_us=float(np.median(apart)) if len(apart) else None,
        dt_p95_us=float(np.percentile(apart, 95)) if len(apart) else None,
        dt_bias_us=float(late.mean()) if len(late) else None,
        within=within,
        events=len(events),
        reference_events=len(reference),
        unmatched_events=int(np.isinf(there).sum()),
        unmatched_reference=int(np.isinf(back).sum()),
        tau=tau,
    )


def _agreement(pairs: int, events: int, reference: int) -> Agreement:
    """Return the scores of so many one-to-one matches of so many events."""
    both_empty = not events and not reference
    precision, recall = (pairs / count if count else float(both_empty) for count in (events, reference))
    return Agreement(precision, recall, harmonic(precision, recall))


def share(matched: npt.NDArray[np.bool_], both_empty: bool = False) -> float:
    """Return the share of True; of no events 0, or 1 if the other set is empty too."""
    return float(matched.mean()) if len(matched) else float(both_empty)


def harmonic(a: float, b: float) -> float:
    """Return the harmonic mean, 0 if both are."""
    return 2 * a * b / (a + b) if a + b > 0 else 0.0


def _mean_square(squared: npt.NDArray[np.float64]) -> float:
    return float(np.minimum(squared, NO_NEIGHBOUR).mean()) if len(squared) else NO_NEIGHBOUR
