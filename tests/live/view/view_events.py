"""Events for the tests of views."""

import numpy as np

from clsim.events import EVENT_DTYPE, EventBatch


def random_events(
    count: int, width: int, height: int, *, begin_us: int = 0, end_us: int = 1_000_000, seed: int = 0
) -> EventBatch:
    rng = np.random.default_rng(seed)
    batch = np.zeros(count, EVENT_DTYPE)
    batch["t"] = np.sort(rng.integers(begin_us, end_us, count))
    batch["x"] = rng.integers(0, width, count)
    batch["y"] = rng.integers(0, height, count)
    batch["on"] = rng.random(count) < 0.5
    return batch
