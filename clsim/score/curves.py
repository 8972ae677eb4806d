"""Precision, recall and F1 as functions of τ, as figure 3 of Tsuji et al., ICIP 2023, shows them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events import EventBatch
from clsim.score.matching import Sampling, squared_distances
from clsim.score.score import PAPER_TAU, harmonic, share


@dataclass(frozen=True)
class Curves:
    """Scores over τ; all arrays have one value per τ."""

    tau: npt.NDArray[np.float64]
    precision: npt.NDArray[np.float64]
    recall: npt.NDArray[np.float64]
    f1: npt.NDArray[np.float64]


def curves(
    events: EventBatch,
    reference: EventBatch,
    sampling: Sampling,
    tau: npt.NDArray[np.float64] | None = None,
) -> Curves:
    """Return the scores at each ``tau``; by default 60 values from 1e-5 to 1e-2, evenly spaced in the logarithm."""
    taus = np.geomspace(1e-5, 1e-2, 60) if tau is None else tau
    sampling.check(events, "the event set")
    sampling.check(reference, "the reference")
    there = squared_distances(events, reference, sampling)
    back = squared_distances(reference, events, sampling)
    both_empty = not len(events) and not len(reference)
    precision = np.array([share(there < t, both_empty) for t in taus])
    recall = np.array([share(back < t, both_empty) for t in taus])
    f1 = np.array([harmonic(p, r) for p, r in zip(precision, recall, strict=True)])
    return Curves(taus, precision, recall, f1)


def plot_curves(by_label: Mapping[str, Curves], file: str | Path) -> None:
    """Draw the curves of several methods side by side into a PNG.

    Raises:
        InputError: matplotlib is not installed, or the file cannot be written.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise InputError("drawing curves needs matplotlib, which is not installed; pip install matplotlib") from None
    figure = Figure(figsize=(12, 4), layout="constrained")
    panels = figure.subplots(1, 3, sharey=True)
    for panel, name in zip(panels, ("precision", "recall", "f1"), strict=True):
        for label, values in by_label.items():
            panel.semilogx(values.tau, getattr(values, name), label=label)
        panel.axvline(PAPER_TAU, color="grey", linestyle="--", linewidth=1)
        panel.set(title=name if name != "f1" else "F1", xlabel="τ on d²", ylim=(0, 1.02))
        panel.grid(alpha=0.3)
    panels[-1].legend()
    try:
        figure.savefig(file, format="png", dpi=120)
    except OSError as error:
        raise InputError(f"cannot write {file}: {error.strerror}") from None
