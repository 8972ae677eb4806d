"""What a stream of events is like, in numbers that tell cameras apart: to hold two recordings against each other.

They depend on how much a scene fires too. Compare streams of equal rates.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.events import EventBatch, empty_batch

MOST_EVENTS = 20_000_000
"""Events of a recording that are held in memory and counted, the first."""
LONELY_US = 5000
"""How old the newest event of a neighbour may be [µs] for an event not to be lonely: as background filters have it."""
HOT_SHARE = 0.01
"""Of pixels that fire at all, those that are called the hottest."""
_PERCENTILES = (1, 50, 99)
_NEIGHBOURS = tuple((dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if (dy, dx) != (0, 0))


@dataclass(frozen=True)
class Statistics:
    """Numbers of a stream; None where it has too few events for one.

    Attributes:
        events: how many events they are of.
        duration_s: from the first to the last event [s].
        events_per_s: mean rate [1/s].
        events_per_pixel_s: mean rate of a pixel of the sensor [1/s], or of one that fires if its size is unknown.
        active_pixels: pixels that fire.
        active_share: the same of all pixels; None if the sensor's size is unknown.
        on_share: share of ON events.
        interval_us: 1, 50 and 99 % of the times between successive events of a pixel [µs].
        shared_time: share of events whose time [µs] another event has too.
        row_mates: of neighbours in the stream that lie in one row, the share that have one and the same time.
        column_mates: the same for columns.
        one_row: of events next to each other by time and row that have one time, the share that lie in one row.
        one_column: the same by time and column, for columns.
        opposite_next: share of a pixel's events that have the other polarity than the one before.
        lonely: share of events before which none of the eight neighbours fired for 5 ms.
        hottest: share of events that the busiest hundredth of the pixels that fire have, at least one pixel.
    """

    events: int
    duration_s: float
    events_per_s: float | None
    events_per_pixel_s: float | None
    active_pixels: int
    active_share: float | None
    on_share: float | None
    interval_us: tuple[float, float, float] | None
    shared_time: float | None
    row_mates: float | None
    column_mates: float | None
    one_row: float | None
    one_column: float | None
    opposite_next: float | None
    lonely: float | None
    hottest: float | None

    def as_dict(self) -> dict[str, Any]:
        """Return the numbers by name, for JSON."""
        return dataclasses.asdict(self)


def statistics(events: EventBatch, width: int | None = None, height: int | None = None) -> Statistics:
    """Return the numbers of a stream.

    Args:
        events: in the order of the stream, times rising.
        width, height: of the sensor [pixels]; None if unknown.
    """
    count, t = len(events), events["t"]
    duration_s = float(t[-1] - t[0]) * 1e-6 if count else 0.0
    pixels = events["y"].astype(np.int64) << 16 | events["x"]
    fired = np.unique(pixels, return_counts=True)[1]
    size = width * height if width and height else None
    order = np.lexsort((np.arange(count), t, pixels))
    same = np.diff(pixels[order]) == 0
    between = np.diff(t[order])[same]
    flips = (np.diff(events["on"][order].astype(np.int8)) != 0)[same]
    at_once = np.diff(t) == 0
    rate = count / duration_s if duration_s else None
    counted = size or len(fired)
    return Statistics(
        events=count,
        duration_s=duration_s,
        events_per_s=rate,
        events_per_pixel_s=rate / counted if rate is not None and counted else None,
        active_pixels=len(fired),
        active_share=len(fired) / size if size else None,
        on_share=_share(events["on"]),
        interval_us=tuple(np.percentile(between, _PERCENTILES).tolist()) if len(between) else None,
        shared_time=_share(np.append(at_once, False) | np.insert(at_once, 0, False)) if count else None,
        row_mates=_share(at_once[np.diff(events["y"].astype(np.int64)) == 0]),
        column_mates=_share(at_once[np.diff(events["x"].astype(np.int64)) == 0]),
        one_row=_of_one_line(t, events["y"]),
        one_column=_of_one_line(t, events["x"]),
        opposite_next=_share(flips),
        lonely=_lonely(events),
        hottest=_hottest(fired),
    )


def _share(flags: npt.NDArray[Any]) -> float | None:
    return float(flags.mean()) if len(flags) else None


def _of_one_line(t: npt.NDArray[np.int64], lines: npt.NDArray[np.uint16]) -> float | None:
    order = np.lexsort((lines, t))
    return _share((np.diff(lines[order].astype(np.int64)) == 0)[np.diff(t[order]) == 0])


def _hottest(fired: npt.NDArray[np.int64]) -> float | None:
    if not len(fired):
        return None
    most = max(1, round(HOT_SHARE * len(fired)))
    return float(np.partition(fired, -most)[-most:].sum() / fired.sum())


def _lonely(events: EventBatch) -> float | None:
    """Look, for each event, for the newest one of each neighbour up to its time."""
    if not len(events):
        return None
    time = (events["t"] - events["t"][0]).astype(np.int64)
    # Pixel and time in one number, with a border on which nothing fires.
    row, step = int(events["x"].max()) + 3, int(time[-1]) + LONELY_US + 2
    place = ((events["y"].astype(np.int64) + 1) * row + events["x"] + 1) * step + time + LONELY_US
    known = np.sort(place)
    alone = np.ones(len(events), dtype=bool)
    for dy, dx in _NEIGHBOURS:
        left = np.flatnonzero(alone)
        there = place[left] + (dy * row + dx) * step
        newest = known[np.maximum(np.searchsorted(known, there, side="right") - 1, 0)]
        alone[left] = (newest > there) | (there - newest > LONELY_US)
    return float(alone.mean())


def read_statistics(
    source: Iterable[EventBatch], width: int | None = None, height: int | None = None, most: int = MOST_EVENTS
) -> tuple[Statistics, bool]:
    """Return the numbers of the first events of a source, ``most`` of them, and whether it has more."""
    batches, count = [empty_batch(0)], 0
    for batch in source:
        if count == most:
            return statistics(np.concatenate(batches), width, height), True
        batches.append(batch[: most - count].copy())
        count += len(batches[-1])
        if len(batches[-1]) < len(batch):
            return statistics(np.concatenate(batches), width, height), True
    return statistics(np.concatenate(batches), width, height), False


_TIMES = ("events_per_s", "events_per_pixel_s", "interval_us")
"""What differs by a factor; all else are shares."""
_COMPARED = (
    *_TIMES, "active_share", "on_share", "shared_time", "row_mates", "column_mates", "one_row", "one_column",
    "opposite_next", "lonely", "hottest",
)  # fmt: skip


def distances(one: Statistics, other: Statistics) -> dict[str, Any]:
    """Return how far two streams are apart in each number: shares by their difference, rates and times in decades.

    None where either has no such number; infinite where one of two times is 0. ``interval_us`` gives three.
    """
    found: dict[str, Any] = {}
    for name in _COMPARED:
        a, b = getattr(one, name), getattr(other, name)
        if a is None or b is None:
            found[name] = None
        elif isinstance(a, tuple):
            found[name] = tuple(_decades(*pair) for pair in zip(a, b, strict=True))
        else:
            found[name] = _decades(a, b) if name in _TIMES else abs(a - b)
    return found


def _decades(a: float, b: float) -> float:
    if a == b:
        return 0.0
    return abs(math.log10(a / b)) if a > 0 and b > 0 else math.inf
