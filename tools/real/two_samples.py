"""How well a line tells two streams apart: features of patches of 5 ms and 64×64 pixels, and Fisher's discriminant."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from clsim.events import EventBatch
from clsim.sensor.statistics import statistics

PATCH_US, PATCH_PX, LEAST_EVENTS = 5000, 64, 60
FEATURES = (
    "log of events", "log of active pixels", "share of ON", "log of the interval: 1, 50, 99 %", "shared times",
    "row-mates", "column-mates", "next of opposite sign", "lonely", "hottest",
)  # fmt: skip
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
        times = (0.0, 0.0, 0.0) if s.interval_us is None else np.log10(np.maximum(s.interval_us, 1.0))
        shares = (s.shared_time, s.row_mates, s.column_mates, s.opposite_next, s.lonely, s.hottest)
        rows.append(
            [
                np.log10(s.events),
                np.log10(s.active_pixels),
                s.on_share,
                *times,
                *(0.0 if x is None else x for x in shares),
            ]
        )
    return np.array(rows, np.float64).reshape(-1, len(FEATURES) + 2)


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
