"""An environment of Gymnasium's for tests: a box on a line."""

from typing import Any

import gymnasium
import numpy as np


class Slide(gymnasium.Env):  # type: ignore[misc, name-defined]
    """A box on a line, from a place by chance; an action is its speed [m/s], a step lasts 10 ms."""

    observation_space = gymnasium.spaces.Box(-2.0, 2.0, (1,), np.float64)
    action_space = gymnasium.spaces.Box(-20.0, 20.0, (1,), np.float64)

    def __init__(self, length: int = 20, reach_m: float = 0.1) -> None:
        """Let episodes have so many steps, and begin so far from the middle, at most."""
        self._length, self._reach_m = length, reach_m

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.steps, self.x = 0, float(self.np_random.uniform(-self._reach_m, self._reach_m))
        return np.array([self.x]), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.steps += 1
        self.x = float(np.clip(self.x + 0.01 * action[0], -1.0, 1.0))
        return np.array([self.x]), -abs(self.x), False, self.steps >= self._length, {"x": self.x}
