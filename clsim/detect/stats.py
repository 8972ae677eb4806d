"""Counters of detectors, in OpenCL and in numpy alike."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class DetectorStats:
    """Counts since the start.

    Attributes:
        frames: frames processed.
        events: events returned.
        tested: valid pixels that were asked whether they fire, summed over frames.
        solved: those of them whose regression was solved.
        initialised: pixels that (again) got their first reference.
        masked: pixels left out because of NaN or infinite values, summed over frames.
        many_crossings: pixels with more than 3 crossings in one step, summed over steps.
        most_crossings: the largest number of crossings of a pixel in one step (rule `interpolated`; else at most 1).
        capped: events left out because a pixel had more than 1000 in one step.
        lost: events that the sensor's readout had no time for.
    """

    frames: int = 0
    events: int = 0
    tested: int = 0
    solved: int = 0
    initialised: int = 0
    masked: int = 0
    many_crossings: int = 0
    most_crossings: int = 0
    capped: int = 0
    lost: int = 0

    @property
    def solved_share(self) -> float:
        """Share of the tested pixels whose regression was solved; 0 before any test."""
        return self.solved / self.tested if self.tested else 0.0
