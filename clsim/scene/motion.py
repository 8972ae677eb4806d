"""Motion: a pose as a function of time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

Matrix = npt.NDArray[np.float64]


class Motion(Protocol):
    """A rigid (or similarity) pose over time."""

    @property
    def duration_s(self) -> float:
        """Length of the motion [s]; 0 where nothing moves."""
        ...

    def pose(self, time_s: float) -> Matrix:
        """Return the 4×4 object-to-world matrix (columns are the axes; for a camera, it looks along −z, +y up)."""
        ...


@dataclass(frozen=True)
class Static:
    """A pose that never changes."""

    matrix: Matrix
    duration_s: float = 0.0

    def pose(self, time_s: float) -> Matrix:
        """Return the one pose."""
        return self.matrix
