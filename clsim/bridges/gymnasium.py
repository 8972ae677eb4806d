"""Gymnasium: an environment whose agent sees events.

>>> env = EventObservation(gymnasium.make("Pendulum-v1"), simulator, follow)  # doctest: +SKIP
"""

from __future__ import annotations

from collections import UserDict
from collections.abc import Callable
from numbers import Integral
from typing import Any, Literal, SupportsFloat

import numpy as np
import numpy.typing as npt

from clsim.errors import Error, InputError
from clsim.events import EventBatch
from clsim.events.grids import histogram, voxel_grid
from clsim.simulator import Simulator
from clsim.values import read_value

try:
    import gymnasium
    from gymnasium.spaces import Box, Dict
except ImportError:
    raise Error("Gymnasium is not installed; pip install 'clsim[gymnasium]'") from None

Form = Literal["voxels", "histogram"]


class Columns(UserDict[str, npt.NDArray[Any]]):
    """The events of a step by column. No dictionary, for vector environments would join columns of several lengths."""

    def __eq__(self, other: object) -> bool:
        """Whether all columns are the same."""
        if not isinstance(other, Columns) or self.keys() != other.keys():
            return False
        return all(np.array_equal(self[name], other[name]) for name in self)

    __hash__ = None  # type: ignore[assignment]


class EventObservation(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Adds to each observation the events since the one before.

    ``info["events"]`` holds them as they are: a mapping with arrays ``t`` [µs], ``x``, ``y`` and ``on``, sorted by
    time. In vector environments it is an array of such mappings, one for each environment.

    An observation becomes a dictionary: ``"state"`` is what the environment observes, ``"events"`` an array of fixed
    size: "voxels" are polarities over ``bins`` points in time, ``[bins, H, W]``, as `clsim.events.grids.voxel_grid`
    makes them; a "histogram" counts OFF and ON events, ``[2, H, W]``. What exceeds ``limit`` is cut.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        simulator: Simulator,
        follow: Callable[[Simulator], int],
        *,
        form: Form = "voxels",
        bins: int = 5,
        limit: float = 100.0,
    ) -> None:
        """Wrap an environment.

        Args:
            env: the environment.
            simulator: of the world that it is in. It is reset with the environment, and not closed with it.
            follow: tells the simulator where everything is now (`Simulator.set_pose`), and returns the time [µs] since
                the episode began, up to which the next events are wanted; it is called after each reset and step.
            form: how events are observed.
            bins: points in time of the voxels.
            limit: largest value of the array.

        Raises:
            InputError: a value cannot be.
        """
        super().__init__(env)
        self._form: Form = read_value("form", form, Form)
        self._bins = read_value("bins", bins, int)
        self._limit = read_value("limit", limit, float)
        if self._bins < 1 or self._limit <= 0:
            raise InputError(f"`bins` must be at least 1 and `limit` positive, got {bins} and {limit}")
        self.simulator, self._follow = simulator, follow
        layers, lowest = (2, 0.0) if self._form == "histogram" else (self._bins, -self._limit)
        shape = (layers, simulator.height, simulator.width)
        events = Box(lowest, self._limit, shape, np.float32)
        self.observation_space = Dict({"state": env.observation_space, "events": events})

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode, in which no event has happened yet; the seed is the simulator's as well."""
        state, info = self.env.reset(seed=seed, options=options)
        self.simulator.reset(seed)
        return self._observed(state, info)

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Take a step, and return what it made happen and fire."""
        state, reward, terminated, truncated, info = self.env.step(action)
        observation, info = self._observed(state, info)
        return observation, reward, terminated, truncated, info

    def _observed(self, state: Any, info: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        start_us = self.simulator.time_us
        at_us: Any = self._follow(self.simulator)
        if isinstance(at_us, bool) or not isinstance(at_us, Integral):
            raise InputError(f"`follow` must return a time as a whole number of µs, got {at_us!r}")
        events = self.simulator.step(int(at_us))
        # Not a plain dictionary: vector environments would put those of all into one array, as if of one length.
        columns = Columns({name: np.ascontiguousarray(events[name]) for name in ("t", "x", "y", "on")})
        return {"state": state, "events": self._array(events, start_us)}, info | {"events": columns}

    def _array(self, events: EventBatch, start_us: int) -> npt.NDArray[np.float32]:
        width, height = self.simulator.width, self.simulator.height
        if self._form == "histogram":
            grid = histogram(events, width, height)
        else:
            end_us = max(self.simulator.time_us, start_us + 1)
            grid = voxel_grid(events, width, height, self._bins, start_us, end_us)
        return np.clip(grid, -self._limit, self._limit, out=grid)
