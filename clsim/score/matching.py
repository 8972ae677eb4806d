"""Which events of one set have a partner in another, in space or in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from clsim.errors import InputError
from clsim.events import EventBatch
from clsim.score.assignment import I64, assign

NO_NEIGHBOUR = 2.0
"""Squared distance of an event that has no same-polarity event in its frame: the image's diagonal, squared."""
_FRAME_GAP = 4.0
"""Distance between frames in the search tree, more than any distance within one."""


@dataclass(frozen=True)
class Sampling:
    """The grid on which events are compared: image size [pixels] and frame rate [1/s]."""

    width: int
    height: int
    fps: float

    def __post_init__(self) -> None:
        """Refuse what is not positive."""
        for name in ("width", "height", "fps"):
            value = getattr(self, name)
            if not 0 < value < float("inf"):
                raise InputError(f"`{name}` must be a positive number, got {value}")

    def frames(self, events: EventBatch) -> npt.NDArray[np.int64]:
        """Return the frame ⌈t·fps⌉ of each event: k for t in (t_{k−1}, t_k], with t_k rounded to whole µs."""
        return np.ceil((events["t"] - 0.5) * self.fps / 1e6).astype(np.int64)

    def check(self, events: EventBatch, what: str) -> None:
        """Raise InputError if an event lies outside the image."""
        outside = np.flatnonzero((events["x"] >= self.width) | (events["y"] >= self.height))
        if len(outside):
            first = events[outside[0]]
            raise InputError(
                f"{what} has an event at x={first['x']}, y={first['y']}, outside the image of "
                f"{self.width}×{self.height} pixels"
            )


def squared_distances(events: EventBatch, others: EventBatch, sampling: Sampling) -> npt.NDArray[np.float64]:
    """Return for each event the squared distance d² to the nearest of ``others`` of its polarity and frame.

    Positions are (x/W, y/H), as in Tsuji et al., ICIP 2023, section 3, whose program keeps frames apart too. Without
    any such event d² is infinite.
    """
    result = np.full(len(events), np.inf)
    points, targets = _points(events, sampling), _points(others, sampling)
    for polarity in (False, True):
        mine, theirs = events["on"] == polarity, others["on"] == polarity
        if mine.any() and theirs.any():
            distance, _ = cKDTree(targets[theirs]).query(points[mine], distance_upper_bound=_FRAME_GAP / 2)
            result[mine] = distance**2
    return result


def _points(events: EventBatch, sampling: Sampling) -> npt.NDArray[np.float64]:
    return np.column_stack(
        [events["x"] / sampling.width, events["y"] / sampling.height, sampling.frames(events) * _FRAME_GAP]
    )


def one_to_one(events: EventBatch, others: EventBatch, sampling: Sampling, within_us: int | None) -> I64:
    """Return t − t' [µs] of each pair of an event and its partner among ``others``, in no particular order.

    Partners are at the same pixel, of the same polarity, and at most ``within_us`` apart; None lets them be one frame
    apart. Nobody has two partners; there are as many pairs as there can be, and of these the closest.
    """
    order, other_order = (np.lexsort((batch["t"], _place(batch, sampling))) for batch in (events, others))
    events, others = events[order], others[other_order]
    if within_us is None:
        stamp, other_stamp, reach = sampling.frames(events), sampling.frames(others), 1
    else:
        stamp, other_stamp, reach = events["t"].astype(np.int64), others["t"].astype(np.int64), within_us
    if not len(events) or not len(others):
        return np.empty(0, np.int64)
    origin = min(int(stamp.min()), int(other_stamp.min()))
    # Places lie so far apart that nothing reaches from one to the next.
    span = max(int(stamp.max()), int(other_stamp.max())) - origin + 2 * reach + 1
    key = _place(events, sampling) * span + (stamp - origin)
    other_key = _place(others, sampling) * span + (other_stamp - origin)
    first = np.searchsorted(other_key, key - reach, side="left").astype(np.int64)
    end = np.searchsorted(other_key, key + reach, side="right").astype(np.int64)
    time, other_time = events["t"].astype(np.int64), others["t"].astype(np.int64)
    partner = assign(time, other_time, first, end)
    matched = partner >= 0
    return np.asarray(time[matched] - other_time[partner[matched]])


def _place(events: EventBatch, sampling: Sampling) -> npt.NDArray[np.int64]:
    """Return one number for each pixel and polarity."""
    pixel = events["y"].astype(np.int64) * sampling.width + events["x"]
    return np.asarray(2 * pixel + events["on"], dtype=np.int64)
