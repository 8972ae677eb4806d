"""How well a line tells two streams apart: features of patches of 5 ms and 64×64 pixels, and Fisher's discriminant."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from clsim.events import EventBatch
from clsim.sensor.statistics import statistics

PATCH_US, PATCH_PX, LEAST_EVENTS = 5000, 64, 60
OF_SCENES = (
    "log of events", "log of `active_pixels`", "`on_share`", "log of `interval_us` (50 %)",
    "log of `interval_us` (99 %)", "`opposite_next`", "`hottest`",
)  # fmt: skip
OF_CAMERAS = (
    "log of `interval_us` (1 %)", "`shared_time`", "`row_mates`", "`column_mates`", "`one_row`", "`one_column`",
    "`lonely`",
)  # fmt: skip
"""Features, those that cameras decide more than scenes last."""
_RIDGE, _FOLDS = 1e-2, 5
FloatArray = npt.NDArray[np.float64]


def features(events: EventBatch) -> FloatArray:
    """Return the features of each patch that has enough events, ``[patches, features]``; what is untold is 0."""
    since = events["t"] - events["t"][0] if len(events) else events["t"]
    patch = (since // PATCH_US << 32) | (events["y"] // PATCH_PX).astype(np.int64) << 16 | events["x"] // PATCH_PX
    order = np.argsort(patch, kind="stable")
    rows = []
    for part in np.split(events[order], np.flatnonzero(np.diff(patch[order])) + 1):
        if len(part) < LEAST_EVENTS:
            continue
        s = statistics(part)
        low, middle, high = (0, 0, 0) if s.interval_us is None else np.log10(np.maximum(s.interval_us, 1.0))
        of_scene = np.log10(s.events), np.log10(s.active_pixels), s.on_share, middle, high, s.opposite_next, s.hottest
        of_camera = low, s.shared_time, s.row_mates, s.column_mates, s.one_row, s.one_column, s.lonely
        rows.append([0.0 if number is None else number for number in (*of_scene, *of_camera)])
    return np.array(rows, np.float64).reshape(-1, len(OF_SCENES) + len(OF_CAMERAS))


def accuracy(one: FloatArray, other: FloatArray, seed: int = 0) -> float:
    """Return the share of patches, half of them of either stream, that are told right: of folds not trained on."""
    random = np.random.default_rng(seed)
    count = min(len(one), len(other))
    if count < 4 * _FOLDS:
        return float("nan")
    one, other = (random.permutation(each)[:count] for each in (one, other))
    folds = np.arange(count) % _FOLDS
    right = []
    for fold in range(_FOLDS):
        a, b = (each[folds != fold] for each in (one, other))
        middle, spread = np.concatenate([a, b]).mean(axis=0), np.concatenate([a, b]).std(axis=0) + 1e-9
        a, b, here, there = ((each - middle) / spread for each in (a, b, one[folds == fold], other[folds == fold]))
        within = np.cov(a.T) + np.cov(b.T) + _RIDGE * np.eye(a.shape[1])
        line = np.linalg.solve(within, a.mean(axis=0) - b.mean(axis=0))
        between = line @ (a.mean(axis=0) + b.mean(axis=0)) / 2
        right += [(here @ line > between).mean(), (there @ line < between).mean()]
    return float(np.mean(right))
