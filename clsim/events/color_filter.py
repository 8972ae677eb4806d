"""Events of cameras with a colour filter array: a pixel's place tells its colour, and the sidecar the pattern."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Literal, get_args

import numpy as np

from clsim.errors import InputError
from clsim.events.batch import Causes, EventBatch, with_causes
from clsim.events.formats.filesource import EventSource
from clsim.events.sidecar import read_sidecar

FILTERS = ("red", "green", "blue")
"""What filters let through, by number."""
Pattern = Literal["RGGB", "GRBG", "GBRG", "BGGR"]
"""Colours of the pixels (0, 0), (1, 0), (0, 1) and (1, 1), and so on over the picture: x first."""


def sidecar_color_filter(name: str | os.PathLike[str]) -> str | None:
    """Return the pattern that the sidecar of an event file tells; None where it tells none.

    Raises:
        InputError: it tells something else.
    """
    pattern = read_sidecar(name).get("color_filter")
    if pattern is not None and pattern not in get_args(Pattern):
        raise InputError(f"{name}.json: `color_filter` is {pattern!r}, expected one of {', '.join(get_args(Pattern))}")
    return pattern


def filters_of(events: EventBatch, pattern: str) -> Causes:
    """Return the number in `FILTERS` of the filter before each event's pixel, uint8 ``[n]``."""
    square = np.array(["RGB".index(colour) for colour in pattern], np.uint8)
    return np.asarray(square[2 * (events["y"] % 2) + events["x"] % 2])


def with_filters(source: EventSource, pattern: str) -> EventSource:
    """Return the same events with their filter's number in a field ``cause``, as pictures colour them by."""

    def batches() -> Iterator[EventBatch]:
        with source:
            for batch in source:
                yield with_causes(batch, filters_of(batch, pattern))

    return EventSource(
        source.path, source.width, source.height, batches(), lambda: source.dropped_events, labels=("cause",)
    )
