"""Motion by chance: random splines, and the shake of a hand or a vehicle. The same seed is the same motion."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from clsim.errors import InputError
from clsim.scene.motion import Matrix, Vec3, compose
from clsim.scene.rigid import rotation_about

_DEGREE = 5
_WAVES = 12


@dataclass(frozen=True)
class Wander:
    """A smooth random path about a place, as ESIM's (Rebecq et al., CoRL 2018): a spline of degree 5 by random poses.

    The poses are the spline's control points, so that it never leaves their range; its first four derivatives are
    continuous. Nest it in another motion to have that wander.

    Attributes:
        seed: of the poses.
        duration_s: length of the path [s].
        reach_m: bounds of the position about the place along x, y, z [m]; its standard deviation is .36 of them.
        reach_deg: bounds of the turns about x, y, z; the three are a rotation vector, which is meant for up to 90°.
        poses_per_s: random poses a second.
    """

    seed: int = 0
    duration_s: float = 10.0
    reach_m: Vec3 = (0.1, 0.1, 0.1)
    reach_deg: Vec3 = (10.0, 10.0, 10.0)
    poses_per_s: float = 5.0
    _spline: Any = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Draw the poses and fit the spline."""
        from scipy.interpolate import BSpline

        if not (self.duration_s > 0 and self.poses_per_s > 0):
            raise InputError(
                f"a wandering path needs a duration and poses a second above 0, got {self.duration_s:g} s and "
                f"{self.poses_per_s:g}"
            )
        count = math.ceil(self.duration_s * self.poses_per_s) + _DEGREE
        drawn = np.random.Generator(np.random.Philox(self.seed)).uniform(-1.0, 1.0, (count, 6))
        reach = np.array((*self.reach_m, *np.radians(self.reach_deg)))
        knots = (np.arange(count + _DEGREE + 1) - _DEGREE) * (self.duration_s / (count - _DEGREE))
        object.__setattr__(self, "_spline", BSpline(knots, drawn * reach, _DEGREE))

    def pose(self, time_s: float) -> Matrix:
        """Return the pose at that time."""
        return _turned_by(self._spline(min(max(time_s, 0.0), self.duration_s)))


@dataclass(frozen=True)
class Shake:
    """The trembling of a camera in a hand or on a vehicle: a sum of sines of random frequencies, for ever.

    Nest it in another motion to have that shake.

    Attributes:
        seed: of frequencies and phases.
        sigma_m: standard deviation of the position along each axis [m].
        sigma_deg: standard deviation of the turn about each axis.
        lowest_hz: the frequencies' lower end.
        highest_hz: their upper end; they are drawn evenly in their logarithm.
        duration_s: how long it counts as motion, for what asks for its length [s].
    """

    seed: int = 0
    sigma_m: float = 0.002
    sigma_deg: float = 0.3
    lowest_hz: float = 2.0
    highest_hz: float = 15.0
    duration_s: float = 1.0
    _waves: Any = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Draw frequencies and phases."""
        if not 0 < self.lowest_hz <= self.highest_hz:
            raise InputError(
                f"a shake's frequencies must be above 0 and in order, got {self.lowest_hz:g} and {self.highest_hz:g} Hz"
            )
        drawn = np.random.Generator(np.random.Philox(self.seed)).uniform(size=(2, 6, _WAVES))
        rates = 2 * np.pi * self.lowest_hz * (self.highest_hz / self.lowest_hz) ** drawn[0]
        sigmas = np.repeat((self.sigma_m, math.radians(self.sigma_deg)), 3)
        # A sine has half its amplitude squared as variance.
        object.__setattr__(self, "_waves", (rates, 2 * np.pi * drawn[1], sigmas * math.sqrt(2 / _WAVES)))

    def pose(self, time_s: float) -> Matrix:
        """Return the pose at that time."""
        rates, phases, amplitudes = self._waves
        return _turned_by(amplitudes * np.sin(rates * time_s + phases).sum(axis=1))


def _turned_by(six: Matrix) -> Matrix:
    """Return the pose of a position and a rotation vector [rad]."""
    angle = float(np.linalg.norm(six[3:]))
    return compose(six[:3], rotation_about(six[3:], angle) if angle > 0 else np.eye(3))
