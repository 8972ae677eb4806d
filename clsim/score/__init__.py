"""Scores: how well events agree with a reference."""

from clsim.score.curves import Curves, curves, plot_curves
from clsim.score.matching import Sampling
from clsim.score.score import PAPER_TAU, Agreement, Score, score

__all__ = ["PAPER_TAU", "Agreement", "Curves", "Sampling", "Score", "curves", "plot_curves", "score"]
