"""Synthetic events for the tests of formats."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from clsim.events import EVENT_DTYPE, EventBatch
from clsim.events.files import open_sink, open_source

WIDTH, HEIGHT = 346, 260

# One ending a format; the field's limits differ, so these events fit them all.
ENDINGS = (
    ".aedat4", ".txt", ".csv", ".raw", ".evt3.raw", ".dat", ".es", ".h5", ".parquet", ".npz", ".mcap",
)  # fmt: skip
# The other bags of ROS, .db3 and .bag, share its code: test_ros.py runs these tests over them in the slow group.
ALL_OR_NOTHING = (".parquet", ".npz", ".mcap", ".db3", ".bag")
KILL_SAFE = (".aedat4", ".txt", ".raw", ".evt3.raw", ".dat", ".es", ".h5")


def events(count: int, start_us: int = 12_345_678, span_us: int = 60_000_000, seed: int = 0) -> EventBatch:
    """Return sorted events whose clock passes laps of EVT3's 16.8 s and gaps of many formats' fields."""
    rng = np.random.default_rng(seed)
    batch = np.zeros(count, EVENT_DTYPE)
    batch["t"] = start_us + rng.integers(0, span_us, count) // 50 * 50
    batch["x"], batch["y"] = rng.integers(0, WIDTH, count), rng.integers(0, HEIGHT, count)
    batch["on"] = rng.random(count) < 0.5
    if count > 3:  # the corners
        batch["x"][:2], batch["y"][:2] = (0, WIDTH - 1), (0, HEIGHT - 1)
        batch["x"][2:4], batch["y"][2:4] = (WIDTH - 1, 0), (0, HEIGHT - 1)
    return batch[np.lexsort((batch["x"], batch["y"], batch["t"]))]


def write(path: Path, batches: Iterable[EventBatch], **options: Any) -> Path:
    """Write batches to a file."""
    sink = open_sink(path, WIDTH, HEIGHT, **options)
    end_us = 0
    for batch in batches:
        end_us = max(end_us, end_of(batch))
        sink.write(batch, end_us)
    sink.close()
    return path


def end_of(batch: EventBatch) -> int:
    """Return the time of the last event [µs], 0 without one."""
    return int(batch["t"][-1]) if len(batch) else 0


def read(path: Path) -> EventBatch:
    """Return all events of a file."""
    with open_source(path) as source:
        found = list(source)
    return np.concatenate(found) if found else np.empty(0, EVENT_DTYPE)


def split(batch: EventBatch, pieces: int = 7) -> list[EventBatch]:
    """Return the batch in pieces of uneven length, some of them empty."""
    cuts = np.sort(np.random.default_rng(1).integers(0, len(batch) + 1, pieces - 1))
    return np.split(batch, cuts)
